import math

import numpy as np
from scipy.integrate import solve_ivp

from testbed.cut import Sampling
from testbed.engines import fast
from tests.effects.base_flexure import FEED, flexure, stable_cut


def test_speed_falls_as_the_torque_of_the_moment_has_it():
    """On a rigid structure the torque is K_t b h R sin(theta) in the cut; s follows it by T ds/dt = d M - s (scipy)."""
    drop, time_constant = 1e-4, 0.15
    cut = stable_cut(80)
    model = flexure(mass=1e12)
    exit_angle, period = model.cutting.engagement_angle, cut.tooth_passing_period(1)
    peak = (model.cutting.tangential_coefficient * cut.axial_depth_of_cut * FEED * model.cutter.diameter / 2)
    mean = peak * (1 - math.cos(exit_angle)) / (2 * math.pi)
    model = model.with_effect("speed_droop", droop=drop / mean, time_constant=time_constant)
    times = fast.simulate(model, cut, Sampling(100.0, 1)).pass_times

    def rates(angle, state):  # the loss and the time, over the spindle angle
        angle = angle % (2 * math.pi)
        torque = peak * math.sin(angle) if angle < exit_angle else 0.0
        return np.array([(drop / mean * torque - state[0]) / time_constant, 1.0]) * period / (2 * math.pi) / (1 - state[0])

    state, expected = np.zeros(2), [0.0]
    for turn in range(cut.passes):
        for part in ((0.0, exit_angle * (1 - 1e-12)), (exit_angle * (1 + 1e-12), 2 * math.pi * (1 - 1e-12))):
            span = [2 * math.pi * turn + angle for angle in part]
            state = solve_ivp(rates, span, state, rtol=1e-10, atol=1e-14).y[:, -1]
        expected.append(state[1])
    np.testing.assert_allclose(times, expected, atol=2e-9)
    loss = 1 - period / np.diff(times)
    assert loss[-1] > 0.99 * drop and 0.02 * drop < loss[0] < 0.15 * drop


def test_a_deeper_cut_slows_more_and_idling_not_at_all():
    model = flexure(mass=1e12).with_effect("speed_droop", droop=0.25, time_constant=0.05)
    cut = stable_cut(60, idle_passes=10, ring_down_passes=60)
    durations = np.diff(fast.simulate(model, cut, Sampling(100.0, 1)).pass_times) / cut.tooth_passing_period(1)
    np.testing.assert_allclose(durations[:10], 1.0, rtol=1e-12)
    assert durations[69] > 1.02
    np.testing.assert_allclose(durations[-1], 1.0, rtol=1e-5)
