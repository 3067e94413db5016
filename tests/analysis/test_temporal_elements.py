"""Temporal elements against published numbers, collocation and the independent simulator."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from testbed.analysis.linear.collocation import collocation_entry_state, collocation_multipliers
from testbed.analysis.linear.delay_equation import mathieu_equation, milling_equation
from testbed.analysis.linear.spectral_elements import multipliers
from testbed.analysis.linear.stability import classify
from testbed.analysis.linear.temporal_elements import (
    characteristic_multipliers,
    temporal_element_map,
    transition_matrix,
)
from testbed.cut import Cut
from testbed.machine import DIRECTIONS, Cutter, Cutting, Model, Structure
from tests.support.independent_simulator import simulate

MASS, GAMMA = 2.573, 2.16e8
PAPER = Model(Structure(MASS, 921.1 / (2 * math.pi), 0.0032), Cutter(),
              Cutting("up-milling", 0.162, GAMMA * MASS, 0.3 * GAMMA * MASS))
CASES = [(3050, 2.7, 0.95768 + 0.65254j, 1.15886), (3565, 2.1, -0.97932 + 0.25732j, 1.01256),
         (3635, 2.0, -1.10151, 1.10151), (3810, 2.9, -0.69637 + 0.38921j, 0.79776),
         (2850, 2.9, 0.63601 + 0.27068j, 0.69121)]


def rpm(speed, depth_mm, **more):
    return Cut(speed * 2 * math.pi / 60, depth_mm * 1e-3, **more)


@pytest.mark.parametrize(("speed", "depth", "largest", "modulus"), CASES)
def test_both_roads_give_the_published_multipliers(speed, depth, largest, modulus):
    equation = milling_equation(PAPER, rpm(speed, depth))
    for found in (characteristic_multipliers(equation, 20)[0], collocation_multipliers(equation, 24)[0]):
        assert abs(found - largest) < 0.8e-5  # half a unit of the last digit in each part
        assert abs(abs(found) - modulus) < 0.6e-5


def random_equation(random):
    direction = DIRECTIONS[random.integers(2)]
    model = Model(Structure(MASS, random.uniform(80, 400), random.uniform(0.001, 0.05)),
                  Cutter(int(random.integers(1, 5)), helix_angle=random.choice([0.0, 0.5])),
                  Cutting(direction, random.uniform(0.03, 0.5), 10 ** random.uniform(8, 9),
                          10 ** random.uniform(7.3, 8.7)))
    return milling_equation(model, rpm(random.uniform(2000, 15000), random.uniform(0.1, 3.0)))


def test_spectral_elements_and_collocation_agree_on_random_cuts():
    random = np.random.default_rng(0)
    for _ in range(200):
        equation = random_equation(random)
        elements = multipliers(equation)[0][0]
        collocated = collocation_multipliers(equation, 30)
        assert np.min(np.abs(collocated - elements)) < 1e-6 * max(1.0, abs(elements))
        assert abs(abs(collocated[0]) - abs(elements)) < 1e-6 * max(1.0, abs(elements))


@pytest.mark.parametrize("speed", [3050, 3810])
def test_error_falls_with_the_fourth_power_of_the_number_of_elements(speed):
    equation = milling_equation(PAPER, rpm(speed, 2.5))
    exact = collocation_multipliers(equation, 24)[0]
    errors = [abs(characteristic_multipliers(equation, elements)[0] - exact) for elements in (6, 12, 24)]
    assert errors[0] < 1e-3
    for coarse, fine in zip(errors, errors[1:], strict=False):
        assert 12 < coarse / fine < 21


def test_fixed_point_agrees_with_collocation_and_with_the_simulated_steady_cut():
    cut = rpm(3810, 2.9, passes=120)
    equation = milling_equation(PAPER, cut)
    displacement, velocity = temporal_element_map(equation, 20).fixed_point()
    other = collocation_entry_state(equation)
    assert abs(displacement[0]) > 1e-5
    assert displacement[0] == pytest.approx(other[0], abs=1e-10)
    assert velocity[0] == pytest.approx(other[1], abs=1e-7)
    record = simulate(PAPER, cut)
    simulated = CubicSpline(record.time, record.channels["displacement"])(118 * equation.delay)
    assert displacement[0] == pytest.approx(float(simulated), abs=2e-10)


def test_mathieu_stability_follows_the_known_sequence_along_delta():
    known = [(-0.6, "saddle_node"), (-0.35, "neimark_sacker"), (0.3, "flip"), (0.82, "stable"), (0.91, "saddle_node"),
             (1.5, "stable"), (4.0, "stable")]
    for delta, outcome in known:
        equation = mathieu_equation(0.2, delta, 1.0, -0.2)
        elements, collocated = characteristic_multipliers(equation, 30), collocation_multipliers(equation, 28)
        assert classify(elements) == classify(collocated) == outcome
        assert abs(elements[0] - collocated[0]) < 3e-4 * max(1.0, abs(elements[0]))


@pytest.mark.parametrize("stiffness", [400.0, 25.0, 4.0, -9.0])
def test_free_flight_is_a_flow(stiffness):
    half, whole = transition_matrix(10.0, stiffness, 0.03), transition_matrix(10.0, stiffness, 0.06)
    np.testing.assert_allclose(half @ half, whole, rtol=1e-12)
    assert np.linalg.det(whole) == pytest.approx(math.exp(-10.0 * 0.06), rel=1e-12)


def test_bad_numbers_of_elements_are_refused():
    with pytest.raises(ValueError, match="elements"):
        temporal_element_map(milling_equation(PAPER, rpm(3810, 2.9)), 0)
