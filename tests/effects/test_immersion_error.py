"""The immersion error against a direct integration with the true window, and against a model that states it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.cut import whole_cut_sampling
from testbed.engines import fast
from testbed.machine import Cutting
from tests.effects.direct import KN, KT, MODEL, WINDOW, cut, engine, error, integrate

WRONG = MODEL.with_effect("immersion_error", error=0.15)


@pytest.mark.parametrize("direction", ["up-milling", "down-milling"])
def test_matches_a_direct_integration_over_the_true_window(direction):
    course = cut()
    first = 0.0 if direction == "up-milling" else math.pi - 1.15 * WINDOW
    model = replace(WRONG, cutting=Cutting(direction))

    def force(number, phase, x, v, past):
        theta = first + phase
        chip = (course.feed_per_tooth + x - past(number - 1, phase)) * math.sin(theta)
        return -course.axial_depth_of_cut * chip * (KT * math.cos(theta) + KN * math.sin(theta))

    expected = integrate(model, course, force, (1.15 * WINDOW,))
    assert error(engine(model, course, 160), expected) < 3e-8
    assert error(engine(replace(model, effects={}), course, 160), expected) > 1e-2


@pytest.mark.parametrize("given, immersion", [(0.15, 0.162 * 1.15), (-0.3, 0.162 * 0.7)])
def test_is_the_model_with_that_immersion(given, immersion):
    course = cut()
    sampling = whole_cut_sampling(course, 1, 12800.0)
    found = fast.simulate(MODEL.with_effect("immersion_error", error=given), course, sampling).channels["displacement"]
    true = replace(MODEL, cutting=Cutting(immersion=immersion))
    stated = fast.simulate(true, course, sampling).channels["displacement"]
    assert np.ptp(stated) > 1e-5
    assert np.abs(found - stated).max() < 1e-12 * np.ptp(stated)


def test_never_exceeds_a_slot():
    slot, course = replace(MODEL, cutting=Cutting(immersion=0.45)), cut(depth=1e-4)
    sampling = whole_cut_sampling(course, 1, 12800.0)
    found = fast.simulate(slot.with_effect("immersion_error", error=1.0), course, sampling).channels["displacement"]
    full = fast.simulate(replace(MODEL, cutting=Cutting(immersion=0.5)), course, sampling).channels["displacement"]
    assert np.array_equal(found, full) and np.ptp(full) > 1e-6
