"""Runout against the closed form of unequal chips and a direct integration over a whole revolution."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.cut import whole_cut_sampling
from testbed.engines import fast
from testbed.machine import Cutter
from tests.effects.direct import KN, KT, MODEL, WINDOW, cut, engine, error, forces, integrate, rigid

E, LAMBDA = 2.0e-5, 0.4


def radius(tooth: int, flutes: int) -> float:
    return E * math.cos(LAMBDA - 2 * math.pi * tooth / flutes)


def test_matches_a_direct_integration_of_two_unequal_teeth():
    model = replace(MODEL, cutter=Cutter(2))
    course = cut(depth=0.8e-3, passes=12)
    b, h = course.axial_depth_of_cut, course.feed_per_tooth

    def force(number, theta, x, v, past):
        longer = radius(number % 2, 2) - radius((number - 1) % 2, 2)
        chip = (h + x - past(number - 1, theta)) * math.sin(theta) + longer
        return -b * chip * (KT * math.cos(theta) + KN * math.sin(theta))

    expected = integrate(model, course, force, (WINDOW,))
    assert error(engine(model.with_effect("runout", offset=E, angle=LAMBDA), course, 160), expected) < 3e-8
    assert error(engine(model, course, 160), expected) > 1e-2


@pytest.mark.parametrize("flutes", [2, 3, 4])
def test_each_tooth_of_a_rigid_cut_takes_its_own_chip_and_the_mean_force_stays(flutes):
    even = rigid(replace(MODEL, cutter=Cutter(flutes)))
    course = cut(passes=4 * flutes, initial_displacement=0.0)
    b, h = course.axial_depth_of_cut, course.feed_per_tooth
    angle, fx, fy = forces(even.with_effect("runout", offset=E, angle=LAMBDA), course)
    for tooth in range(flutes):
        theta = angle - tooth * 2 * math.pi / flutes
        inside = (theta > 0.01) & (theta < WINDOW - 0.01)
        tangential = -fx[inside] * np.cos(theta[inside]) + fy[inside] * np.sin(theta[inside])
        chip = h * np.sin(theta[inside]) + radius(tooth, flutes) - radius(tooth - 1, flutes)
        assert np.allclose(tangential, KT * b * chip, rtol=0, atol=1e-6 * KT * b * h)
    plain = forces(even, course)[1]
    assert np.ptp(fx) > 1.05 * np.ptp(plain)
    assert fx.mean() == pytest.approx(plain.mean(), rel=1e-3)


def test_with_one_flute_nothing_changes():
    course = cut()
    sampling = whole_cut_sampling(course, 1, 12800.0)
    eccentric = fast.simulate(MODEL.with_effect("runout", offset=E, angle=LAMBDA), course, sampling)
    plain = fast.simulate(MODEL, course, sampling).channels["displacement"]
    assert np.ptp(plain) > 1e-5
    assert np.abs(eccentric.channels["displacement"] - plain).max() < 1e-12
