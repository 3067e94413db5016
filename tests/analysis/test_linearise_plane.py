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
PITCHES = tuple(math.radians(angle) for angle in (70, 110, 85, 95))
HELD_SLOWLY = ("entry_ramp", "tool_wear")  # change from tooth to tooth: their answers hold for the first pass, or revolution
ELSEWHERE = ("speed_variation", "contact_loss")  # a test of its own; unequal teeth let go for a moment where the chip ends
MODES = (Mode(2.5, 146.6, 0.01, math.radians(12)), Mode(1.5, 240.0, 0.015, math.radians(95)),
         Mode(0.6, 520.0, 0.02, math.radians(40), "tool"))
CUTTINGS = {"straight": (Cutter(2, 20e-3), Cutting("down-milling", 0.2, 6e8, 2e8)),
            "helix": (Cutter(3, 20e-3, math.radians(30)), Cutting("up-milling", 0.25, 6e8, 2e8)),
            "teeth together": (Cutter(4, 20e-3), Cutting("down-milling", 0.4, 6e8, 2e8)),
            "unequal pitch": (Cutter(4, 20e-3, 0.0, PITCHES), Cutting("up-milling", 0.4, 6e8, 2e8)),
            "unequal pitch, helix": (Cutter(4, 20e-3, math.radians(30), PITCHES), Cutting("down-milling", 0.2, 6e8, 2e8))}


def machine(kind: str, modes: tuple[Mode, ...] = MODES) -> Model:
    return Model(Structure.of(modes), *CUTTINGS[kind])


def loop_multipliers(model: Model, cut: Cut) -> np.ndarray:
    return linearise(regenerative_loop(model, cut, CATALOGUE)).multipliers


@pytest.mark.parametrize("kind", CUTTINGS)
def test_without_effects_it_is_the_linear_answer(kind):
    cut = Cut(3800 * RPM, 0.4e-3, 1e-4)
    wanted, _, passes = cut_multipliers(machine(kind), cut, 1e-9)
    assert passes == len(CUTTINGS[kind][0].pitch_angles) or passes == 1
    np.testing.assert_allclose(loop_multipliers(machine(kind), cut)[:4], wanted[:4], atol=1e-6 if kind == "helix" else 1e-8)


@pytest.mark.parametrize("name", [name for name, one in CATALOGUE.items() if not one.no_linear_answer and one.smooth])
def test_with_a_mode_that_hardly_moves_it_is_the_answer_along_x(name):
    cut, x = Cut(3400 * RPM, 1e-3, 1e-4), Mode(2.573, 146.6, 0.0032)
    along, both = (machine("straight", modes).with_effect(name, **CATALOGUE[name].example())
                   for modes in ((x,), (x, Mode(1e9, 90.0, 0.2, Y))))
    wanted = loop_multipliers(along, cut)[:2]
    found = loop_multipliers(both, cut)
    assert max(np.abs(found - one).min() for one in wanted) < 1e-6 * max(1.0, abs(wanted[0]))


def of_even_and_uneven_teeth(name: str, **values: float) -> tuple:
    """The motion of three teeth of one pitch, and of pitches that hardly differ, linearised with an effect."""
    third, slip, found = 2 * math.pi / 3, 1e-5, []
    for pitches in ((), (third + slip, third - 2 * slip, third + slip)):
        model = Model(Structure.of(MODES[:2]), Cutter(3, 20e-3, 0.3, pitches), CUTTINGS["helix"][1]).with_effect(name, **values)
        found.append(linearise(regenerative_loop(model, Cut(3400 * RPM, 0.4e-3, 1e-4), CATALOGUE)))
    return tuple(found)


@pytest.mark.parametrize("name", [name for name, one in CATALOGUE.items()
                                  if not one.no_linear_answer and name not in HELD_SLOWLY + ELSEWHERE])
def test_with_pitches_that_hardly_differ_it_is_the_answer_of_one_pitch(name):
    one, turn = of_even_and_uneven_teeth(name, **CATALOGUE[name].example())
    assert turn.passes == 3
    for wanted in one.multipliers[:2] ** (3 // one.passes):
        assert np.abs(turn.multipliers - wanted).min() < 1e-8


def test_a_speed_that_varies_over_unequal_pitches():
    """The variation takes three revolutions; the speed is a course that the teeth meet at their own angles."""
    one, turn = of_even_and_uneven_teeth("speed_variation", amplitude=0.1, frequency=3400 / 60 / 3, phase=0.3)
    assert one.passes == turn.passes == 9 and turn.mismatch < 1e-6
    assert np.abs(turn.multipliers - one.multipliers[0]).min() < 1e-6 * abs(one.multipliers[0])


def semi_discretised(model: Model, cut: Cut, damping: float, steps: int) -> np.ndarray:
    """Multipliers over a revolution of so many steps, the law frozen in the middle of each; damping: of the process, N/m.

    Pitch and engagement are whole numbers of steps.
    """
    modes, cutter, cutting = model.structure.modes, model.cutter, model.cutting
    shapes, count = np.array([mode.shape for mode in modes]), len(modes)
    mass, omega = np.array([mode.mass for mode in modes]), np.array([mode.natural_frequency_rad for mode in modes])
    ratio, push = np.array([mode.damping_ratio for mode in modes]), shapes / mass[:, None]
    dt, enters = 2 * math.pi / cut.spindle_speed / steps, np.cumsum((0.0, *cutter.pitches[1:]))
    total, free = np.eye(2 * count + 2 * steps), np.zeros((2 * count, 2 * count))
    free[:count, count:], free[count:, :count] = np.eye(count), -np.diag(omega**2)
    free[count:, count:] = -np.diag(2 * ratio * omega)
    for step in range(steps):
        now, drives, met = free.copy(), [], []
        for enter, pitch in zip(enters, cutter.pitches, strict=True):
            turned = ((step + 0.5) / steps * 2 * math.pi - enter) % (2 * math.pi)
            if turned < cutting.engagement_angle:
                sine, cosine = math.sin(cutting.entry_angle + turned), math.cos(cutting.entry_angle + turned)
                tangent, inward, sinks = np.array([-cosine, sine]), np.array([-sine, -cosine]), np.array([sine, cosine])
                law = cutting.tangential_coefficient * tangent + cutting.normal_coefficient * inward
                stiff = push @ np.outer(law, sinks) * cut.axial_depth_of_cut
                speed = cut.spindle_speed * cutter.diameter / 2
                now[count:, :count] += stiff @ shapes.T
                now[count:, count:] += push @ np.outer(inward, sinks) @ shapes.T * damping * cut.axial_depth_of_cut / speed
                last = 2 * count + 2 * round(pitch / (2 * math.pi) * steps)  # row behind the motion one pitch ago
                drives.append(np.vstack([np.zeros((count, 2)), -stiff]))
                met.append(0.5 * (total[last - 2 : last] + total[last - 4 : last - 2]))
        inputs = np.hstack([np.zeros((2 * count, 0)), *drives])
        whole = expm(dt * np.vstack([np.hstack([now, inputs]), np.zeros((inputs.shape[1], 2 * count + inputs.shape[1]))]))
        moved = whole[: 2 * count] @ np.vstack([total[: 2 * count], *met])
        total = np.vstack([moved, shapes.T @ total[:count], total[2 * count : -2]])
    values = np.linalg.eigvals(total)
    return values[np.argsort(-abs(values))]


@pytest.mark.parametrize("kind", ["straight", "teeth together", "unequal pitch"])
def test_process_damping_by_semi_discretisation(kind):
    cut, damping = Cut(2600 * RPM, 0.5e-3, 1e-4), 4e5
    model = machine(kind).with_effect("process_damping", coefficient=damping)
    motion, flutes = linearise(regenerative_loop(model, cut, CATALOGUE)), model.cutter.flutes
    found = abs(motion.multipliers[0]) ** (flutes // motion.passes)
    assert found == pytest.approx(abs(semi_discretised(model, cut, damping, 360)[0]), abs=5e-4)  # a step's own error
    assert abs(found - abs(loop_multipliers(machine(kind), cut)[0]) ** (flutes // motion.passes)) > 0.01
