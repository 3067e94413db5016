"""Taps without a force, of two modes, slow ones, and with a sensor turned round: closed forms, never the engine of the fit."""

import math

import numpy as np
import pytest

from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.against_force import moves_against
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.record_hypotheses import taken_notes
from testbed.analysis.search.add_effect import add_effects
from testbed.analysis.search.diagnose import diagnose
from testbed.catalogue import catalogue
from testbed.files.model_file import model_from_text, model_text
from testbed.machine import Model, Structure
from tests.validation.own_scale import ENGINE, Mode, decaying, driven, identified, record

FIRST = Mode(147.5, 0.005)


def decay(second, rate=3000.0, count=3000, noise=0.003):
    parts = [(FIRST, 1e-4, 0.3), (second, 0.5e-4, -0.9)]
    values = decaying(parts, rate, count) + noise * 1e-4 * np.random.default_rng(2).standard_normal(count)
    return record("tap", "ring-down", {"displacement": values}, rate)


def tap(sign, quantity, seed=1):
    mode, rate, count = Mode(19.8, 0.0123, 4.0), 1024.0, 3000
    time = np.arange(8 * count) / (8 * rate)
    force = np.where((time > 0.1) & (time < 0.13), np.sin(math.pi * (time - 0.1) / 0.03) ** 2, 0.0)
    values = sign * driven([mode], force, 8 * rate, quantity)[::8]
    values = values + 0.005 * values.std() * np.random.default_rng(seed).standard_normal(count)
    return record(f"tap_{seed}", "excited", {"force": force[::8], quantity: values}, rate)


@pytest.mark.parametrize("frequency", [156.0, 330.0])
def test_the_second_mode_of_a_free_decay_begins_where_the_record_does(frequency):
    second, model = Mode(frequency, 0.008), Model(Structure(2.573, 147.6, 0.006))
    observed = [observe(decay(second), model)]
    found = diagnose(ENGINE, observed, model, catalogue())
    assert (found.verdict, found.effects) == ("missing_effect", ("second_mode",))
    added = add_effects(ENGINE, observed, model, [catalogue()["second_mode"]], catalogue())
    for path, truth, near in (("natural_frequency", 147.5, 1e-4), ("second_mode.frequency", frequency, 1e-4),
                              ("damping_ratio", 0.005, 0.02), ("second_mode.damping_ratio", 0.008, 0.02)):  # fmt: skip
        assert added.parameters[path].determined and added.parameters[path].value == pytest.approx(truth, rel=near)
    guesses = {"second_mode.mass_ratio", "second_mode.participation"}
    assert set(added.model.not_determined) == guesses and set(added.held) == guesses
    assert added.model.value("second_mode.participation") == 1.0  # as the effect's file has it
    assert not any(added.parameters[path].determined for path in guesses)
    again = model_from_text(model_text(added.model))
    assert again == added.model and again.not_determined == added.model.not_determined


@pytest.mark.parametrize(("frequency", "rate"), [(0.1, 2.0), (0.8, 30.0), (18e3, 400e3)])
def test_a_decay_of_any_frequency_is_fitted_down_to_its_noise(frequency, rate):
    mode = Mode(frequency, 0.004)
    values = decaying([(mode, 1e-3, 0.2)], rate, 1500) + 5e-6 * np.random.default_rng(3).standard_normal(1500)
    model = Model(Structure(1.0, 1.01 * frequency, 0.01))
    found = compare(ENGINE, [observe(record("slow", "ring-down", {"displacement": values}, rate), model)], model, catalogue())
    assert found.error < 1.05 * found.noise_floor
    one = found.parameters["natural_frequency"]
    assert one.determined and one.value == pytest.approx(frequency, rel=1e-4) and one.high - one.low < 1e-3 * frequency


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_a_response_against_its_force_is_told_and_fitted_with_its_sign_turned(quantity):
    model = Model(Structure(3.0, 19.7, 0.02))
    held, notes = identified([tap(1.0, quantity, 1), tap(-1.0, quantity, 2)], model)
    assert held.values["mass"].determined and held.values["mass"].value == pytest.approx(4.0, rel=0.01)
    assert len(notes) == 1 and notes[0].startswith(f"tap_2 ({quantity}): the response moves against the force")
    right = [observe(tap(1.0, quantity), model)]
    assert right[0].turned == () and taken_notes(right, right) == []


def test_noise_is_not_taken_for_a_turned_sensor():
    rng = np.random.default_rng(5)
    force = np.where(np.arange(2000) // 20 == 5, 1.0, 0.0)
    assert not any(moves_against(force, rng.standard_normal(2000), 1e3, order, 1.0) for order in (0, 1, 2) for _ in range(50))
