"""A structure that is held until its record begins: the state a record begins with is found, however soon it is damped."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from testbed.analysis.fit.first_state import first_state
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.prediction import predict
from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling
from testbed.engines import fast, mujoco_engine
from testbed.engines import predict as engine
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.campaign_files import BELIEVED
from tests.support.synthetic_campaign import synthetic_record
from tests.validation.claims import FLEXURE

ENGINE = SimpleNamespace(predict_cuts=engine.predict_cuts, predict_driven=engine.predict_driven)
THREE = replace(FLEXURE, cutter=Cutter(flutes=3))
TURN = 2 * math.pi / 200.0
HELD = Cut(200.0, 0.8e-3, 1e-4, 12, 30, 12, 1e-5, 2e-3, held_until=TURN)
# a light machine in which the square of the velocity damps a swing of 10 um within some ten milliseconds
AIRY = Model(Structure(0.17, 424.0, 0.003), Cutter(flutes=4), Cutting("up-milling", 0.18, 5e8, 1.3e8)).with_effect(
    "quadratic_damping", coefficient=1500.0)  # fmt: skip


EFFECTS = [None, "quadratic_damping", "cubic_stiffness", "speed_droop", "runout", "dry_friction", "second_mode"]


def _with(name: str | None) -> Model:
    return THREE if name is None else THREE.with_effect(name, **catalogue()[name].example())


@pytest.mark.parametrize("name", EFFECTS)
def test_a_structure_held_for_a_revolution_is_one_that_begins_a_revolution_later(name):
    model, sampling = _with(name), Sampling(10000.0, 4000)
    held = fast.simulate(model, HELD, sampling)
    later = replace(HELD, held_until=0.0, idle_passes=HELD.idle_passes - 3)
    begun = fast.simulate(model, later, replace(sampling, start=-TURN))  # samples before time 0 are not looked at
    motion, after = held.channels["displacement"], np.arange(4000) / 10000.0 >= TURN
    assert np.isnan(motion[~after]).all() and np.isfinite(motion[after]).sum() > 3000
    other = begun.channels["displacement"]
    assert np.nanmax(np.abs((motion - other)[after])) < 1e-9 * np.nanmax(np.abs(motion))
    assert np.allclose(held.pass_times[3:], begun.pass_times + TURN, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", EFFECTS)
def test_a_structure_let_go_within_a_pass_has_there_the_state_it_was_given(name):
    """Followed from there by scipy, while nothing cuts."""
    model, begin = _with(name), 0.37 * TURN
    structure, end = model.structure, 1.9 * TURN
    sampling = Sampling(20000.0, 1000, begin)
    found = fast.simulate(model, replace(HELD, held_until=begin), sampling, channels=("displacement", "velocity"))
    assert found.channels["displacement"][0] == pytest.approx(1e-5, rel=1e-9)
    assert found.channels["velocity"][0] == pytest.approx(2e-3, rel=1e-6)
    if name == "dry_friction":  # its slider is another state, and its force has corners
        return
    values = model.effects.get(name, {})
    square, cube = (values.get("coefficient", 0.0) if name == law else 0.0 for law in ("quadratic_damping", "cubic_stiffness"))

    def rate(_: float, state: np.ndarray) -> list[float]:
        x, v = state
        force = structure.stiffness * x + structure.damping * v + square * abs(v) * v + cube * x**3
        return [v, -force / structure.mass]

    times = begin + np.arange(round((end - begin) * sampling.rate)) / sampling.rate
    true = solve_ivp(rate, (begin, times[-1]), [1e-5, 2e-3], t_eval=times, rtol=1e-10, atol=1e-16).y[0]
    assert np.abs(found.channels["displacement"][: len(true)] - true).max() < 2e-6 * np.abs(true).max()


def test_a_structure_is_held_while_nothing_cuts_and_by_the_fast_engine_alone():
    with pytest.raises(ValueError, match="held_until must be at least 0"):
        replace(HELD, held_until=-1.0)
    for model in (THREE, _with("runout")):
        entered, alike = (fast.simulate(model, replace(HELD, held_until=time), Sampling(10000.0, 4000)).channels["displacement"]
                          for time in (4.0 * TURN, 9.0 * TURN))
        assert np.array_equal(entered, alike, equal_nan=True)  # at the entry it moves
        assert np.isnan(entered[: round(4.0 * TURN * 1e4)]).all() and np.isfinite(entered[round(4.0 * TURN * 1e4) + 1])
    with pytest.raises(ValueError, match="moves from time 0 on"):
        mujoco_engine.simulate(THREE, HELD, Sampling(1000.0, 10))


@pytest.mark.parametrize("channel", ["displacement", "acceleration"])
def test_a_slow_sensor_has_followed_the_swing_with_which_a_record_begins(channel):
    model = THREE.with_effect("sensor_lag", time_constant=6e-4)
    free = replace(HELD, held_until=0.0, initial_displacement=4e-5, initial_velocity=0.0)
    sampling, gone = Sampling(10000.0, 2000), 300
    true = fast.simulate(model, free, sampling, channels=(channel,)).channels[channel][gone:]
    state = fast.simulate(THREE, free, sampling, channels=("displacement", "velocity")).channels
    begin = gone / sampling.rate
    held = replace(HELD, held_until=begin, initial_displacement=state["displacement"][gone],
                   initial_velocity=state["velocity"][gone])  # fmt: skip
    found = engine.predict_cuts([model], [held], [Sampling(10000.0, 2000 - gone, begin)], [channel])[0, 0]
    unmoved = engine.predict_cuts([THREE], [held], [Sampling(10000.0, 2000 - gone, begin)], [channel])[0, 0]
    assert np.abs(found - true).max() < 1e-5 * np.abs(true).max()
    assert np.abs(unmoved - true)[:5].min() > 0.02 * np.abs(true).max()  # the lag is seen from the first sample on


def _record(model: Model, rpm: float = 1500.0, depth: float = 0.3e-3, ringing: float = 1e-5, seed: int = 1):
    omega = model.structure.natural_frequency_rad
    return synthetic_record(partial(fast.simulate, steps=300), model, rpm, depth, seed, noise=1e-7,
                            course=(4, 12, 5), state=(0.6 * ringing, 0.8 * omega * ringing))  # fmt: skip


def test_what_a_record_begins_with_is_the_state_at_its_first_sample_at_any_tooth_angle():
    one = observe(_record(THREE, 2000.0), THREE)
    own = replace(model_fit(ENGINE, [one], THREE, {})[1].state.nuisances[0], displacement=2e-5, velocity=-5e-3)
    variants = [(THREE, 0.0, replace(own, angle=float(angle))) for angle in np.linspace(0.0, 2 * math.pi / 3, 40)]
    first = predict(ENGINE, one, variants)[:, 0, 0]
    assert first == pytest.approx(np.full(40, 2e-5), rel=1e-9)
    rubbing = THREE.with_effect("quadratic_damping", coefficient=3e4)
    first = predict(ENGINE, one, [(rubbing, *rest) for _, *rest in variants])[:, 0, 0]
    assert first == pytest.approx(np.full(40, 2e-5), rel=1e-9)


def test_a_swing_that_is_soon_damped_bends_no_damping():
    """Given two revolutions before the record, such a state could not be as large as the first samples show."""
    records = [_record(AIRY, *test, seed=seed) for seed, test in enumerate(((1500.0, 0.1e-3), (2650.0, 0.16e-3)))]
    observed = [observe(record, AIRY) for record in records]
    fitter, fit = model_fit(ENGINE, observed, AIRY, catalogue())
    assert fit.cost < 0.52 * sum(record.size for record in observed)
    place = fit.names.index("damping_ratio")
    error = math.sqrt(fit.covariance[place, place])
    assert abs(fit.state.model.structure.damping_ratio - 0.003) < 4 * error
    omega = fit.state.model.structure.natural_frequency_rad
    assert max(math.hypot(own.displacement, own.velocity / omega) for own in fit.state.nuisances) < 3e-5


def test_the_first_samples_show_the_state_in_every_channel_of_motion():
    record = _record(FLEXURE, 3000.0, ringing=4e-5)
    seen = observe(record, BELIEVED)
    omega = FLEXURE.structure.natural_frequency_rad
    ((displacement, velocity),) = first_state(seen, FLEXURE.structure)
    times = np.arange(seen.samples) / seen.rate
    moving = displacement * np.cos(omega * times[:80]) + velocity / omega * np.sin(omega * times[:80])
    measured = seen.data[0, :80] - seen.data[0, :80].mean()
    assert np.std(measured - moving) < 0.05 * np.std(measured)
    amplitude = math.hypot(displacement, velocity / omega)
    for order, name in enumerate(("displacement", "velocity", "acceleration")):
        phase = omega * times + 0.5 * math.pi * order
        data = omega**order * (displacement * np.cos(phase) + velocity / omega * np.sin(phase))
        channel = replace(seen, channels=(name,), data=data[None])
        (found,) = first_state(channel, FLEXURE.structure)
        assert math.hypot(found[0] - displacement, (found[1] - velocity) / omega) < 1e-3 * amplitude


def test_where_a_record_begins_in_the_cut_or_enters_at_once_nothing_is_read():
    record = observe(_record(FLEXURE, 3000.0), BELIEVED)
    structure, still = FLEXURE.structure, ((0.0, 0.0),)
    assert first_state(record, structure) != still
    assert first_state(replace(record, starts_in_cut=True), structure) == still
    entry = next(one for one in record.segments if one.kind != "idle")
    late = record.part(round((entry.start - record.start) * record.rate) - 20, 400)
    assert first_state(late, structure) == still
    assert first_state(record, replace(structure, natural_frequency=record.rate / 4)) == still  # four samples a period
