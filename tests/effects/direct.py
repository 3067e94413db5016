"""Direct integration of one mode under a cut by scipy, pass by pass: the second road for the effects' tests.

Shares no code with the engines. A test writes down its own force; this file only knows that a pass consists of smooth
pieces, and remembers the motion of the passes before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp

from testbed.cut import Cut
from testbed.engines import fast
from testbed.machine import Cutter, Cutting, Model, Structure

MODEL = Model(Structure(2.573, 920.0 / (2.0 * math.pi), 0.0032), Cutter(), Cutting())
KT, KN = MODEL.cutting.tangential_coefficient, MODEL.cutting.normal_coefficient
WINDOW = MODEL.cutting.engagement_angle
RADIUS = MODEL.cutter.diameter / 2
Force = Callable[[int, float, float, float, Callable[[int, float], float]], float]


def cut(rpm: float = 3810.0, depth: float = 2.0e-3, **course: float) -> Cut:
    """A short cut with a start that is not at rest."""
    return Cut(rpm * 2 * math.pi / 60, depth, **{"passes": 12, "initial_displacement": 2e-5, **course})


def integrate(model: Model, course: Cut, force: Force, breaks: Sequence[float], period: float | None = None,
              tolerance: float = 1e-12) -> np.ndarray:
    """States (passes + 1, 2) at the start of each pass under `force(pass, turned, x, v, past)`, N.

    turned: spindle angle since the pass began, rad; past(k, turned): displacement of pass k at that angle, 0 before the
    first. breaks: angles between which the force is smooth; after the last nothing cuts. period: rad a pass.
    """
    structure, speed = model.structure, course.spindle_speed
    m, c, k = structure.mass, structure.damping, structure.stiffness
    pitch = 2.0 * math.pi / model.cutter.flutes if period is None else period
    memory: list[list[tuple[float, float, Callable]]] = []

    def past(number: int, turned: float) -> float:
        if number < 0:
            return 0.0
        for first, last, motion in memory[number]:
            if turned <= last:
                return float(motion(max(first, turned))[0])
        return float(memory[number][-1][2](turned)[0])

    state = np.array([course.initial_displacement, course.initial_velocity])
    states = [state]
    for number in range(course.passes):
        memory.append([])
        for first, last in zip((0.0, *breaks), (*breaks, pitch), strict=True):
            if last - first < 1e-12:
                continue
            cutting = last <= breaks[-1]

            def rate(turned, y, number=number, cutting=cutting):
                load = force(number, turned, y[0], y[1], past) if cutting else 0.0
                return [y[1] / speed, (load - c * y[1] - k * y[0]) / m / speed]

            found = solve_ivp(rate, (first, last), state, "DOP853", rtol=tolerance, atol=1e-18, dense_output=True,
                              max_step=(last - first) / 8)
            memory[-1].append((first, last, found.sol))
            state = found.y[:, -1]
        states.append(state)
    return np.array(states)


def engine(model: Model, course: Cut, steps: int | None = 80) -> np.ndarray:
    """The fast engine's states (passes + 1, 2) at the start of each pass."""
    from testbed.cut import whole_cut_sampling

    sampling = whole_cut_sampling(course, model.cutter.flutes, 1000.0)
    result = fast.simulate_batch([model], [course], [sampling], steps=steps)
    assert result.outcome[0] == 0
    return result.pass_states[0]


def error(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference of the displacements, in peaks of the expected ones."""
    assert np.ptp(expected[:, 0]) > 1e-7
    return float(np.abs(found[:, 0] - expected[:, 0]).max() / np.abs(expected[:, 0]).max())


def rigid(model: Model) -> Model:
    """The same machine on a structure that hardly gives: the force of the geometry alone."""
    from dataclasses import replace

    return replace(model, structure=Structure(1.0e9, 50.0, 0.01))


def forces(model: Model, course: Cut, rate: float = 400_000.0, steps: int = 200,
           turns: int = 1) -> tuple[np.ndarray, ...]:
    """(angle since the last revolution began, F_x, F_y) over the last `turns` revolutions of a cut, N."""
    from testbed.cut import Sampling

    period = 2 * math.pi / course.spindle_speed
    total = course.passes * period / model.cutter.flutes
    sampling = Sampling(rate, int(turns * period * rate), total - turns * period + 1e-9)
    record = fast.simulate(model, course, sampling, channels=("force_x", "force_y", "spindle_angle"), steps=steps)
    angle = record.channels["spindle_angle"] % (2 * math.pi * turns)
    order = np.argsort(angle)
    return angle[order], record.channels["force_x"][order], record.channels["force_y"][order]
