"""The grid in the spindle angle: where the pitch is cut into segments, what moves in a run, and how many steps that takes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from testbed.effect import Effect, arguments_of, hook_value
from testbed.engines import loop_kernel as lk
from testbed.engines.compose import Layout
from testbed.machine import Cutter, Cutting, Structure

POINT_ANGLE = 0.3  # rad of helical lag that one Gauss point more is spent on
STEP_PHASE = 0.15  # rad of the structure's vibration, or of a law's own, that a step in the cut may cover
CARRIED_PHASE = 0.3  # rad of a carried oscillator's vibration that a step in the cut may cover
FREE_PHASE = 0.3  # rad of the structure's vibration that a step outside the cut may cover: only a weak rest is integrated
STEP_ANGLE = 0.12  # rad of tooth travel a step in the cut may cover
FLOWN = 8  # parts of a free flight at a varying speed, at the least: its time alone is integrated
MOST_STEPS = 2.0**60  # in a segment: beyond it a whole number has no room, after what is made of it


def corners_of_pitch(cutter: Cutter, cutting: Cutting, lag: float) -> tuple[np.ndarray, list[int]]:
    """(angles that cut the pitch where the force is not smooth, 0 and the pitch among them; teeth in the cut between them).

    The leading tooth's tip enters at 0, its top after `lag`; a tip leaves at the engagement angle, a top `lag` later.
    """
    pitch, engaged = cutter.pitch, cutting.engagement_angle
    corners = [0.0]
    for corner in sorted(angle - pitch * math.floor(angle / pitch + 1e-9) for angle in (lag, engaged, engaged + lag)):
        if corners[-1] + 1e-9 * pitch < corner:
            corners.append(corner)
    corners.append(pitch)
    teeth = [math.ceil((engaged + lag - 0.5 * (low + high)) / pitch) for low, high in pairwise(corners)]
    return np.array(corners), teeth


@dataclass(frozen=True)
class Turn:
    """The grid of a revolution under teeth of unequal pitch.

    corners (segments + 1,), rad: where the force is not smooth, or a surface that is read; mean pitches among them. teeth:
    how many are in the cut in each segment; firsts (flutes + 1,): the first segment of each mean pitch. tooth (flutes, 2):
    where each enters, and by which angle it follows the one before. steps (segments,) where they are chosen.
    """

    corners: np.ndarray
    teeth: list[int]
    firsts: np.ndarray
    tooth: np.ndarray
    steps: np.ndarray | None = None


def corners_of_turn(cutter: Cutter, cutting: Cutting, lag: float) -> Turn:
    """The grid of a revolution that begins where the first tooth enters."""
    whole, window = 2.0 * math.pi, cutting.engagement_angle + lag
    follows = np.array(cutter.pitches)
    enters = np.concatenate([[0.0], np.cumsum(follows[1:])])

    def inside(angle: float) -> np.ndarray:
        return (angle - enters) % whole < window

    own = [(enter + corner) % whole for enter in enters for corner in (0.0, lag, cutting.engagement_angle, window)]
    # about a corner of the motion one pitch before; a margin, so that none is lost at the very edge of a tooth's cut
    read = [(corner + pitch) % whole for corner in own for pitch, enter in zip(follows, enters, strict=True)
            if (corner + pitch - enter + 1e-6) % whole < window + 2e-6]  # fmt: skip
    means = [cutter.pitch * place for place in range(cutter.flutes)]
    corners = list(means)
    for angle in sorted(own + read):
        if min((abs((angle - corner + math.pi) % whole - math.pi) for corner in corners), default=1.0) > 1e-9:
            corners.append(angle)
    corners = [*sorted(corners), whole]
    teeth = [int(inside(0.5 * (low + high)).sum()) for low, high in pairwise(corners)]
    firsts = np.array([corners.index(mean) for mean in means] + [len(teeth)])
    return Turn(np.array(corners), teeth, firsts, np.column_stack([enters, follows]))


def axial_points(lag: float, kinked: bool) -> int:
    """Gauss points along the part of an edge in the cut, lagging by at most `lag` rad; more for a law with a kink."""
    if lag == 0.0:
        return 1
    points = 3 + math.ceil(lag / POINT_ANGLE)
    return min(lk.MOST_POINTS, 2 * points if kinked else points)


@dataclass(frozen=True)
class Motion:
    """What moves in a run: oscillators O, places of the other states, whether all is carried exactly in free flight.

    rates: angular frequencies (rad/s) of what is carried exactly, and of what is integrated (0 where nothing is).
    slider: what holds the structure besides (see `loop_kernel`): place of the deflection, pull, travel; or zeros.
    turning: the highest angular frequency (rad/s) of laws that rule the spindle's speed.
    """

    oscillators: np.ndarray
    plain: list[int]
    exact: bool
    rates: tuple[float, float]
    slider: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turning: float = 0.0


def _at_rest(effect: Effect, structure: Structure) -> dict[str, float]:
    """What the hooks of an effect are offered where nothing moves and nothing acts."""
    return dict.fromkeys(effect.states, 0.0) | {
        "applied_force": 0.0, "applied_force_y": 0.0, "torque": 0.0, "displacement": 0.0, "velocity": 0.0,
        "displacement_y": 0.0, "velocity_y": 0.0, "time": 0.0,
        "mass": structure.mass, "stiffness": structure.stiffness, "damping": structure.damping}  # fmt: skip


def _slider(effect: Effect, values: Mapping[str, float], structure: Structure, layout: Layout) -> tuple[float, float, float]:
    """(place in the state, pull, travel) of an effect that is a spring and slider in series."""
    assert effect.slider is not None
    state, parameter = effect.slider
    force = -hook_value(effect, "structure_force", values, **(_at_rest(effect, structure) | {state: values[parameter]}))
    return float(layout.state[effect.name, state]), force / (structure.mass * values[parameter]), values[parameter]


def _oscillators(effect: Effect, values: Mapping[str, float], structure: Structure) -> list[tuple[str, float, float]]:
    """(first state, pull, drag) of each pair of states that is an underdamped oscillator at these values."""
    found, still = [], _at_rest(effect, structure)
    for position, rate in effect.oscillators:
        pull = -hook_value(effect, f"derivative_{rate}", values, **(still | {position: 1.0}))
        drag = -hook_value(effect, f"derivative_{rate}", values, **(still | {rate: 1.0}))
        if pull > 0.25 * drag * drag:
            found.append((position, pull, drag))
    return found


def motion_of(structure: Structure, active: Mapping[str, Mapping[str, float]], catalogue: Mapping[str, Effect],
            layout: Layout, planar: bool = False) -> Motion:  # fmt: skip
    """Sort the states of the active effects into oscillators and others.

    planar: the structure moves in the plane. A slider is then integrated: it holds the motion along x, which is no coordinate.
    """
    plain: list[int] = []
    behind = 3 + len(layout.state)  # the effects' states; see `plane_kernel`
    rows = [(float(behind + 2 * (place - 1) if place else 0), mode.stiffness / mode.mass, mode.damping / mode.mass)
            for place, mode in enumerate(structure.modes)]  # fmt: skip
    exact, carried, integrated, turning = True, max(mode.natural_frequency_rad for mode in structure.modes), 0.0, 0.0
    sliders = [] if planar else [name for name in active if catalogue[name].slider is not None]
    for name, values in active.items():
        effect = catalogue[name]
        pairs = _oscillators(effect, values, structure)
        places = {layout.state[name, state] for state in effect.states}
        for position, pull, drag in pairs:
            place = layout.state[name, position]
            rows.append((place, pull, drag))
            places -= {place, place + 1}
            carried = max(carried, math.sqrt(pull))
        plain += sorted(places)
        reads_states = not {*effect.states}.isdisjoint(arguments_of(effect, "speed"))
        alone = not places and "structure_force" not in effect.hooks or sliders == [name]
        exact = exact and alone and not reads_states
        if "highest_frequency" in effect.hooks and (places or not pairs):
            rate = hook_value(effect, "highest_frequency", values, mass=structure.mass, stiffness=structure.stiffness)
            integrated, turning = max(integrated, rate), max(turning, rate if "speed" in effect.hooks else 0.0)
    motion = Motion(np.array(rows, dtype=float), plain, exact, (carried, integrated), turning=turning)
    if not exact or not sliders:
        return motion
    return replace(motion, slider=_slider(catalogue[sliders[0]], active[sliders[0]], structure, layout))


@dataclass(frozen=True)
class Pace:
    """What asks for short steps, of runs side by side, each (runs, 1), and the segments they are taken in (runs, segments).

    carried, integrated, turning: rad/s, see Motion; structure: the highest of its modes alone, rad/s; speed: of the spindle,
    rad/s; crossing: how far the leading tooth turns through its cut, rad; exact, steady: whether free flight is one map, and
    whether the speed is one and the same. lengths, rad; teeth in the cut.
    """

    carried: np.ndarray
    integrated: np.ndarray
    turning: np.ndarray
    structure: np.ndarray
    speed: np.ndarray
    crossing: np.ndarray
    exact: np.ndarray
    steady: np.ndarray
    lengths: np.ndarray
    teeth: np.ndarray


def steps_of_segments(steps: int | None, pace: Pace) -> np.ndarray:
    """Steps of each segment, shape (runs, segments). OverflowError where no number of steps would do."""
    cutting, speed = pace.teeth > 0, pace.speed
    with np.errstate(over="ignore", invalid="ignore"):
        if steps:
            dense = free = steps / pace.crossing
            turned = 0.25 * dense
        else:
            timed = np.maximum(np.maximum(pace.structure / STEP_PHASE, pace.carried / CARRIED_PHASE),
                               np.maximum(pace.turning / STEP_PHASE, speed / STEP_ANGLE)) / speed
            dense = np.maximum(timed, pace.integrated / STEP_PHASE / speed)
            free = np.maximum(pace.carried / FREE_PHASE, pace.integrated / STEP_PHASE) / speed
            turned = pace.turning / STEP_PHASE / speed
        least = 1 if steps else np.ceil(6 / np.maximum(1, cutting.sum(axis=1, keepdims=True)))
        stepped = np.maximum(np.where(cutting, least, 1), np.ceil(pace.lengths * np.where(cutting, dense, free) - 1e-9))
        # one exact map; at a varying speed the time it takes is integrated, however fast the structure is
        flown = np.where(pace.steady, 1, np.maximum(FLOWN, np.ceil(pace.lengths * turned)))
        found = np.where(cutting | ~pace.exact, stepped, flown)
    if not (found < MOST_STEPS).all():
        raise OverflowError("steps without number")
    return found.astype(np.int64)
