import math

import numpy as np
import pytest
from scipy.optimize import brentq

from testbed.engines import fast
from tests.effects.base_flexure import FREQUENCY, MASS, flexure, free, samples, turning_points


def ring_down(coefficient: float, amplitude: float = 50e-6):
    cut = free(amplitude)
    recording = fast.simulate(flexure(0.0, quadratic_damping={"coefficient": coefficient}), cut, samples(cut, 400e3),
                              channels=("displacement", "velocity"), steps=300)
    time, x = turning_points(recording.time, recording.channels["displacement"], recording.channels["velocity"])
    return time, np.abs(x)


def test_successive_turning_points_obey_the_first_integral():
    """(1 - 2 a X2) exp(2 a X2) = (1 + 2 a X1) exp(-2 a X1), a = c2 / m: v^2 as a function of x, integrated exactly."""
    coefficient = 2e4
    _, amplitudes = ring_down(coefficient)
    a = coefficient / MASS
    expected = [amplitudes[0]]
    for _ in amplitudes[1:]:
        right = (1 + 2 * a * expected[-1]) * math.exp(-2 * a * expected[-1])
        expected.append(brentq(lambda x, r=right: (1 - 2 * a * x) * math.exp(2 * a * x) - r, 0.0, expected[-1],
                               xtol=1e-18, rtol=1e-14))
    assert amplitudes[-1] < 0.1 * amplitudes[0]
    np.testing.assert_allclose(amplitudes, expected, rtol=2e-6)


def test_equivalent_damping():
    """dX/dt = -c_eq X / (2 m) with c_eq = 8 c2 X omega / (3 pi): 1/X grows linearly."""
    coefficient = 500.0
    time, amplitudes = ring_down(coefficient)
    slope = np.polyfit(time, 1.0 / amplitudes, 1)[0]
    assert slope == pytest.approx(4 * coefficient * 2 * math.pi * FREQUENCY / (3 * math.pi * MASS), rel=1e-3)


def test_another_exponent():
    """F = -c v_r^2 (|v| / v_r)^3 sign(v): dX/dt = -(3/8) (c / v_r) omega^2 X^3 / m, so 1/X^2 grows linearly."""
    coefficient, reference, cut = 500.0, 0.05, free(50e-6)
    law = {"coefficient": coefficient, "exponent": 3.0, "reference_velocity": reference}
    recording = fast.simulate(flexure(0.0, quadratic_damping=law), cut, samples(cut, 400e3),
                              channels=("displacement", "velocity"), steps=300)
    time, x = turning_points(recording.time, recording.channels["displacement"], recording.channels["velocity"])
    slope = np.polyfit(time, x**-2.0, 1)[0]
    assert slope == pytest.approx(0.75 * coefficient / reference * (2 * math.pi * FREQUENCY) ** 2 / MASS, rel=1e-3)
