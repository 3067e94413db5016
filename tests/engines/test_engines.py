"""The engines against each other, closed forms and the linear theory: the quick part of `make validate`."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.catalogue import catalogue
from testbed.cut import Sampling, whole_cut_sampling
from testbed.engines import fast, mujoco_engine
from tests.support.independent_simulator import simulate as plain_simulate
from tests.validation import published
from tests.validation.claims import FLEXURE, rpm
from tests.validation.effects import example
from tests.validation.engines import GROWING, STABLE, difference, motion, orders, ring_down_error
from tests.validation.multipliers import largest_difference, table_error
from tests.validation.verdicts import compare


@pytest.mark.parametrize("test", published.PUBLISHED, ids=lambda test: test.name)
def test_once_per_tooth_samples_with_contact_loss_give_the_published_verdict(test):
    assert published.simulated(test).outcome == test.outcome


def test_multipliers_of_the_two_roads_agree():
    assert largest_difference(20)[0] < 1e-6
    assert table_error() < 6e-6


@pytest.mark.parametrize(("course", "limit"), [(STABLE, 1e-9), (GROWING, 1e-7)], ids=["stable", "growing"])
def test_engines_agree_at_a_fine_step(course, limit):
    reference = motion(fast, FLEXURE, course, 800)
    assert np.abs(reference).max() > 1e-6
    assert difference(motion(mujoco_engine, FLEXURE, course, 480), reference) <= limit


def test_engines_agree_on_a_front_that_the_swing_has_left():
    """The linear kernel, the general one and MuJoCo; and it is another cut than that of a straight front."""
    course, sampling = replace(STABLE, swung_front=True), whole_cut_sampling(STABLE, 1, 12800.0)
    quick, general = (fast.simulate_batch([FLEXURE], [course], [sampling], steps=400, general=kind).out[0, 0]
                      for kind in (False, True))
    seen = np.isfinite(general)
    assert difference(quick[seen], general[seen]) < 1e-10
    assert difference(motion(mujoco_engine, FLEXURE, course, 240), motion(fast, FLEXURE, course, 400)) <= 1e-8
    assert difference(motion(fast, FLEXURE, STABLE, 400), motion(fast, FLEXURE, course, 400)) > 1e-3


@pytest.mark.parametrize("course", [STABLE, GROWING], ids=["stable", "growing"])
def test_order_of_the_fast_engine_through_entry_and_exit(course):
    assert orders(fast, FLEXURE, course, (6, 12, 24), motion(fast, FLEXURE, course, 400)).min() >= 3.5


def test_ring_down_is_the_closed_form():
    assert ring_down_error(fast) < 1e-11
    assert ring_down_error(mujoco_engine) < 1e-5


@pytest.mark.parametrize("course", [rpm(3810, 2.9, passes=40), rpm(3635, 2.0, passes=40, ring_down_passes=10)],
                         ids=["stable", "growing"])
def test_fast_engine_against_a_simulator_that_shares_no_code(course):
    found = fast.simulate(FLEXURE, course, whole_cut_sampling(course, 1, 12800.0), steps=60).channels["displacement"]
    other = plain_simulate(FLEXURE, course, steps=200, flight_steps=800).channels["displacement"]
    both = min(found.size, other.size)
    assert both > 7000
    assert difference(found[:both], other[:both]) < 1e-6


def test_linear_verdicts_are_the_simulated_ones():
    compared, different, worst = compare(60)
    assert (compared, different) == (60, 0)
    assert worst < 5e-3


@pytest.mark.parametrize("name", [name for name, effect in catalogue().items() if effect.smooth])
def test_every_smooth_law_keeps_its_order(name):
    """The power law of the chip bends within 0.3 um of none, finer than any step: it loses half of its order to that."""
    model = example(name)
    reference = motion(fast, model, STABLE, 400)
    found = orders(fast, model, STABLE, (24, 48), reference).min()
    assert found >= (1.75 if name == "chip_force_exponent" else 3.5)


def test_the_linear_kernel_and_the_general_one_are_the_same_run():
    """Samples too, which the linear kernel takes four at a time."""
    course = rpm(3810, 2.9, idle_passes=2, passes=20, ring_down_passes=3, initial_displacement=1e-5)
    for sampling in (whole_cut_sampling(course, 1, 12800.0), Sampling(977.0, 301, 0.0123), Sampling(60.0, 20)):
        quick, general = (fast.simulate_batch([FLEXURE], [course], [sampling], steps=20, general=kind)
                          for kind in (False, True))
        for channel in range(3):  # displacement, velocity, acceleration
            reference = general.out[0, channel]
            assert np.isfinite(reference).sum() > 10
            assert np.array_equal(np.isfinite(quick.out[0, channel]), np.isfinite(reference))
            apart = np.nanmax(np.abs(quick.out[0, channel] - reference))
            assert apart < 1e-10 * np.nanmax(np.abs(reference))


def test_a_run_in_a_batch_is_the_run_alone():
    cuts = [rpm(3000 + 100 * number, 1.0 + 0.1 * number, passes=10 + number) for number in range(5)]
    samplings = [whole_cut_sampling(cut, 1, 5000.0) for cut in cuts]
    together = fast.simulate_batch([FLEXURE] * 5, cuts, samplings)
    for number, (cut, sampling) in enumerate(zip(cuts, samplings, strict=True)):
        alone = fast.simulate_batch([FLEXURE], [cut], [sampling])
        assert np.array_equal(together.out[number, 0, : sampling.count], alone.out[0, 0])
        assert np.array_equal(together.pass_states[number, : cut.total_passes + 1], alone.pass_states[0])


def test_a_diverging_run_says_when():
    cut = rpm(3635, 6.0, passes=400)
    recording = fast.simulate(FLEXURE, cut, whole_cut_sampling(cut, 1, 5000.0))
    assert recording.outcome == "diverged"
    assert 0.0 < recording.outcome_time < cut.total_passes * cut.tooth_passing_period(1)
    signal = recording.channels["displacement"]
    assert np.isnan(signal[-1]) and np.all(np.isfinite(signal[recording.time < recording.outcome_time - 1e-3]))
    assert math.isfinite(float(np.nanmax(np.abs(signal))))
