"""Contact loss against two integrations that share nothing with the engine, a rigid cut in closed form, a balance."""

import math

import numpy as np
import pytest

from testbed.cut import Sampling
from testbed.engines import fast
from testbed.machine import Cutter, Model
from tests.effects import located_contact
from tests.effects.direct import KN, KT, MODEL, WINDOW, cut, engine, error, forces, integrate, rigid
from tests.support import independent_simulator

BOUNDED = MODEL.with_effect("contact_loss")


def test_matches_a_direct_integration_that_keeps_every_pass_before():
    course = cut(3050.0, 2.7e-3, passes=10, initial_displacement=1.5e-4)
    h, lost = course.feed_per_tooth, []

    def force(number, theta, x, v, past):
        surface = max([-h] + [k * h + past(k, theta) for k in range(number)])
        gap = number * h + x - surface
        lost.append(gap < 0)
        chip = max(0.0, gap) * math.sin(theta)
        return -course.axial_depth_of_cut * chip * (KT * math.cos(theta) + KN * math.sin(theta))

    expected = integrate(MODEL, course, force, (WINDOW,), tolerance=1e-9)
    assert 0.1 < np.mean(lost) < 0.9
    assert error(engine(BOUNDED, course, 400), expected) < 1e-5
    assert error(engine(MODEL, course, 400), expected) > 1e-2


@pytest.mark.parametrize("rpm, depth", [(3635.0, 2.0e-3), (3050.0, 2.7e-3)])
def test_matches_the_independent_simulator_in_grown_chatter(rpm, depth):
    course = cut(rpm, depth, passes=40, initial_displacement=0.0)
    other = independent_simulator.simulate(MODEL, course, steps=600, flight_steps=2000, contact_loss=True)
    theirs = other.channels["displacement"]
    sampling = Sampling(other.sampling_rate, theirs.size)
    ours = fast.simulate(BOUNDED, course, sampling, steps=600).channels["displacement"]
    linear = fast.simulate(MODEL, course, sampling, steps=600).channels["displacement"]
    assert np.abs(ours - theirs).max() < 2e-4 * np.abs(theirs).max()
    assert np.abs(linear - theirs).max() > 0.05 * np.abs(theirs).max()


def test_what_costs_the_order_is_the_kink_in_the_surface_that_is_left():
    """Fourth order where loss, return and the surface's kinks are all in their place; second where only the first two are.

    The engines keep the surface at their grid's points, so they cannot do better than the second, and do no worse.
    """
    course = cut(3635.0, 2.0e-3, passes=12, initial_displacement=1e-4)
    exact = np.array(located_contact.simulate(course, 480))
    peak = np.abs(exact).max()

    def order(errors):
        return math.log(errors[0] / errors[1], 8.0)

    kept, lost, ours = ([], [], [])
    for steps in (20, 160):
        kept.append(np.abs(np.array(located_contact.simulate(course, steps)) - exact).max() / peak)
        lost.append(np.abs(np.array(located_contact.simulate(course, steps, located=False)) - exact).max() / peak)
        ours.append(np.abs(engine(BOUNDED, course, steps)[:, 0] - exact).max() / peak)
    assert order(kept) > 3.7 and kept[1] < 2e-8
    assert 1.5 < order(lost) < 2.7 and lost[1] > 50 * kept[1]
    assert 1.5 < order(ours) < 2.7 and ours[1] < 3e-5


def test_a_tooth_behind_a_longer_one_cuts_nothing_and_the_other_takes_both_chips():
    # rigid, two flutes, radii differing by more than the feed: one tooth takes 2 h sin(theta), the other flies over
    course = cut(passes=12, initial_displacement=0.0)
    model = Model(MODEL.structure, Cutter(2), MODEL.cutting).with_effect("contact_loss").with_effect(
        "runout", offset=1.0e-4, angle=0.0)
    angle, fx, fy = forces(rigid(model), course)
    tangential = -fx * np.cos(angle) + fy * np.sin(angle)
    chip = tangential / (KT * course.axial_depth_of_cut)
    first = (angle > 0.05) & (angle < WINDOW - 0.05)
    second = (angle > math.pi + 0.05) & (angle < math.pi + WINDOW - 0.05)
    cutting, flying = sorted((np.abs(chip[first]), np.abs(chip[second])), key=lambda chips: -chips.max())
    theta = angle[first] if np.abs(chip[first]).max() > np.abs(chip[second]).max() else angle[second] - math.pi
    assert np.allclose(cutting, 2 * course.feed_per_tooth * np.sin(theta), rtol=1e-6)
    assert flying.max() == 0.0


def test_in_the_long_run_the_chips_add_up_to_the_feed_and_none_is_negative():
    course = cut(3635.0, 2.0e-3, passes=400)
    angle, fx, fy = forces(BOUNDED, course, rate=100_000.0, steps=100, turns=300)
    theta = angle % (2 * math.pi)
    chip = (-fx * np.cos(theta) + fy * np.sin(theta)) / (KT * course.axial_depth_of_cut)
    inside = theta < WINDOW
    assert chip[inside].min() > -1e-12
    assert (chip[inside & (theta > 0.1)] == 0.0).mean() > 0.05
    area = chip[inside].sum() / chip.size * 2 * math.pi
    assert area == pytest.approx(course.feed_per_tooth * (1 - math.cos(WINDOW)), rel=5e-3)
