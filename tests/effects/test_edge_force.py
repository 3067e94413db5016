"""The edge force against the closed form of its mean and a direct integration."""

import math

import numpy as np
import pytest

from testbed.machine import Cutter, Cutting, Model
from tests.effects.direct import KN, KT, MODEL, WINDOW, cut, engine, error, forces, integrate, rigid

KTE, KNE = 2.5e4, 3.0e4
RUBBING = MODEL.with_effect("edge_force", tangential=KTE, normal=KNE)


def test_matches_a_direct_integration_with_the_law_written_out():
    course = cut()
    b = course.axial_depth_of_cut

    def force(number, theta, x, v, past):
        chip = (course.feed_per_tooth + x - past(number - 1, theta)) * math.sin(theta)
        return -b * ((KT * chip + KTE) * math.cos(theta) + (KN * chip + KNE) * math.sin(theta))

    expected = integrate(MODEL, course, force, (WINDOW,))
    assert error(engine(RUBBING, course), expected) < 1e-7
    assert error(engine(MODEL, course), expected) > 1e-2


@pytest.mark.parametrize("direction", ["up-milling", "down-milling"])
@pytest.mark.parametrize("flutes", [1, 3])
def test_mean_force_of_a_rigid_cut_is_a_line_in_the_feed(direction, flutes):
    model = Model(MODEL.structure, Cutter(flutes), Cutting(direction), RUBBING.effects)
    first = model.cutting.entry_angle
    last = first + WINDOW
    course = cut(passes=3 * flutes, initial_displacement=0.0)
    b, h = course.axial_depth_of_cut, course.feed_per_tooth
    angle, fx, fy = forces(rigid(model), course)
    edge_x = -(KTE * (math.sin(last) - math.sin(first)) - KNE * (math.cos(last) - math.cos(first)))
    chip_x = -h * (KT * (math.sin(last) ** 2 - math.sin(first) ** 2) / 2
                   + KN * (WINDOW / 2 - (math.sin(2 * last) - math.sin(2 * first)) / 4))
    edge_y = -KTE * (math.cos(last) - math.cos(first)) - KNE * (math.sin(last) - math.sin(first))
    chip_y = h * (KT * (WINDOW / 2 - (math.sin(2 * last) - math.sin(2 * first)) / 4)
                  - KN * (math.sin(last) ** 2 - math.sin(first) ** 2) / 2)
    for found, edge, chip in ((fx, edge_x, chip_x), (fy, edge_y, chip_y)):
        expected = flutes * b * (edge + chip) / (2 * math.pi)
        scale = flutes * b * (abs(edge) + abs(chip)) / (2 * math.pi)
        assert found.mean() == pytest.approx(expected, abs=2e-3 * scale)
        assert abs(edge) > 0.05 * (abs(edge) + abs(chip))


def test_an_edge_that_has_lost_contact_does_not_rub():
    course = cut(3635.0, 2.0e-3, passes=20)
    model = RUBBING.with_effect("contact_loss")
    angle, fx, fy = forces(model, course, turns=4)
    in_cut = (angle % (2 * math.pi) > 0.02) & (angle % (2 * math.pi) < WINDOW - 0.02)
    tangential = -fx * np.cos(angle) + fy * np.sin(angle)
    clear = in_cut & (np.abs(tangential) == 0.0)
    assert clear.any() and np.all(fx[clear] == 0.0)
    touching = in_cut & ~clear
    assert tangential[touching].min() > 0.99 * KTE * course.axial_depth_of_cut
