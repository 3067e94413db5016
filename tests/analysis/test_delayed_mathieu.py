"""The delayed Mathieu equation: order of the integration, a second road to the motion, empirical multipliers."""

import math

import numpy as np
import pytest

from testbed.analysis.linear.collocation import collocation_map, collocation_multipliers
from testbed.analysis.linear.delayed_mathieu import Mathieu, mathieu_recording, simulate_mathieu, state_multipliers
from testbed.analysis.linear.temporal_elements import characteristic_multipliers


def test_the_integration_is_of_fourth_order():
    runs = [simulate_mathieu(Mathieu(2.2), 6, steps=steps).displacement[::steps // 100] for steps in (100, 200, 1600)]
    coarse, fine = (np.abs(run - runs[2]).max() for run in runs[:2])
    assert np.ptp(runs[2]) > 1.0 and 3.7 < math.log2(coarse / fine) < 4.3


def test_without_delay_and_fluctuation_it_is_a_damped_oscillator():
    oscillator = Mathieu(4.0, kappa=0.2, eps=0.0, b=0.0)
    motion = simulate_mathieu(oscillator, 2)
    frequency = math.sqrt(4.0 - 0.01)
    exact = np.exp(-0.1 * motion.time) * (np.cos(frequency * motion.time) + 0.1 / frequency * np.sin(frequency * motion.time))
    assert np.abs(motion.displacement - exact).max() < 1e-9


def test_collocation_carries_the_motion_on_to_the_same_place():
    """Second road: the Chebyshev series of one delay, fitted to the motion, mapped on by collocation."""
    oscillator = Mathieu(1.3)
    motion = simulate_mathieu(oscillator, 4)
    degree, steps = 40, motion.steps
    time = np.linspace(-1.0, 1.0, steps + 1)
    matrix, _, _ = collocation_map(oscillator.equation(), degree)
    series = np.polynomial.chebyshev.chebfit(time, motion.displacement[steps:2 * steps + 1], degree)
    for turn in (2, 3):
        series = matrix @ series
        piece = motion.displacement[turn * steps:(turn + 1) * steps + 1]
        assert np.ptp(piece) > 0.1
        assert np.abs(np.polynomial.chebyshev.chebval(time, series) - piece).max() < 1e-8


@pytest.mark.parametrize("delta", [-0.4, 0.5, 0.9, 1.3, 2.2, 3.15, 4.5])
def test_empirical_multipliers_meet_both_models(delta):
    oscillator = Mathieu(delta)
    motion = simulate_mathieu(oscillator, 21)
    exact = collocation_multipliers(oscillator.equation(), 40)[0]
    for delays, limit in ((4, 2e-3), (8, 1e-6)):
        found = state_multipliers(motion.states(delays)[1:])[0]
        assert min(abs(found - exact), abs(found - np.conj(exact))) < limit * max(1.0, abs(exact))
    elements = characteristic_multipliers(oscillator.equation(), 40)[0]
    assert min(abs(elements - exact), abs(elements - np.conj(exact))) < 1.5e-4 * max(1.0, abs(exact))


def test_states_are_the_displacements_at_their_instants():
    motion = simulate_mathieu(Mathieu(2.2), 5)
    states = motion.states(4, phase=0.25)
    assert states.shape == (4, 4)
    assert states[2, 3] == motion.displacement[3 * motion.steps]
    with pytest.raises(ValueError, match="do not fall"):
        motion.states(7)


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="three states"):
        state_multipliers(np.ones((2, 4)))
    with pytest.raises(ValueError, match="no motion"):
        state_multipliers(np.zeros((9, 4)))
    with pytest.raises(ValueError, match="period"):
        simulate_mathieu(Mathieu(1.0), 0)


def test_a_recording_of_it_has_a_mark_a_delay():
    recording = mathieu_recording(simulate_mathieu(Mathieu(2.2), 6))
    assert recording.marks.size == 7 and np.allclose(np.diff(recording.marks), 2 * math.pi)
    assert recording.time[-1] == pytest.approx(12 * math.pi)
