"""Loops of machines in x and y with effects, linearised: against closed forms, one direction, and semi-discretisation."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from testbed.analysis.linear.linearise import linearise
from testbed.analysis.linear.planar_multipliers import cut_multipliers
from testbed.catalogue import catalogue
from testbed.cut import Cut
from testbed.engines.regenerative_loop import regenerative_loop
from testbed.machine import Cutter, Cutting, Mode, Model, Structure

RPM, Y = 2 * math.pi / 60, math.pi / 2
CATALOGUE = catalogue()
MODES = (Mode(2.5, 146.6, 0.01, math.radians(12)), Mode(1.5, 240.0, 0.015, math.radians(95)),
         Mode(0.6, 520.0, 0.02, math.radians(40), "tool"))
CUTTINGS = {"straight": (Cutter(2, 20e-3), Cutting("down-milling", 0.2, 6e8, 2e8)),
            "helix": (Cutter(3, 20e-3, math.radians(30)), Cutting("up-milling", 0.25, 6e8, 2e8)),
            "teeth together": (Cutter(4, 20e-3), Cutting("down-milling", 0.4, 6e8, 2e8))}


def machine(kind: str, modes: tuple[Mode, ...] = MODES) -> Model:
    return Model(Structure.of(modes), *CUTTINGS[kind])


def loop_multipliers(model: Model, cut: Cut) -> np.ndarray:
    return linearise(regenerative_loop(model, cut, CATALOGUE)).multipliers


@pytest.mark.parametrize("kind", CUTTINGS)
def test_without_effects_it_is_the_linear_answer(kind):
    cut = Cut(3800 * RPM, 0.4e-3, 1e-4)
    wanted, _, passes = cut_multipliers(machine(kind), cut, 1e-9)
    assert passes == 1
    np.testing.assert_allclose(loop_multipliers(machine(kind), cut)[:4], wanted[:4], atol=1e-6 if kind == "helix" else 1e-8)


@pytest.mark.parametrize("name", [name for name, one in CATALOGUE.items() if not one.no_linear_answer and one.smooth])
def test_with_a_mode_that_hardly_moves_it_is_the_answer_along_x(name):
    cut, x = Cut(3400 * RPM, 1e-3, 1e-4), Mode(2.573, 146.6, 0.0032)
    along, both = (machine("straight", modes).with_effect(name, **CATALOGUE[name].example())
                   for modes in ((x,), (x, Mode(1e9, 90.0, 0.2, Y))))
    wanted = loop_multipliers(along, cut)[:2]
    found = loop_multipliers(both, cut)
    assert max(np.abs(found - one).min() for one in wanted) < 1e-6 * max(1.0, abs(wanted[0]))


def semi_discretised(model: Model, cut: Cut, damping: float, steps: int) -> np.ndarray:
    """Multipliers over a tooth pass by steps, the force's law frozen in the middle of each; damping: of the process, N/m."""
    modes, cutter, cutting = model.structure.modes, model.cutter, model.cutting
    shapes, count = np.array([mode.shape for mode in modes]), len(modes)
    mass, omega = np.array([mode.mass for mode in modes]), np.array([mode.natural_frequency_rad for mode in modes])
    ratio = np.array([mode.damping_ratio for mode in modes])
    dt = cutter.pitch / cut.spindle_speed / steps
    total = np.eye(2 * count + 2 * steps)
    for step in range(steps):
        stiff, rubbing = np.zeros((2, 2)), np.zeros((2, 2))
        for tooth in range(cutter.flutes):
            turned = (step + 0.5) / steps * cutter.pitch + tooth * cutter.pitch
            if turned < cutting.engagement_angle:
                sine, cosine = math.sin(cutting.entry_angle + turned), math.cos(cutting.entry_angle + turned)
                tangent, inward, sinks = np.array([-cosine, sine]), np.array([-sine, -cosine]), np.array([sine, cosine])
                law = cutting.tangential_coefficient * tangent + cutting.normal_coefficient * inward
                stiff += cut.axial_depth_of_cut * np.outer(law, sinks)
                speed = cut.spindle_speed * cutter.diameter / 2
                rubbing += damping * cut.axial_depth_of_cut / speed * np.outer(inward, sinks)
        push = shapes / mass[:, None]
        now = np.block([[np.zeros((count, count)), np.eye(count)],
                        [push @ stiff @ shapes.T - np.diag(omega**2),
                         push @ rubbing @ shapes.T - np.diag(2 * ratio * omega)]])
        before = np.vstack([np.zeros((count, 2)), -push @ stiff])
        whole = expm(dt * np.block([[now, before], [np.zeros((2, 2 * count + 2))]]))
        free, driven = whole[: 2 * count, : 2 * count], whole[: 2 * count, 2 * count :]
        one = np.zeros_like(total)
        one[: 2 * count, : 2 * count] = free
        one[: 2 * count, -2:] = 0.5 * driven
        one[: 2 * count, -4:-2] += 0.5 * driven
        one[2 * count : 2 * count + 2, :count] = shapes.T
        one[2 * count + 2 :, 2 * count : -2] = np.eye(2 * steps - 2)
        total = one @ total
    values = np.linalg.eigvals(total)
    return values[np.argsort(-abs(values))]


@pytest.mark.parametrize("kind", ["straight", "teeth together"])
def test_process_damping_by_semi_discretisation(kind):
    cut, damping = Cut(2600 * RPM, 0.5e-3, 1e-4), 4e5
    model = machine(kind).with_effect("process_damping", coefficient=damping)
    found = abs(loop_multipliers(model, cut)[0])
    coarse, fine = (abs(semi_discretised(model, cut, damping, steps)[0]) for steps in (120, 240))
    assert found == pytest.approx(fine, abs=max(2e-4, 2 * abs(fine - coarse)))
    assert abs(found - abs(loop_multipliers(machine(kind), cut)[0])) > 0.01
