"""The power law of the force against its closed form and a direct integration."""

import math

import numpy as np

from testbed.catalogue import catalogue
from tests.effects.direct import KN, KT, MODEL, WINDOW, cut, engine, error, forces, integrate, rigid

Q, H0, E0 = 0.75, 1.0e-4, 3.0e-7
CURVED = MODEL.with_effect("chip_force_exponent", exponent=Q)


def test_matches_a_direct_integration_with_the_law_written_out():
    course = cut(depth=1.5e-3)

    def force(number, theta, x, v, past):
        chip = (course.feed_per_tooth + x - past(number - 1, theta)) * math.sin(theta)
        pressed = course.axial_depth_of_cut * chip * math.exp((Q - 1) * math.log(math.hypot(chip, E0) / H0))
        return -pressed * (KT * math.cos(theta) + KN * math.sin(theta))

    expected = integrate(MODEL, course, force, (WINDOW,))
    assert error(engine(CURVED, course, 160), expected) < 1e-6
    assert error(engine(MODEL, course, 160), expected) > 1e-3


def test_a_rigid_cut_follows_kienzles_power_at_three_feeds():
    for feed in (0.08e-3, 0.1e-3, 0.2e-3):
        course = cut(passes=3, feed_per_tooth=feed, initial_displacement=0.0)
        angle, fx, fy = forces(rigid(CURVED), course)
        theta = angle[(angle > 0.7 * WINDOW) & (angle < 0.95 * WINDOW)]
        chosen = (angle > 0.7 * WINDOW) & (angle < 0.95 * WINDOW)
        tangential = -fx[chosen] * np.cos(theta) + fy[chosen] * np.sin(theta)
        kienzle = KT * course.axial_depth_of_cut * H0 * (feed * np.sin(theta) / H0) ** Q
        assert np.abs(tangential / kienzle - 1).max() < 2e-3


def test_the_factor_is_finite_even_and_smooth_through_zero_and_meets_the_linear_law():
    factor = catalogue()["chip_force_exponent"].hooks["force_factor"]
    assert factor(3e-5, 1.0) == 1.0 and factor(0.0, 1.0) == 1.0
    assert math.isfinite(factor(0.0, 0.2)) and factor(-2e-5, 0.7) == factor(2e-5, 0.7)
    slopes = [(factor(h, 1.0 + 1e-6) - factor(h, 1.0 - 1e-6)) / 2e-6 for h in (0.0, 1e-6, 1e-4)]
    expected = [math.log(math.hypot(h, E0) / H0) for h in (0.0, 1e-6, 1e-4)]
    assert np.allclose(slopes, expected, rtol=1e-6, atol=1e-8)
