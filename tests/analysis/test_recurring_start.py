"""Effects that recur in time: is their frequency found in the records, and has every record a phase of its own?"""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.fit.effect_start import Origin, first_step
from testbed.analysis.fit.held_out import own_refit
from testbed.analysis.fit.nuisances import Nuisances, turned_by
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.recurring_start import recurring_starts, residual_peaks
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.fit.waveform import Fitter
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.campaign_files import BELIEVED
from tests.support.synthetic_campaign import synthetic_campaign

TRUE = Model(Structure(2.573, 146.42, 0.0032), Cutter(), Cutting())
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=catalogue()),
                        predict_driven=partial(predict.predict_driven, catalogue=catalogue()))
TESTS = ((3500, 0.8), (2600, 1.5), (3900, 2.2))


def fitted(true, tachometer):
    records = synthetic_campaign(partial(fast.simulate, steps=37), true, seed=6, tests=TESTS)
    if not tachometer:
        records = [replace(one, recording=replace(one.recording, marks=np.empty(0))) for one in records]
    return base_fit(ENGINE, [observe(record, BELIEVED) for record in records], BELIEVED)


def test_an_ambient_line_is_found_with_a_phase_for_every_record():
    fitter, fit = fitted(TRUE.with_effect("ambient_vibration", amplitude=4e-6, frequency=61.3, phase=0.7), True)
    effect = catalogue()["ambient_vibration"]
    _, state, wider = first_step(fitter, effect, fit, [Origin(fit.state, fit.parts)])
    found = alternate_fit_and_passes(wider, state, rounds=2).state
    assert found.model.value("ambient_vibration.frequency") == pytest.approx(61.3, rel=1e-3)
    assert found.model.value("ambient_vibration.amplitude") == pytest.approx(4e-6, rel=0.03)
    phases = [dict(own.shifts)["ambient_vibration.phase"] for own in found.nuisances]
    assert np.ptp(phases) > 0.5  # the records start at samples that nobody tells


def test_a_varying_speed_shows_its_frequency_without_a_tachometer():
    fitter, fit = fitted(TRUE.with_effect("speed_variation", amplitude=0.002, frequency=4.3, phase=1.0), False)
    effect = catalogue()["speed_variation"]
    wider = Fitter(ENGINE, fitter.records, fitter.unknowns)
    starts = recurring_starts(wider, effect, fit)
    assert min(abs(one["frequency"] - 4.3) for one in starts) < 0.5
    assert all(0.0 < one["amplitude"] < 0.05 for one in starts)


def test_the_frequency_that_explains_most_is_tried_although_another_costs_less_at_once():
    """A line a little off turns its phase over the record: left as it stands it costs more than a faint wrong one."""
    fitter, fit = fitted(TRUE.with_effect("speed_variation", amplitude=0.004, frequency=5.07, phase=1.0), False)
    cost, state, wider = first_step(fitter, catalogue()["speed_variation"], fit, [Origin(fit.state, fit.parts)])
    assert cost < 0.5 * fit.cost and state.model.value("speed_variation.frequency") == pytest.approx(5.07, abs=0.05)
    found = wider.descend(state, iterations=10).state.model
    assert found.value("speed_variation.amplitude") == pytest.approx(0.004, rel=0.01)


def test_a_phase_goes_round():
    own = turned_by(turned_by(Nuisances(), "ambient_vibration.phase", 3.0), "ambient_vibration.phase", 3.0)
    assert dict(own.shifts)["ambient_vibration.phase"] == pytest.approx(6.0 - 2 * np.pi)
    model = TRUE.with_effect("ambient_vibration", amplitude=1e-6, frequency=50.0, phase=0.5)
    assert own.shifted(model).value("ambient_vibration.phase") == pytest.approx(6.5 - 2 * np.pi)
    assert own.shifted(TRUE) == TRUE  # a shift of an effect that the model has no more says nothing


def test_no_record_gets_worse_when_its_own_unknowns_are_refitted():
    fitter, fit = fitted(TRUE, True)
    wrong = replace(fit.state, model=fit.state.model.with_values({"tangential_coefficient": 9e8}))
    before = [float(np.sum(rest**2)) for rest in fitter.residuals(wrong)]
    state = own_refit(fitter, wrong, range(len(fitter.records)))
    after = [float(np.sum(rest**2)) for rest in fitter.residuals(state)]
    assert all(late <= early * (1 + 1e-9) for late, early in zip(after, before, strict=True))
    assert any(late < early for late, early in zip(after, before, strict=True))


def test_a_line_of_one_record_alone_must_stand_higher_than_one_of_two():
    random, time = np.random.default_rng(8), np.arange(20000) / 1e4

    def peaks(*records):
        lines = [size * np.sin(2 * np.pi * hertz * time + 1.0) for hertz, size in records]
        rests = tuple(line + random.standard_normal(time.size) for line in lines)
        seen = [SimpleNamespace(rate=1e4, cut=TESTS[0], main_frequency=2 * np.pi * 150.0,
                                on_samples=lambda rest: rest.reshape(1, -1)) for _ in rests]
        return residual_peaks(seen, SimpleNamespace(residuals=rests))

    faint, loud = 0.068, 0.3
    assert any(abs(peak - 1234.5) < 1.0 for peak in peaks((1234.5, faint), (1234.5, faint)))
    assert not any(abs(peak - 1234.5) < 1.0 for peak in peaks((1234.5, faint), (900.0, loud)))
    assert any(abs(peak - 900.0) < 1.0 for peak in peaks((1234.5, faint), (900.0, loud)))
