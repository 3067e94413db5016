"""From a model and a cut to the arrays both engines run on: flags, parameters, geometry, and the grid in spindle angle."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from threading import Lock

import numpy as np

from testbed.cut import Cut
from testbed.effect import HOOKS, Effect
from testbed.engines import fast_kernel as fk
from testbed.engines import loop_kernel as lk
from testbed.engines import plane_kernel as pk
from testbed.engines.compose import Layout
from testbed.engines.grid import Motion, Turn, axial_points, corners_of_pitch, corners_of_turn, motion_of, steps_of_segments
from testbed.geometry import true_geometry
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from testbed.problem import InputProblem

_PYTHON_HOOKS = ("measure",)
GATED = 2  # times as many steps in the cut where the edge of an engagement wanders through it


@dataclass(frozen=True)
class Packed:
    """Arrays of one run: effect flags A, parameters P, geometry G, integer settings I, oscillators O, state Y at time 0.

    O (rows, 3) is described in `oscillator_kernel`; its first I[CARRIED] rows are in use.
    """

    A: np.ndarray
    P: np.ndarray
    G: np.ndarray
    I: np.ndarray  # noqa: E741
    O: np.ndarray  # noqa: E741
    Y: np.ndarray
    base: bool  # True where no effect touches the loop of one mode along the feed, so that the linear kernel serves
    modes: int  # of the structure
    planar: bool  # True where it takes the kernels of motion in the plane
    crossing: float  # rad the leading tooth turns through its cut, what whole pitches leave of it
    turn: Turn | None = None  # the grid of a revolution, where teeth are of unequal pitch

    @property
    def states_on(self) -> bool:
        """Whether an active effect has states of its own."""
        return bool(self.I[fk.CARRIED] > self.modes or self.I[fk.PLAIN_COUNT] > 0)

    @property
    def steps_of_pass(self) -> int:
        """How many steps one tooth pass takes."""
        return int(self.I[fk.STEPS : fk.STEPS + self.I[fk.SEGMENTS]].sum())

    @property
    def nominal_pass(self) -> float:
        """How long a tooth pass lasts at the nominal spindle speed, s."""
        return float(self.G[lk.PITCH] / self.G[lk.OMEGA])


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
    for hook, what in HOOKS.items():
        rivals = [name for name in active if what.joins == "replace" and hook in catalogue[name].hooks]
        if len(rivals) > 1:
            raise InputProblem("effects", f"{' and '.join(rivals)} both replace the {hook}", "switch all but one of them off")
    return active


def _touches_loop(effect: Effect) -> bool:
    return any(hook not in _PYTHON_HOOKS and hook not in ("immersion", "helix_angle") for hook in effect.hooks)


_layouts: dict[int, tuple[Mapping[str, Effect], Layout]] = {}


def _layout(catalogue: Mapping[str, Effect]) -> Layout:
    """The layout of a catalogue, worked out once."""
    known = _layouts.get(id(catalogue))
    if known is None or known[0] is not catalogue or len(known[1].flag) != len(catalogue):
        known = _layouts[id(catalogue)] = (catalogue, Layout(catalogue))
    return known[1]


def state_place(catalogue: Mapping[str, Effect], path: str) -> int:
    """The place in Y of an effect's own state, by its path `effect.state`. KeyError where there is none."""
    effect, _, state = path.partition(".")
    return _layout(catalogue).state[effect, state]


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
    G = np.array([values.get(place, cutter.pitch) for place in range(lk.G_SIZE)])
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


@dataclass(frozen=True)
class _OfModel:
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
    steady: bool
    base: bool
    planar: bool
    lags: dict[float, _OfLag] = field(default_factory=dict)  # without a helix all depths share one


KEPT = 32  # models, and depths of each under a helix, of which what they are packed from is kept
_of_models: OrderedDict[int, _OfModel] = OrderedDict()  # the runs of a sweep, and the records of a fit, share a few
_turn = Lock()


def _mode_numbers(mode: Mode) -> list[float]:
    """What the kernels are told of a mode, see `plane_kernel`."""
    numbers = {pk.SHAPE_X: mode.shape[0], pk.SHAPE_Y: mode.shape[1], pk.MODE_MASS: mode.mass, pk.MODE_DAMPING: mode.damping,
               pk.MODE_STIFFNESS: mode.stiffness, pk.ON_TOOL: float(mode.on == "tool")}  # fmt: skip
    return [numbers[place] for place in range(pk.MODE_SIZE)]


def _of_model(model: Model, catalogue: Mapping[str, Effect]) -> _OfModel:
    known = _of_models.get(id(model))
    if known is not None and known.model is model and known.layout is _layout(catalogue) \
            and all(catalogue.get(name) is effect for name, effect in known.effects.items()):
        return known
    layout = _layout(catalogue)
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
    found = _OfModel(model, {name: catalogue[name] for name in model.effects}, layout, active, cutter, cutting, A, P,
                     motion_of(model.structure, active, catalogue, layout, planar),
                     not any("speed" in catalogue[name].hooks for name in active),
                     not planar and not any(_touches_loop(catalogue[name]) for name in active), planar)
    with _turn:
        _of_models[id(model)] = found
        while len(_of_models) > KEPT:
            _of_models.popitem(last=False)
    return found


def active_names(model: Model, catalogue: Mapping[str, Effect]) -> tuple[str, ...]:
    """Names of the model's effects that are not at their neutral value."""
    return tuple(_of_model(model, catalogue).active)


def stacked(packed: Sequence[Packed]) -> tuple[np.ndarray, ...]:
    """Runs side by side: the arrays A, P, G, I, O, Y with one axis more, padded with zeros to the most modes."""
    return tuple(_stack([getattr(one, name) for one in packed]) for name in "APGIOY")


def _stack(arrays: Sequence[np.ndarray]) -> np.ndarray:
    most = max(len(one) for one in arrays)
    if all(len(one) == most for one in arrays):
        return np.ascontiguousarray(arrays)
    found = np.zeros((len(arrays), most, *arrays[0].shape[1:]), arrays[0].dtype)
    for row, one in zip(found, arrays, strict=True):
        row[: len(one)] = one
    return found


@dataclass(frozen=True)
class _OfLag:
    """What `pack` makes of a model and the lag of its helix (rad) at one depth, whatever else the cut may be."""

    slices: int
    corners: np.ndarray
    teeth: list[int]
    crossing: float
    turn: Turn | None
    G: np.ndarray
    I: np.ndarray  # noqa: E741
    steps: dict[tuple[float, int | None, float, int], list[int]] = field(default_factory=dict)  # of segments, see _steps


def _of_lag(of: _OfModel, lag: float) -> _OfLag:
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
    found = _OfLag(slices, corners, teeth, crossing, turn,
                   _geometry(cutter, cutting, of.model.structure, slices, lag, corners[: kept + 1], of.motion.slider),
                   _settings(teeth[:kept], of.motion, of.steady, len(of.layout.state)))
    if len(of.lags) >= KEPT:  # a helix under depths drawn at random
        of.lags.clear()
    of.lags[lag] = found
    return found


def _steps(of: _OfModel, tooth: _OfLag, speed: float, steps: int | None, stiffening: float, refinement: int) -> list[int]:
    """How many steps each segment has; the arguments are those of `pack`."""
    key = (speed, steps, stiffening, refinement)
    known = tooth.steps.get(key)
    if known is not None:
        return known
    motion, own = of.motion, max(mode.natural_frequency_rad for mode in of.model.structure.modes)
    if stiffening > 1.0:
        carried, integrated = motion.rates
        # squared: the frequency grows, and so does the share of the force that is integrated and not carried exactly
        motion = replace(motion, rates=(carried, max(integrated, stiffening**2 * own)))
    if tooth.turn and not of.steady:
        motion = replace(motion, exact=False)  # free flight is stepped through, as the speed needs it
    chosen = steps_of_segments(steps, tooth.corners, tooth.teeth, tooth.crossing, speed, own, motion, of.steady)
    gated = not steps and any("engagement" in of.effects[name].hooks for name in of.active)
    found = [refinement * (GATED if gated and teeth else 1) * count for count, teeth in zip(chosen, tooth.teeth, strict=True)]
    if tooth.turn:
        found = [max(2, count) for count in found]  # a surface is read from four rows
    if len(tooth.steps) >= KEPT:  # a speed that is searched
        tooth.steps.clear()
    tooth.steps[key] = found
    return found


def pack(
    model: Model,
    cut: Cut,
    catalogue: Mapping[str, Effect],
    steps: int | None = None,
    measured_clock: bool = False,
    stiffening: float = 1.0,
    refinement: int = 1,
) -> Packed:
    """Arrays for one run. `steps`: how many while the leading tooth crosses its cut; None chooses.

    refinement: how many times as many steps as that.
    stiffening: the highest frequency of the structure in this motion over its natural one, for the choice of steps.
    """
    of = _of_model(model, catalogue)
    depth, speed, feed = cut.axial_depth_of_cut, cut.spindle_speed, cut.feed_per_tooth
    tooth = _of_lag(of, 2.0 * depth * abs(math.tan(of.cutter.helix_angle)) / of.cutter.diameter)
    counts = _steps(of, tooth, speed, steps, stiffening, refinement)
    G, I = tooth.G.copy(), tooth.I.copy()  # noqa: E741
    G[lk.SLICE_DEPTH] = depth / tooth.slices
    G[lk.FEED], G[lk.FEED_SPEED] = feed, feed / cut.tooth_passing_period(of.cutter.flutes)
    G[lk.OMEGA], G[lk.LENGTH_BEFORE] = speed, cut.length_cut_before
    G[lk.FIRST_TOOTH] = cut.idle_passes % of.cutter.flutes
    G[lk.HELD_UNTIL] = min(cut.held_until, cut.idle_passes * cut.tooth_passing_period(of.cutter.flutes))
    G[lk.SWUNG_FRONT] = float(cut.swung_front and cut.idle_passes > 0)
    G[lk.BEGIN] = cut.late_entry * G[lk.PITCH]
    G[lk.END] = (cut.passes - cut.early_exit) * G[lk.PITCH]
    I[fk.IDLE], I[fk.CUT], I[fk.RING_DOWN] = cut.idle_passes, cut.passes, cut.ring_down_passes
    turn = tooth.turn
    if turn:
        turn = replace(turn, steps=np.array(counts))
        counts = [math.ceil(sum(counts) / of.cutter.flutes)]
    I[fk.STEPS : fk.STEPS + len(counts)] = counts
    further = len(of.model.structure.further)
    Y = np.zeros(3 + len(of.layout.state) + 2 * further)
    Y[0], Y[1] = cut.initial_displacement, cut.initial_velocity
    O = np.zeros((of.layout.oscillators + further, 3))  # noqa: E741
    O[: len(of.motion.oscillators)] = of.motion.oscillators
    return Packed(of.A, of.P, G, I, O, Y, of.base and not measured_clock, 1 + further, of.planar,
                  tooth.crossing, turn)
