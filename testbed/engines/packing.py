"""From a model and a cut to the arrays both engines run on: flags, parameters, geometry, and the grid in spindle angle."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbed.cut import Cut
from testbed.effect import Effect
from testbed.engines import fast_kernel as fk
from testbed.engines import loop_kernel as lk
from testbed.engines.compose import Layout
from testbed.machine import Cutter, Cutting, Model, Structure

POINT_ANGLE = 0.3  # rad of helical lag that one Gauss point more is spent on
STEP_PHASE = 0.15  # rad of the fastest vibration a step may cover
FREE_PHASE = 0.3  # the same where no tooth cuts and the oscillator's exact map carries all but a weak nonlinearity
STEP_ANGLE = 0.12  # rad of tooth travel a step in the cut may cover
_PYTHON_HOOKS = ("measure",)


@dataclass(frozen=True)
class Packed:
    """Arrays of one run: effect flags A, parameters P, geometry G, integer settings I, state Y at time 0."""

    A: np.ndarray
    P: np.ndarray
    G: np.ndarray
    I: np.ndarray  # noqa: E741
    Y: np.ndarray
    base: bool  # True where no effect touches the loop, so that the linear kernel serves


def active_effects(model: Model, catalogue: Mapping[str, Effect]) -> dict[str, Mapping[str, float]]:
    """The model's effects that are not at their neutral value. KeyError, with the known names, for an unknown one."""
    active = {}
    for name, values in model.effects.items():
        if name not in catalogue:
            raise KeyError(f"no effect is named '{name}'; known: {', '.join(catalogue)}")
        missing = [parameter.name for parameter in catalogue[name].parameters if parameter.name not in values]
        if missing:
            raise KeyError(f"effect {name} lacks {', '.join(missing)}")
        if not catalogue[name].is_neutral(values):
            active[name] = values
    return active


def _python_hook(effect: Effect, hook: str, values: Mapping[str, float], **offers: float) -> float:
    wanted = inspect.signature(effect.hooks[hook]).parameters
    known = {**offers, **values}
    return float(effect.hooks[hook](**{name: known[name] for name in wanted}))


def true_geometry(model: Model, catalogue: Mapping[str, Effect]) -> tuple[Cutter, Cutting]:
    """Cutter and engagement after the effects that change them (helix, immersion_error)."""
    cutter, cutting = model.cutter or Cutter(), model.cutting or Cutting()
    for name, values in active_effects(model, catalogue).items():
        effect = catalogue[name]
        if "immersion" in effect.hooks:
            cutting = replace(cutting, immersion=_python_hook(effect, "immersion", values, immersion=cutting.immersion))
        if "helix_angle" in effect.hooks:
            cutter = replace(cutter, helix_angle=_python_hook(effect, "helix_angle", values, helix_angle=cutter.helix_angle))
    return cutter, cutting


def fastest_frequency(model: Model, catalogue: Mapping[str, Effect]) -> float:
    """The highest angular frequency that the structure or an active effect brings in, rad/s."""
    structure = model.structure
    rates = [structure.natural_frequency_rad]
    for name, values in active_effects(model, catalogue).items():
        if "highest_frequency" in catalogue[name].hooks:
            rates.append(
                _python_hook(catalogue[name], "highest_frequency", values, mass=structure.mass, stiffness=structure.stiffness)
            )
    return max(rates)


def _teeth(cutter: Cutter, cutting: Cutting, lag: float) -> tuple[float, int, int]:
    """(angle at which the pitch is split, teeth in the cut before it, teeth after it)."""
    window = cutting.engagement_angle + lag
    over = math.floor(window / cutter.pitch + 1e-9)
    split = window - over * cutter.pitch
    if split < 1e-9 * cutter.pitch:
        return cutter.pitch, over, over
    return split, over + 1, over


def axial_points(lag: float, kinked: bool) -> int:
    """Gauss points along the part of an edge in the cut, lagging by at most `lag` rad; more for a law with a kink."""
    if lag == 0.0:
        return 1
    points = 3 + math.ceil(lag / POINT_ANGLE)
    return min(lk.MOST_POINTS, 2 * points if kinked else points)


def _touches_loop(effect: Effect) -> bool:
    return any(hook not in _PYTHON_HOOKS and hook not in ("immersion", "helix_angle") for hook in effect.hooks)


def _grid(
    steps: int | None,
    split: float,
    cutter: Cutter,
    speed: float,
    fastest: float,
    stepped: bool,
    steady: bool,
    lag: float,
    free_phase: float = STEP_PHASE,
) -> tuple[int, int]:
    """Steps before and after the split of the pitch."""
    rest = cutter.pitch - split
    n_a = steps or max(math.ceil(split / speed * fastest / STEP_PHASE), math.ceil(split / STEP_ANGLE), 6)
    if steps is None and 0.0 < lag < split:  # the force has corners one lag after entry and before exit: step onto them
        n_a = min(range(n_a, 2 * n_a + 1), key=lambda n: abs(n * lag / split - max(1, round(n * lag / split))))
    if rest <= 0.0:
        return n_a, 0
    if not stepped:
        return n_a, 1 if steady else max(8, math.ceil(n_a / 2))
    span = free_phase * speed / fastest if steps is None else split / n_a
    return n_a, max(1, math.ceil(rest / span - 1e-9))


_layouts: dict[int, tuple[Mapping[str, Effect], Layout]] = {}


def _layout(catalogue: Mapping[str, Effect]) -> Layout:
    """The layout of a catalogue, worked out once."""
    known = _layouts.get(id(catalogue))
    if known is None or known[0] is not catalogue or len(known[1].flag) != len(catalogue):
        known = _layouts[id(catalogue)] = (catalogue, Layout(catalogue))
    return known[1]


def _geometry(
    cutter: Cutter, cutting: Cutting, structure: Structure, cut: Cut, slices: int, lag: float, split: float
) -> np.ndarray:
    """The array G of loop_kernel."""
    values = {
        lk.FLUTES: cutter.flutes,
        lk.PITCH: cutter.pitch,
        lk.RADIUS: cutter.diameter / 2,
        lk.ENTRY: cutting.entry_angle,
        lk.ENGAGED: cutting.engagement_angle,
        lk.SLICES: slices,
        lk.SLICE_LAG: lag / slices,
        lk.SLICE_COVER: lag / slices,
        lk.SLICE_DEPTH: cut.axial_depth_of_cut / slices,
        lk.KT: cutting.tangential_coefficient,
        lk.KN: cutting.normal_coefficient,
        lk.FEED: cut.feed_per_tooth,
        lk.FEED_SPEED: cut.feed_per_tooth / cut.tooth_passing_period(cutter.flutes),
        lk.OMEGA: cut.spindle_speed,
        lk.LENGTH_BEFORE: cut.length_cut_before,
        lk.SPLIT: split,
        lk.MASS: structure.mass,
        lk.DAMPING: structure.damping,
        lk.STIFFNESS: structure.stiffness,
    }
    return np.array([values.get(place, 0.0) for place in range(lk.G_SIZE)])


def pack(
    model: Model, cut: Cut, catalogue: Mapping[str, Effect], steps: int | None = None, measured_clock: bool = False
) -> Packed:
    """Arrays for one run. `steps` is the number of steps while the leading tooth crosses the split; None chooses it."""
    layout = _layout(catalogue)
    active = active_effects(model, catalogue)
    cutter, cutting = true_geometry(model, catalogue) if active else (model.cutter or Cutter(), model.cutting or Cutting())
    structure, depth = model.structure, cut.axial_depth_of_cut
    A, P = np.zeros(max(1, len(catalogue))), np.zeros(max(1, len(layout.parameter)))
    for name, values in active.items():
        A[layout.flag[name]] = 1.0
        for parameter in catalogue[name].parameters:
            P[layout.parameter[name, parameter.name]] = values[parameter.name]
    lag = 2.0 * depth * abs(math.tan(cutter.helix_angle)) / cutter.diameter
    slices = axial_points(min(lag, cutting.engagement_angle), any("chip" in catalogue[name].hooks for name in active))
    split, teeth_a, teeth_b = _teeth(cutter, cutting, lag)
    hooks = {hook for name in active for hook in catalogue[name].hooks}
    steady = "speed" not in hooks
    states = any(catalogue[name].states for name in active)
    linear = not states and "structure_force" not in hooks
    stepped = not linear or teeth_b > 0
    fastest = fastest_frequency(model, catalogue) * (1.0 if steady else 2.0)  # the classical scheme gathers phase error
    weak = steady and not states and teeth_b == 0
    n_a, n_b = _grid(steps, split, cutter, cut.spindle_speed, fastest, stepped, steady, lag, FREE_PHASE if weak else STEP_PHASE)
    G = _geometry(cutter, cutting, structure, cut, slices, lag, split)
    settings = {
        fk.N_A: n_a,
        fk.N_B: n_b,
        fk.TEETH_A: teeth_a,
        fk.TEETH_B: teeth_b,
        fk.IDLE: cut.idle_passes,
        fk.CUT: cut.passes,
        fk.RING_DOWN: cut.ring_down_passes,
        fk.LINEAR: linear,
        fk.STATES_ON: states,
        fk.STEADY_SPEED: steady,
    }
    integers = np.array([settings[place] for place in range(fk.I_SIZE)], dtype=np.int64)
    Y = np.zeros(3 + len(layout.state))
    Y[:2] = cut.initial_displacement, cut.initial_velocity
    base = not measured_clock and not any(_touches_loop(catalogue[name]) for name in active)
    return Packed(A, P, G, integers, Y, base)
