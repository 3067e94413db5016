"""What the arrays of a run are for its model alone, and for the lag of its helix: worked out once, whatever the cut."""

from __future__ import annotations

import math
import re
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from testbed.effect import HOOKS, Effect
from testbed.engines import fast_kernel as fk
from testbed.engines import loop_kernel as lk
from testbed.engines import plane_kernel as pk
from testbed.engines.compose import Layout
from testbed.engines.grid import Motion, Turn, axial_points, corners_of_pitch, corners_of_turn, motion_of
from testbed.geometry import true_geometry
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from testbed.problem import InputProblem

_PYTHON_HOOKS = ("measure",)
_OF_GEOMETRY = ("immersion", "helix_angle")
_AT_EDGES = ("edge_position", "engagement", "chip", "force_factor", "tangential_force", "normal_force")
_MODE_STATE = re.compile(r"modes\[([1-9]\d*)\]\.(displacement|velocity)")
_REPLACED = [hook for hook, what in HOOKS.items() if what.joins == "replace"]


def active_effects(model: Model, catalogue: Mapping[str, Effect]) -> dict[str, Mapping[str, float]]:
    """The model's effects that are not at their neutral value. KeyError, with the known names, for an unknown one."""
    active: dict[str, Mapping[str, float]] = {}
    for name, given in model.effects.items():
        if name not in catalogue:
            raise KeyError(f"no effect is named '{name}'; known: {', '.join(catalogue)}")
        values = catalogue[name].shaped(given)
        missing = [parameter.name for parameter in catalogue[name].parameters if parameter.name not in values]
        if missing:
            raise KeyError(f"effect {name} lacks {', '.join(missing)}")
        if not catalogue[name].is_neutral(values):
            active[name] = values
    if len(active) < 2:
        return active
    for hook in _REPLACED:
        rivals = [name for name in active if hook in catalogue[name].hooks]
        if len(rivals) > 1:
            raise InputProblem("effects", f"{' and '.join(rivals)} both replace the {hook}", "switch all but one of them off")
    return active


def _touches_loop(effect: Effect) -> bool:
    return any(hook not in (*_PYTHON_HOOKS, *_OF_GEOMETRY) for hook in effect.hooks)


def acts_at_edges(effect: Effect) -> bool:
    """Whether all that an effect does to the loop is done at an edge, in an instant: it remembers and moves nothing."""
    return not effect.states and all(hook in (*_AT_EDGES, *_PYTHON_HOOKS, *_OF_GEOMETRY) for hook in effect.hooks)


_layouts: dict[int, tuple[Mapping[str, Effect], Layout]] = {}


def layout_of(catalogue: Mapping[str, Effect]) -> Layout:
    """The layout of a catalogue, worked out once."""
    known = _layouts.get(id(catalogue))
    if known is None or known[0] is not catalogue or len(known[1].flag) != len(catalogue):
        known = _layouts[id(catalogue)] = (catalogue, Layout(catalogue))
    return known[1]


def state_place(catalogue: Mapping[str, Effect], path: str) -> int:
    """The place in Y of a state by its path: an effect's own, `effect.state`, or that of a mode beyond the first,
    `modes[1].displacement` or `.velocity`. KeyError where there is none."""
    known = layout_of(catalogue).state
    mode = _MODE_STATE.fullmatch(path)
    if mode:
        return 1 + len(known) + 2 * int(mode[1]) + int(mode[2] == "velocity")  # see plane_kernel.mode_place
    effect, _, state = path.partition(".")
    return known[effect, state]


def _geometry(cutter: Cutter, cutting: Cutting, structure: Structure, slices: int, lag: float, corners: np.ndarray,
              slider: tuple[float, float, float]) -> np.ndarray:  # fmt: skip
    """The array G of loop_kernel, but for what `pack` fills in of the cut."""
    values = {
        lk.FLUTES: cutter.flutes,
        lk.PITCH: cutter.pitch,
        lk.RADIUS: cutter.diameter / 2,
        lk.ENTRY: cutting.entry_angle,
        lk.ENGAGED: cutting.engagement_angle,
        lk.SLICES: slices,
        lk.SLICE_LAG: lag / slices,
        lk.KT: cutting.tangential_coefficient,
        lk.KN: cutting.normal_coefficient,
        lk.MASS: structure.mass,
        lk.DAMPING: structure.damping,
        lk.STIFFNESS: structure.stiffness,
    }
    G = np.full(lk.G_SIZE, cutter.pitch)
    G[list(values)] = list(values.values())
    G[lk.T_ENTRY] = 0.0
    G[[lk.SLIDER, lk.SLIDER_PULL, lk.SLIDER_TRAVEL]] = slider
    G[lk.CORNERS : lk.CORNERS + len(corners)] = corners
    return G


def _settings(teeth: list[int], motion: Motion, steady: bool, states: int) -> np.ndarray:
    """The array I of fast_kernel, but for passes and steps; `states`: how many the catalogue's effects have in all."""
    integers = np.zeros(fk.PLAIN + states, dtype=np.int64)
    integers[[fk.EXACT_FLIGHT, fk.STEADY_SPEED]] = motion.exact, steady
    integers[[fk.SEGMENTS, fk.CARRIED, fk.PLAIN_COUNT]] = len(teeth), len(motion.oscillators), len(motion.plain)
    integers[fk.TEETH : fk.TEETH + len(teeth)] = teeth
    integers[fk.PLAIN : fk.PLAIN + len(motion.plain)] = motion.plain
    return integers


# What the grid of a model's cuts follows from: tangent of the helix, diameter (m), flutes, what moves (see `grid.Pace`), and
# whether the edge of an engagement wanders through the grid.
TANGENT, DIAMETER, FLUTES, CARRIED, INTEGRATED, TURNING, OWN, EXACT, STEADY, WANDERS = range(10)


@dataclass(frozen=True)
class OfModel:
    """What `pack` makes of the model alone, whatever the cut."""

    model: Model
    effects: Mapping[str, Effect]
    layout: Layout
    active: Mapping[str, Mapping[str, float]]
    cutter: Cutter
    cutting: Cutting
    A: np.ndarray
    P: np.ndarray
    motion: Motion
    numbers: tuple[float, ...]  # by the places below
    base: bool
    at_edges: bool
    planar: bool
    lags: dict[float, OfLag] = field(default_factory=dict)  # without a helix all depths share one


KEPT = 32  # models, and depths of each under a helix, of which what they are packed from is kept
_of_models: OrderedDict[int, OfModel] = OrderedDict()  # the runs of a sweep, and the records of a fit, share a few
_turn = Lock()


def _mode_numbers(mode: Mode) -> list[float]:
    """What the kernels are told of a mode, see `plane_kernel`."""
    numbers = {pk.SHAPE_X: mode.shape[0], pk.SHAPE_Y: mode.shape[1], pk.MODE_MASS: mode.mass, pk.MODE_DAMPING: mode.damping,
               pk.MODE_STIFFNESS: mode.stiffness, pk.ON_TOOL: float(mode.on == "tool")}  # fmt: skip
    return [numbers[place] for place in range(pk.MODE_SIZE)]


def of_model(model: Model, catalogue: Mapping[str, Effect]) -> OfModel:
    known = _of_models.get(id(model))
    if known is not None and known.model is model and known.layout is layout_of(catalogue) \
            and all(catalogue.get(name) is effect for name, effect in known.effects.items()):
        return known
    layout = layout_of(catalogue)
    active = active_effects(model, catalogue)
    cutter, cutting = true_geometry(model, catalogue) if active else (model.cutter or Cutter(), model.cutting or Cutting())
    planar = model.planar or any(catalogue[name].acts_across(values) for name, values in active.items())
    A, P = np.zeros(max(1, len(catalogue))), np.zeros(layout.parameters)
    for name, values in active.items():
        A[layout.flag[name]] = 1.0
        for parameter in catalogue[name].every_parameter:
            P[layout.parameter[name, parameter.name]] = values[parameter.name]
    if planar:
        P = np.concatenate([P, [len(model.structure.modes)], *map(_mode_numbers, model.structure.modes)])
    A.flags.writeable = P.flags.writeable = False
    motion = motion_of(model.structure, active, catalogue, layout, planar)
    hooks = {hook for name in active for hook in catalogue[name].hooks}
    numbers = {TANGENT: abs(math.tan(cutter.helix_angle)), DIAMETER: cutter.diameter, FLUTES: cutter.flutes,
               CARRIED: motion.rates[0], INTEGRATED: motion.rates[1], TURNING: motion.turning,
               OWN: max(mode.natural_frequency_rad for mode in model.structure.modes), EXACT: motion.exact,
               STEADY: "speed" not in hooks, WANDERS: "engagement" in hooks}  # fmt: skip
    base = not cutter.pitch_angles and not any(_touches_loop(catalogue[name]) for name in active)
    at_edges = not cutter.pitch_angles and all(acts_at_edges(catalogue[name]) for name in active)
    found = OfModel(model, {name: catalogue[name] for name in model.effects}, layout, active, cutter, cutting, A, P, motion,
                     tuple(float(numbers[place]) for place in range(len(numbers))), base, at_edges, planar)
    with _turn:
        _of_models[id(model)] = found
        while len(_of_models) > KEPT:
            _of_models.popitem(last=False)
    return found


def active_names(model: Model, catalogue: Mapping[str, Effect]) -> tuple[str, ...]:
    """Names of the model's effects that are not at their neutral value."""
    return tuple(of_model(model, catalogue).active)


class Kind(NamedTuple):
    """Runs of one kernel agree in it; but where all are of base models, another serves."""

    planar: bool    # moves in the plane
    uneven: bool    # has teeth of unequal pitch
    at_edges: bool  # what effects do is done at the edges
    base: bool


def kind_of(model: Model, catalogue: Mapping[str, Effect]) -> Kind:
    """Which kernels can serve a model."""
    of = of_model(model, catalogue)
    return Kind(of.planar, bool(of.cutter.pitch_angles), of.at_edges, of.base)


@dataclass(frozen=True)
class OfLag:
    """What `pack` makes of a model and the lag of its helix (rad) at one depth, whatever else the cut may be."""

    slices: int
    corners: np.ndarray
    teeth: list[int]
    crossing: float
    turn: Turn | None
    G: np.ndarray
    I: np.ndarray  # noqa: E741


def of_lag(of: OfModel, lag: float) -> OfLag:
    known = of.lags.get(lag)
    if known is not None:
        return known
    cutter, cutting = of.cutter, of.cutting
    slices = axial_points(min(lag, cutting.engagement_angle), any("chip" in of.effects[name].hooks for name in of.active))
    window = cutting.engagement_angle + lag
    crossing = window - cutter.pitch * math.floor(window / cutter.pitch + 1e-9)
    if crossing < 1e-9 * cutter.pitch:
        crossing = cutter.pitch
    turn = corners_of_turn(cutter, cutting, lag) if cutter.pitch_angles else None
    corners, teeth = (turn.corners, turn.teeth) if turn else corners_of_pitch(cutter, cutting, lag)
    kept = 1 if turn else len(teeth)  # in G and I; the grid of a revolution is an array of its own
    found = OfLag(slices, corners, teeth, crossing, turn,
                   _geometry(cutter, cutting, of.model.structure, slices, lag, corners[: kept + 1], of.motion.slider),
                   _settings(teeth[:kept], of.motion, of.numbers[STEADY] > 0, len(of.layout.state)))
    if len(of.lags) >= KEPT:  # a helix under depths drawn at random
        of.lags.clear()
    of.lags[lag] = found
    return found


def each_once(models: Sequence[Model]) -> list[Model]:
    """The models, each once; those of a sweep are one and the same."""
    return list({id(model): model for model in models}.values())


def runs_by(sort: Callable[[Model], Any], models: Sequence[Model]) -> dict[Any, list[int]]:
    """The runs of each sort of model."""
    sorts = {id(model): sort(model) for model in each_once(models)}
    found: dict[Any, list[int]] = {}
    for run, model in enumerate(models):
        found.setdefault(sorts[id(model)], []).append(run)
    return found
