"""Multipliers of the whole loop: against the published table, the closed-form equation, and simulated growth."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.linear.collocation import collocation_entry_state, collocation_multipliers
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.linearise import linearise, principal_passes
from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling
from testbed.engines import fast
from testbed.engines.regenerative_loop import regenerative_loop
from testbed.machine import Cutter, Cutting, Model, Structure

MASS, RPM = 2.573, 2 * math.pi / 60
MODEL = Model(Structure(MASS, 921.1 / (2 * math.pi), 0.0032), Cutter(),
              Cutting(tangential_coefficient=2.16e8 * MASS, normal_coefficient=0.3 * 2.16e8 * MASS))


def cut(rpm: float, depth_mm: float) -> Cut:
    return Cut(rpm * RPM, depth_mm * 1e-3)


def multipliers(model: Model, condition: Cut, **options) -> np.ndarray:
    return linearise(regenerative_loop(model, condition), **options).multipliers


def simulated(model: Model, condition: Cut, passes: int, skip: int, count: int, push: float, steps: int) -> np.ndarray:
    """Multipliers from how the difference of two simulated motions grows, looked at once a principal period."""
    total = (skip + count) * passes
    cuts = [replace(condition, passes=total, initial_displacement=start) for start in (0.0, push)]
    states = fast.simulate_batch([model] * 2, cuts, [Sampling(100.0, 1)] * 2, steps=steps).pass_states
    y = (states[1] - states[0])[skip * passes::passes]
    y = y / np.abs(y).max(axis=0)
    rows, ahead = np.hstack([y[:-3], y[1:-2], y[2:-1]]), y[3:]
    weight = 1 / np.linalg.norm(rows, axis=1, keepdims=True)
    fitted = np.linalg.lstsq(rows * weight, ahead * weight, rcond=1e-9)[0]
    companion = np.vstack([np.eye(6)[2:], fitted.T])
    return np.linalg.eigvals(companion)


def assert_found(values: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    """Every expected multiplier is among `values`."""
    for mu in expected:
        assert np.abs(values - mu).min() < tolerance


@pytest.mark.parametrize(("rpm", "depth", "expected"), [
    (3050, 2.7, 0.95768 + 0.65254j), (3565, 2.1, -0.97932 + 0.25732j), (3635, 2.0, -1.10151),
    (3810, 2.9, -0.69637 + 0.38921j), (2850, 2.9, 0.63601 + 0.27068j)])
def test_published_cases(rpm, depth, expected):
    assert multipliers(MODEL, cut(rpm, depth))[0] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(("flutes", "immersion", "direction", "depth"), [
    (1, 0.162, "up-milling", 2.9), (1, 0.162, "down-milling", 2.0), (3, 0.2, "up-milling", 0.4),
    (3, 0.45, "down-milling", 0.5), (4, 0.5, "up-milling", 0.3)])
def test_straight_teeth_against_the_equation_in_closed_form(flutes, immersion, direction, depth):
    model = replace(MODEL, cutter=Cutter(flutes),
                    cutting=replace(MODEL.cutting, immersion=immersion, direction=direction))
    condition = cut(3400, depth)
    motion, equation = linearise(regenerative_loop(model, condition)), milling_equation(model, condition)
    assert abs(motion.multipliers[0]) > 0.1
    np.testing.assert_allclose(motion.multipliers[:2], collocation_multipliers(equation, 24)[:2], atol=1e-9)
    np.testing.assert_allclose(motion.entry_state, collocation_entry_state(equation, 24), rtol=1e-9, atol=1e-16)


def test_helix_against_the_integral_over_the_edge():
    model = replace(MODEL, cutter=Cutter(helix_angle=math.radians(30)))
    condition = cut(3700, 2.0)
    np.testing.assert_allclose(multipliers(model, condition)[:2],
                               collocation_multipliers(milling_equation(model, condition), 24)[:2], atol=1e-6)
    assert abs(multipliers(model, condition)[0] - multipliers(MODEL, condition)[0]) > 1e-3


SECOND = {"mass_ratio": 0.5, "frequency": 480.0, "damping_ratio": 0.01, "participation": 0.6}
THIRD = {"mass_ratio": 0.3, "frequency": 790.0, "damping_ratio": 0.015, "participation": -0.8}


@pytest.mark.parametrize(("model", "condition", "tolerance"), [
    (MODEL, cut(3050, 2.7), 1e-7),
    (replace(MODEL, cutting=replace(MODEL.cutting, direction="down-milling")), cut(3700, 2.0), 1e-7),
    (replace(MODEL, cutter=Cutter(3), cutting=replace(MODEL.cutting, immersion=0.4)), cut(3700, 0.5), 1e-7),
    (replace(MODEL, cutter=Cutter(helix_angle=math.radians(30))), cut(3700, 2.0), 1e-7),
    (MODEL.with_effect("second_mode", **SECOND), cut(3810, 2.9), 1e-6),
    (MODEL.with_effect("second_mode", **SECOND).with_effect("third_mode", **THIRD), cut(3810, 2.9), 1e-6),
    (MODEL.with_effect("process_damping", **catalogue()["process_damping"].example()), cut(3050, 2.7), 1e-6),
    (MODEL.with_effect("immersion_error", **catalogue()["immersion_error"].example()), cut(3810, 2.9), 1e-6),
], ids=["base", "down-milling", "three flutes", "helix", "second mode", "three modes", "process damping", "immersion"])
def test_agrees_with_simulated_growth(model, condition, tolerance):
    values = simulated(model, condition, 1, skip=6, count=30, push=1e-6, steps=200)
    assert_found(values, multipliers(model, condition)[:2], tolerance)


def test_cubic_stiffness_is_linearised_about_the_periodic_motion():
    model, condition = MODEL.with_effect("cubic_stiffness", coefficient=5e13), cut(3810, 2.9)
    expected = multipliers(model, condition)[:2]
    values = simulated(model, condition, 1, skip=110, count=30, push=1e-5, steps=200)
    assert_found(values, expected, 1e-5)
    assert np.abs(expected - multipliers(MODEL, condition)[:2]).min() > 0.1


@pytest.mark.parametrize(("of", "amplitude", "rpm", "depth", "passes", "count"), [
    (2 / 5, 0.1, 3565, 2.1, 5, 24), (1 / 3, 0.2, 3050, 2.7, 3, 24)])
def test_speed_variation_over_its_principal_period(of, amplitude, rpm, depth, passes, count):
    """The variation takes `of` of the tooth passing frequency, so spindle and variation repeat together."""
    model = MODEL.with_effect("speed_variation", amplitude=amplitude, frequency=rpm / 60 * of, phase=0.3)
    condition = cut(rpm, depth)
    motion = linearise(regenerative_loop(model, condition))
    assert motion.passes == passes
    assert motion.mismatch < 1e-9
    values = simulated(model, condition, passes, skip=2, count=count, push=1e-6, steps=200)
    assert_found(values, motion.multipliers[:1], 1e-6 * max(1.0, abs(motion.multipliers[0])))
    steady = multipliers(MODEL, condition)[0] ** passes
    assert abs(abs(motion.multipliers[0]) - abs(steady)) > 0.05


def test_an_incommensurate_variation_says_how_far_it_is_off():
    model = MODEL.with_effect("speed_variation", amplitude=0.1, frequency=63.5 / math.sqrt(3), phase=0.0)
    passes, mismatch = principal_passes(regenerative_loop(model, cut(3810, 2.9)), 60)
    assert passes > 1
    assert 1e-6 < mismatch < 0.02


def test_droop_moves_the_multipliers_to_those_of_the_slower_spindle():
    model, condition = MODEL.with_effect("speed_droop", droop=0.1, time_constant=0.1), cut(2850, 2.9)
    motion = linearise(regenerative_loop(model, condition))
    course = motion.motion[0, :, 2]  # within the pass: the torque is that of the moment
    end = fast.simulate(model, replace(condition, passes=200), Sampling(100.0, 1), steps=60).pass_times
    loss = 1 - condition.tooth_passing_period(1) / (end[-1] - end[-2])
    assert 0.005 < course.min() < loss < course.max() < 0.05 and np.ptp(course) < 0.2 * loss
    # the feed goes on at its speed, so the chip grows; the linear loop has the multipliers of the speed alone
    slower = multipliers(MODEL, replace(condition, spindle_speed=condition.spindle_speed * (1 - loss)))
    np.testing.assert_allclose(motion.multipliers[:2], slower[:2], atol=6e-5)


def test_dry_friction_is_refused_with_its_reason_and_a_model_without_cutter_too():
    model = MODEL.with_effect("dry_friction", force=2.0, presliding_displacement=0.2e-6)
    with pytest.raises(ValueError, match="a spring of F_c / z_c .* falls with the amplitude"):
        multipliers(model, cut(3810, 2.9))
    with pytest.raises(ValueError, match="no cutter"):
        regenerative_loop(Model(MODEL.structure), cut(3810, 2.9))
