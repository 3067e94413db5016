"""The helix against the exact integral of the directional coefficient, and against a direct integration with it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.cut import whole_cut_sampling
from testbed.engines import fast
from testbed.machine import Cutter, Cutting, Model
from tests.effects.direct import KN, KT, MODEL, RADIUS, WINDOW, cut, engine, error, forces, integrate, rigid


def exact(phase, lag, window=WINDOW, entry=0.0):
    """Integral of (K_t cos + K_n sin) sin over the part of the edge in the cut, over the lag, in closed form."""
    low, high = np.maximum(phase - lag, 0.0) + entry, np.minimum(phase, window) + entry

    def primitive(theta):
        return 0.5 * KT * np.sin(theta) ** 2 + KN * (theta / 2 - np.sin(2 * theta) / 4)

    return np.where(high > low, primitive(high) - primitive(low), 0.0) / lag


@pytest.mark.parametrize("angle, depth, tolerance", [(0.5, 2.0e-3, 2e-5), (0.2, 1.0e-3, 2e-5), (0.7, 12.0e-3, 2e-5)])
def test_matches_a_direct_integration_with_the_exact_coefficient(angle, depth, tolerance):
    soft = replace(MODEL, structure=replace(MODEL.structure, mass=2.573 * depth / 2e-3))
    course = cut(depth=depth)
    lag = depth * math.tan(angle) / RADIUS

    def force(number, phase, x, v, past):
        return -depth * float(exact(phase, lag)) * (course.feed_per_tooth + x - past(number - 1, phase))

    corners = tuple(sorted((lag, WINDOW, WINDOW + lag)))
    expected = integrate(soft, course, force, corners)
    assert error(engine(soft.with_effect("helix", angle=angle), course, 640), expected) < tolerance
    assert error(engine(soft, course, 640), expected) > 20 * tolerance


@pytest.mark.parametrize("direction", ["up-milling", "down-milling"])
def test_the_force_of_a_rigid_cut_is_the_exact_integral(direction):
    course = cut(depth=5.0e-3, passes=3, initial_displacement=0.0)
    model = replace(MODEL, cutting=Cutting(direction)).with_effect("helix", angle=0.5)
    lag = course.axial_depth_of_cut * math.tan(0.5) / RADIUS
    angle, fx, _ = forces(rigid(model), course)
    phase = np.where(angle > 2 * math.pi - 1e-9, 0.0, angle)
    expected = -course.axial_depth_of_cut * course.feed_per_tooth * exact(phase, lag, entry=model.cutting.entry_angle)
    miss = np.abs(fx - expected) / np.abs(expected).max()
    assert np.quantile(miss, 0.98) < 1e-6  # samples are interpolated: less well in the steps that hold the four corners
    assert miss.max() < 1e-3


def test_a_lag_of_one_pitch_gives_a_constant_force():
    model = replace(rigid(MODEL), cutter=Cutter(4)).with_effect("helix", angle=0.5)
    depth = RADIUS * (2 * math.pi / 4) / math.tan(0.5)
    course = cut(depth=depth, passes=12, initial_displacement=0.0)
    angle, fx, fy = forces(model, course)
    assert np.ptp(fx) < 1e-5 * np.abs(fx).mean() and np.ptp(fy) < 1e-5 * np.abs(fy).mean()


def test_the_angle_adds_to_the_cutters_own_and_either_sign_is_the_same_cut():
    course = cut()
    sampling = whole_cut_sampling(course, 1, 12800.0)

    def motion(model: Model) -> np.ndarray:
        return fast.simulate(model, course, sampling).channels["displacement"]

    built_in = replace(MODEL, cutter=Cutter(helix_angle=0.5))
    assert np.array_equal(motion(MODEL.with_effect("helix", angle=0.5)), motion(built_in))
    assert np.array_equal(motion(MODEL.with_effect("helix", angle=-0.5)), motion(built_in))
    corrected = motion(built_in.with_effect("helix", angle=-0.5))
    assert np.array_equal(corrected, motion(MODEL)) and not np.allclose(corrected, motion(built_in), rtol=1e-3)
