"""The fast engine as the analysis is handed it: less is sampled and steps are shared, and the samples stay what they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from testbed.catalogue import catalogue
from testbed.cut import Sampling, whole_cut_sampling
from testbed.engines import fast
from testbed.engines import sampling_kernel as sk
from testbed.engines.predict import MOST_STEPS, predict_cuts
from testbed.engines.stiffening import stiffening
from tests.validation.claims import FLEXURE, rpm
from tests.validation.effects import example

COURSE = rpm(3810, 2.9, idle_passes=2, passes=20, ring_down_passes=3, initial_displacement=1e-5)
MOTION = ["displacement", "velocity", "acceleration"]
HARD = 3e14  # N/m^3: at twice the frequency at the end of its swing


@pytest.mark.parametrize("name", ["runout", "quadratic_damping", "second_mode", "speed_variation", "entry_ramp"])
@pytest.mark.parametrize("signals", [1, sk.N_MOTION])
def test_what_is_sampled_alone_is_what_is_sampled_with_all_else(name, signals):
    model = example(name)
    for sampling in (whole_cut_sampling(COURSE, 1, 12800.0), Sampling(977.0, 301, 0.0123), Sampling(60.0, 20)):
        everything = fast.simulate_batch([model], [COURSE], [sampling], general=True).out
        few = fast.simulate_batch([model], [COURSE], [sampling], general=True, signals=signals).out
        assert few.shape[1] == signals
        assert np.isfinite(few).sum() > 10 * signals
        # compiled apart, sums and products may be contracted otherwise
        size = np.nanmax(np.abs(everything[:, :signals]), axis=2, keepdims=True)
        assert np.allclose(few / size, everything[:, :signals] / size, rtol=0.0, atol=1e-12, equal_nan=True)


@pytest.mark.parametrize("names", [(), ("ambient_vibration",), ("sensor_lag",), ("sensor_lag", "ambient_vibration"),
                                   ("sensor_lag", "runout")])
def test_a_channel_is_predicted_alone_as_beside_its_rates(names):
    model, known = FLEXURE, catalogue()
    for name in names:
        model = model.with_effect(name, **known[name].example())
    sampling = whole_cut_sampling(COURSE, 1, 12800.0)
    alone = predict_cuts([model], [COURSE], [sampling], ["displacement"])
    beside = predict_cuts([model], [COURSE], [sampling], [*MOTION, "spindle_angle"])
    assert alone.shape == (1, 1, sampling.count) and beside.shape == (1, 4, sampling.count)
    both = np.isfinite(alone[0, 0])
    assert both.sum() > 5000 and np.ptp(alone[0, 0, both]) > 1e-5
    assert np.allclose(alone[0, 0, both], beside[0, 0, both], rtol=0.0, atol=1e-15)
    if names:
        bare = predict_cuts([FLEXURE], [COURSE], [sampling], ["displacement"])
        assert np.nanmax(np.abs(bare - alone)) > 1e-7


@pytest.mark.parametrize("measured", [False, True])
def test_what_the_sensor_alone_makes_of_a_motion_is_not_simulated_anew(measured, monkeypatch):
    model = FLEXURE.with_effect("ambient_vibration", amplitude=3e-6, frequency=50.0, phase=0.5)
    model = model.with_effect("sensor_lag", time_constant=1e-4)
    models = [model, *(model.with_values({path: value}) for path, value in (
        ("ambient_vibration.phase", 1.5), ("sensor_lag.time_constant", 2e-4), ("damping_ratio", 0.01)))]
    models, courses = [*models, model], [*[COURSE] * 4, replace(COURSE, passes=19)]
    samplings = [whole_cut_sampling(COURSE, 1, 12800.0)] * 5
    lasting = [np.full(course.total_passes, COURSE.tooth_passing_period(1)) for course in courses] if measured else None
    runs, simulated = fast.simulate_batch, []

    def counted(given, *rest, **more):
        simulated.append(len(given))
        return runs(given, *rest, **more)

    monkeypatch.setattr(fast, "simulate_batch", counted)
    together = predict_cuts(models, courses, samplings, MOTION, durations=lasting)
    assert simulated == [3]
    for run, (one, course) in enumerate(zip(models, courses, strict=True)):
        alone = predict_cuts([one], [course], samplings[:1], MOTION, durations=lasting and [lasting[run]])
        assert np.array_equal(alone[0], together[run], equal_nan=True)
    assert all(np.nanmax(np.abs(together[run] - together[0])) > 1e-7 for run in range(1, 5))


@pytest.mark.parametrize("frequency", [50.0, 500.0])
@pytest.mark.parametrize("held", [False, True])
def test_flights_follow_a_speed_that_varies_faster_than_the_structure_swings(frequency, held):
    model = FLEXURE.with_effect("speed_variation", amplitude=0.01, frequency=frequency, phase=0.3)
    model = model.with_effect("dry_friction", force=0.3, presliding_displacement=1e-8) if held else model
    sampling = whole_cut_sampling(COURSE, 1, 12800.0)
    chosen, exact = (fast.simulate_batch([model], [COURSE], [sampling], refinement=times) for times in (1, 8))
    assert np.nanmax(np.abs(chosen.pass_times - exact.pass_times)) < 2e-8


def test_variants_of_one_run_share_the_steps_that_the_first_needs():
    factors = (1.0, 1.0 + 1e-6, 0.3)
    models = [FLEXURE.with_effect("cubic_stiffness", coefficient=factor * HARD) for factor in factors]
    sampling = whole_cut_sampling(COURSE, 1, 12800.0)
    together = fast.simulate_batch(models, [COURSE] * 3, [sampling] * 3, alike=True).out[:, 0]
    alone = [fast.simulate_batch([model], [COURSE], [sampling]).out[0, 0] for model in models]
    exact = [fast.simulate_batch([model], [COURSE], [sampling], refinement=8).out[0, 0] for model in models]
    size = np.nanmax(np.abs(exact[0]))
    assert stiffening(models[0], catalogue(), size) > 1.5
    assert np.array_equal(together[0], alone[0], equal_nan=True)
    for one, reference, other in zip(together, exact, alone, strict=True):
        left = np.nanmax(np.abs(one - reference))
        assert left < max(1e-5 * size, 1.01 * np.nanmax(np.abs(other - reference)))
    assert np.nanmax(np.abs(exact[2] - exact[0])) > 0.01 * size  # the law was felt


@pytest.mark.parametrize("names", [(), ("runout",), ("dry_friction",), ("sensor_lag",), ("speed_droop", "helix")])
def test_the_first_run_is_not_simulated_again_where_it_is_at_hand(names, monkeypatch):
    model, runs, simulated = FLEXURE, [], fast.simulate_batch
    for name in names:
        model = model.with_effect(name, **catalogue()[name].example())
    models = [model, model.with_values({"damping_ratio": 4e-3}), model.with_values({"natural_frequency": 147.1})]
    monkeypatch.setattr(fast, "simulate_batch", lambda models, *given, **more: runs.append(len(models))
                        or simulated(models, *given, **more))
    sampling = whole_cut_sampling(COURSE, 1, 12800.0)
    alone = predict_cuts(models[:1], [COURSE], [sampling], ["displacement"])
    together = predict_cuts(models, [COURSE] * 3, [sampling] * 3, ["displacement"])
    lent = predict_cuts(models, [COURSE] * 3, [sampling] * 3, ["displacement"], first=alone)
    assert np.array_equal(lent, together, equal_nan=True) and runs == [1, 3, 2]
    assert np.nanstd(together[1] - together[0]) > 1e-9


@pytest.mark.parametrize("first", [FLEXURE.with_effect("runout", offset=0.0, angle=0.3), example("cubic_stiffness")])
def test_a_first_run_that_would_be_another_beside_others_is_simulated(first):
    """At a neutral value another kernel serves it alone; where the structure stiffens, the others need its steps."""
    second = first.with_effect("runout", offset=1e-8, angle=0.3)
    sampling = whole_cut_sampling(COURSE, 1, 12800.0)
    together = predict_cuts([first, second], [COURSE] * 2, [sampling] * 2, ["displacement"])
    wrong = np.ones_like(together[:1])
    lent = predict_cuts([first, second], [COURSE] * 2, [sampling] * 2, ["displacement"], first=wrong)
    assert np.array_equal(lent, together, equal_nan=True)


@pytest.mark.parametrize("runaway", [
    FLEXURE.with_values({"natural_frequency": 1e5}).with_effect("dry_friction", force=1.0, presliding_displacement=1e-11),
    FLEXURE.with_values({"natural_frequency": 1e4}).with_effect("cubic_stiffness", coefficient=1e20),
])
def test_a_run_that_takes_absurdly_many_steps_is_not_followed(runaway, monkeypatch):
    """A descent's trial at a bound; the runs beside it come out as they do without it."""
    run, taken = fast._Batch._simulated, []

    def counted(self, packed, *kernel):
        taken.extend(packed.steps_of_pass)
        return run(self, packed, *kernel)

    monkeypatch.setattr(fast._Batch, "_simulated", counted)
    sampling = whole_cut_sampling(COURSE, 1, 12800.0)
    stirred = replace(COURSE, initial_displacement=1e-3)
    ordinary = FLEXURE.with_effect("edge_force", tangential=1e4, normal=5e3)
    alone = predict_cuts([ordinary], [COURSE], [sampling], ["displacement"])
    together = predict_cuts([ordinary, runaway], [COURSE, stirred], [sampling] * 2, ["displacement"])
    assert np.array_equal(together[0], alone[0], equal_nan=True) and np.nanmax(np.abs(alone)) > 1e-5
    assert np.isnan(together[1]).all()
    assert max(taken) <= MOST_STEPS * 12800.0 * COURSE.tooth_passing_period(1)
