import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import jv

from testbed.cut import Cut, Sampling
from testbed.engines import fast
from tests.effects.base_flexure import FEED, FREQUENCY, MASS, ZETA, flexure, stable_cut

VARIATION = {"amplitude": 0.2, "frequency": 23.0, "phase": 0.7}


def angle(t: float, speed: float) -> float:
    """Integral of the speed from 0 to t, rad."""
    w, phi = 2 * math.pi * VARIATION["frequency"], VARIATION["phase"]
    return speed * (t + VARIATION["amplitude"] / w * (math.cos(phi) - math.cos(w * t + phi)))


def time_at(theta: float, speed: float) -> float:
    return brentq(lambda t: angle(t, speed) - theta, theta / speed - 0.1, theta / speed + 0.1, xtol=1e-15, rtol=1e-14)


def test_pass_times_follow_the_integral_of_the_speed():
    cut = stable_cut(30)
    times = fast.simulate(flexure(speed_variation=VARIATION), cut, Sampling(100.0, 1), steps=60).pass_times
    expected = [time_at(2 * math.pi * n, cut.spindle_speed) for n in range(31)]
    np.testing.assert_allclose(times, expected, atol=1e-9)
    assert np.ptp(np.diff(times)) > 0.3 * cut.tooth_passing_period(1)


def test_motion_against_a_direct_integration_with_the_delay_of_the_angle():
    model, cut = flexure(speed_variation=VARIATION), stable_cut(4)
    cutting, w = model.cutting, 2 * math.pi * FREQUENCY
    feed_speed = FEED / cut.tooth_passing_period(1)
    pieces: list = []  # (start, end, solution)

    def past(t):
        for start, end, solution in pieces:
            if start <= t <= end:
                return solution(t)[0]
        return 0.0

    def right(t, y, on):
        theta = angle(t, cut.spindle_speed)
        force = 0.0
        if on:
            before = time_at(theta - 2 * math.pi, cut.spindle_speed)
            left = past(before)  # of the pass before the first what rigid teeth left
            chip = feed_speed * (t - before) + y[0] - left
            k = cutting.tangential_coefficient * math.cos(theta) + cutting.normal_coefficient * math.sin(theta)
            force = -cut.axial_depth_of_cut * k * math.sin(theta) * chip
        return [y[1], force / MASS - 2 * ZETA * w * y[1] - w**2 * y[0]]

    state = [0.0, 0.0]
    for n in range(4):
        for low, high, on in ((0.0, cutting.engagement_angle, 1), (cutting.engagement_angle, 2 * math.pi, 0)):
            start, end = (time_at(2 * math.pi * n + part, cut.spindle_speed) for part in (low, high))
            run = solve_ivp(right, (start, end), state, args=(on,), rtol=1e-9, atol=1e-14, method="DOP853",
                            dense_output=True)
            pieces.append((start, end, run.sol))
            state = run.y[:, -1]
    times = np.linspace(0.001, pieces[-1][1] - 1e-4, 60)
    expected = np.array([past(t) for t in times])
    sampling = Sampling(59 / (times[-1] - times[0]), 60, times[0])
    got = fast.simulate(model, cut, sampling, steps=100).channels["displacement"]
    assert np.abs(expected).max() > 2e-5
    np.testing.assert_allclose(got, expected, atol=1e-6 * np.abs(expected).max())


def test_side_lines_are_bessel_functions():
    """exp(i angle) has lines at Omega + 2 pi k f of height |J_k(Omega a / (2 pi f))|."""
    cut = Cut(2 * math.pi * 60.0, 0.0, passes=0, ring_down_passes=100)
    variation = {"amplitude": 0.2, "frequency": 20.0, "phase": 0.0}
    recording = fast.simulate(flexure(speed_variation=variation), cut, Sampling(6000.0, 6000), steps=60,
                              channels=("spindle_angle",))
    lines = np.abs(np.fft.fft(np.exp(1j * recording.channels["spindle_angle"]))) / 6000
    index = cut.spindle_speed * variation["amplitude"] / (2 * math.pi * variation["frequency"])
    for k in (-2, -1, 0, 1, 2):
        assert abs(lines[60 + 20 * k] - abs(jv(k, index))) < 1e-3
