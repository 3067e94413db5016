"""The entry ramp against the geometry of a flat front face and a direct integration."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.catalogue import catalogue
from testbed.machine import Cutting
from tests.effects.direct import KN, KT, MODEL, RADIUS, WINDOW, cut, engine, error, forces, integrate, rigid

ROUNDED = 0.1  # share of the reach
GATE = catalogue()["entry_ramp"].hooks["engagement"]


def opened(theta: float, travel: float, extent: float) -> float:
    """The gate as the regularised incomplete beta function that its polynomial is."""
    from scipy.special import betainc

    highest = math.sin(WINDOW)
    share = travel / (extent * RADIUS * highest)
    return float(betainc(4, 4, min(1.0, max(0.0, (math.sin(theta) / highest - 1 + share) / ROUNDED + 0.5))))


def test_matches_a_direct_integration_with_the_gate_written_out():
    course = cut(passes=14)
    b, h, extent = course.axial_depth_of_cut, course.feed_per_tooth, 0.15

    def force(number, theta, x, v, past):
        share = opened(theta, h * (number + theta / (2 * math.pi)), extent)
        chip = (h + x - past(number - 1, theta)) * math.sin(theta) * share
        return -b * chip * (KT * math.cos(theta) + KN * math.sin(theta))

    expected = integrate(MODEL, course, force, (WINDOW,), tolerance=1e-11)
    assert error(engine(MODEL.with_effect("entry_ramp", extent=extent), course, 320), expected) < 1e-7
    assert error(engine(MODEL, course, 320), expected) > 1e-2


@pytest.mark.parametrize("first, span", [(0.0, WINDOW), (math.pi - WINDOW, WINDOW), (0.0, 2.5), (0.3, math.pi - 0.3)])
def test_half_of_the_edge_of_the_gate_stands_where_the_front_face_is(first, span):
    theta = np.linspace(first, first + span, 20001)
    highest = np.sin(theta).max()
    for travel in (0.2, 0.5, 0.8):
        gate = np.array([GATE(angle - first, first, span, travel * RADIUS * highest, RADIUS, 1.0) for angle in theta])
        # R sin(theta) ahead it meets a face R (1 - travel) sin_m ahead, the edge being rounded
        assert np.all(np.abs(np.sin(theta[np.abs(gate - 0.5) < 0.01]) / highest - (1 - travel)) < 0.01)
        assert gate.min() >= 0.0 and gate.max() <= 1.0 + 1e-12 and (gate.max() - gate.min()) > 0.5


def test_the_ramp_lasts_the_geometric_length_and_leaves_nothing_behind():
    length = RADIUS * math.sin(WINDOW)
    assert length / cut().feed_per_tooth == pytest.approx(80, abs=0.5)
    for phase in (0.0, 0.3, WINDOW):
        assert GATE(phase, 0.0, WINDOW, (1.0001 + 0.5 * ROUNDED) * length, RADIUS, 1.0) == 1.0
        assert GATE(phase, 0.0, WINDOW, 0.0, RADIUS, 1.0) == (0.5 if phase == WINDOW else 0.0)
        assert GATE(phase, 0.0, WINDOW, 0.0, RADIUS, 0.0) == 1.0
    assert GATE(WINDOW, 0.0, WINDOW, 0.3 * length, RADIUS, 1.0) == 1.0  # up-milling starts where it ends later
    assert GATE(0.2, 0.0, WINDOW, 0.3 * length, RADIUS, 1.0) == 0.0
    after = cut(passes=100, initial_displacement=0.0)
    ramp = rigid(MODEL).with_effect("entry_ramp", extent=1.0)
    full = forces(rigid(MODEL), after)[1]  # a structure of 1e9 kg remembers the ramp by some 1e-9 m
    assert np.abs(forces(ramp, after)[1] - full).max() < 1e-6 * np.abs(full).max()


def test_during_the_ramp_down_milling_cuts_first_at_its_entry():
    model = rigid(replace(MODEL, cutting=Cutting("down-milling"))).with_effect("entry_ramp", extent=1.0)
    angle, fx, fy = forces(model, cut(passes=40, initial_displacement=0.0))
    magnitude = np.hypot(fx, fy)
    assert magnitude[(angle > 0.02) & (angle < 0.2 * WINDOW)].min() > 0.0
    assert magnitude[(angle > 0.8 * WINDOW) & (angle < WINDOW)].max() == 0.0
