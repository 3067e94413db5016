"""Tool wear against a direct integration, and the length a record says was cut before."""

import math

import numpy as np
import pytest

from tests.effects.direct import KN, KT, MODEL, WINDOW, cut, engine, error, forces, integrate, rigid

RATE = 5.0
WORN = MODEL.with_effect("tool_wear", rate=RATE)


def test_matches_a_direct_integration_with_growing_coefficients():
    course = cut(depth=1.2e-3, length_cut_before=0.05)
    b, h = course.axial_depth_of_cut, course.feed_per_tooth

    def force(number, theta, x, v, past):
        length = 0.05 + h * (number + theta / (2 * math.pi))
        chip = (h + x - past(number - 1, theta)) * math.sin(theta)
        return -b * (1 + RATE * length) * chip * (KT * math.cos(theta) + KN * math.sin(theta))

    expected = integrate(MODEL, course, force, (WINDOW,))
    assert error(engine(WORN, course, 160), expected) < 3e-8
    assert error(engine(MODEL, course, 160), expected) > 1e-2


def test_a_rigid_cuts_force_is_a_line_in_the_length_cut():
    means = []
    for before in (0.0, 0.1, 0.4):
        course = cut(passes=3, initial_displacement=0.0, length_cut_before=before)
        _, fx, _ = forces(rigid(WORN), course)
        means.append(fx.mean() / forces(rigid(MODEL), course)[1].mean())
    feed = 2.0 * cut().feed_per_tooth + cut().feed_per_tooth * WINDOW / (4 * math.pi)
    assert means == pytest.approx([1 + RATE * (before + feed) for before in (0.0, 0.1, 0.4)], rel=1e-4)


def test_two_records_in_a_row_wear_as_one():
    h = cut().feed_per_tooth
    late = forces(rigid(WORN), cut(passes=30, initial_displacement=0.0))[1]
    second = forces(rigid(WORN), cut(passes=10, initial_displacement=0.0, length_cut_before=20 * h))[1]
    assert np.allclose(late, second, rtol=0, atol=1e-6 * np.abs(late).max()) and np.ptp(late) > 50.0
