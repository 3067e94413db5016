import math

import numpy as np
from base_flexure import FEED, flexure, stable_cut

from testbed.cut import Sampling
from testbed.engines import fast


def test_speed_falls_exponentially_to_the_droop_of_the_torque():
    """On a rigid structure the mean torque is K_t b h R (1 - cos theta_exit) / (2 pi), from the second pass on."""
    drop, time_constant = 1e-4, 0.15
    cut = stable_cut(80)
    model = flexure(mass=1e12)
    torque = (model.cutting.tangential_coefficient * cut.axial_depth_of_cut * FEED * model.cutter.diameter / 2
              * (1 - math.cos(model.cutting.engagement_angle)) / (2 * math.pi))
    model = model.with_effect("speed_droop", droop=drop / torque, time_constant=time_constant)
    times = fast.simulate(model, cut, Sampling(100.0, 1)).pass_times
    period = cut.tooth_passing_period(1)
    loss = 1 - period / np.diff(times)[1:]  # mean of the relative loss over each pass
    start, end = times[1:-1] - times[1], times[2:] - times[1]
    decay = time_constant * (np.exp(-start / time_constant) - np.exp(-end / time_constant)) / (end - start)
    np.testing.assert_allclose(loss, drop * (1 - decay), rtol=3e-4)
    assert loss[-1] > 0.99 * drop and loss[0] < 0.06 * drop


def test_a_deeper_cut_slows_more_and_idling_not_at_all():
    model = flexure(mass=1e12).with_effect("speed_droop", droop=0.25, time_constant=0.05)
    cut = stable_cut(60, idle_passes=10, ring_down_passes=60)
    durations = np.diff(fast.simulate(model, cut, Sampling(100.0, 1)).pass_times) / cut.tooth_passing_period(1)
    np.testing.assert_allclose(durations[:10], 1.0, rtol=1e-12)
    assert durations[69] > 1.02
    np.testing.assert_allclose(durations[-1], 1.0, rtol=1e-5)
