"""From models and cuts to the arrays both engines run on: flags, parameters, geometry, and the grid in spindle angle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbed.cut import Cut, Cuts
from testbed.effect import Effect
from testbed.engines import fast_kernel as fk
from testbed.engines import loop_kernel as lk
from testbed.engines import plane_kernel as pk
from testbed.engines.compose import Layout
from testbed.engines.grid import Pace, Turn, steps_of_segments
from testbed.engines.model_arrays import (
    CARRIED,
    DIAMETER,
    FLUTES,
    TANGENT,
    WANDERS,
    OfLag,
    OfModel,
    of_lag,
    of_model,
    state_place,
)
from testbed.machine import Model

FEW = 3  # silent runs that are not worth a pass of their own side by side: one after the other is as fast
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
    modes: int  # of the structure
    planar: bool  # True where it takes the kernels of motion in the plane
    crossing: float  # rad the leading tooth turns through its cut, what whole pitches leave of it
    turn: Turn | None = None  # the grid of a revolution, where teeth are of unequal pitch

    @property
    def states_on(self) -> bool:
        """Whether an active effect has states of its own."""
        return bool(self.I[fk.CARRIED] > self.modes or self.I[fk.PLAIN_COUNT] > 0)



@dataclass(frozen=True)
class Stack:
    """Runs of one kind side by side: the arrays of `Packed` with one axis more, padded with zeros to the most modes."""

    A: np.ndarray
    P: np.ndarray
    G: np.ndarray
    I: np.ndarray  # noqa: E741
    O: np.ndarray  # noqa: E741
    Y: np.ndarray
    turns: tuple[Turn, ...]  # of all runs, where teeth are of unequal pitch

    def arrays(self) -> tuple[np.ndarray, ...]:
        """A, P, G, I, O, Y."""
        return self.A, self.P, self.G, self.I, self.O, self.Y

    def modes(self, layout: Layout) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of motion in the plane, what `plane_linear_kernel` takes: the modes' numbers (runs, modes, MODE_SIZE), how many modes
        each run has (runs,), and their coordinates and rates (runs, modes, 2)."""
        first, runs = layout.parameters + 1, len(self.Y)
        rates = np.concatenate([self.Y[:, :2], self.Y[:, 3 + len(layout.state) :]], axis=1)
        modes = np.ascontiguousarray(self.P[:, first:]).reshape(runs, -1, pk.MODE_SIZE)
        return modes, self.P[:, first - 1].astype(np.int64), rates.reshape(runs, -1, 2)

    def some(self, runs: np.ndarray) -> Stack:
        """These runs alone."""
        A, P, G, I, O, Y = (array[runs] for array in self.arrays())  # noqa: E741
        return Stack(A, P, G, I, O, Y, tuple(self.turns[run] for run in runs if self.turns))

    def side_by_side(self, lanes: int) -> tuple[np.ndarray, np.ndarray]:
        """(numbers of runs that can go side by side, shape (groups, lanes), the last of them repeated; those of all others)."""
        plain = (self.G[:, lk.HELD_UNTIL] == 0.0) & (self.G[:, lk.SWUNG_FRONT] == 0.0)
        order = np.flatnonzero(plain)
        rows = np.ascontiguousarray(self.I[order, : fk.PLAIN])
        if (rows == rows[:1]).all():
            alike = [order]
        else:
            kinds = np.unique(rows.view(np.dtype((np.void, rows.itemsize * fk.PLAIN))).ravel(), return_inverse=True)[1]
            sort = np.argsort(kinds, kind="stable")
            alike = np.split(order[sort], np.flatnonzero(np.diff(kinds[sort])) + 1)
        groups, others = [], [np.flatnonzero(~plain)]
        for runs in alike:
            whole = len(runs) // lanes * lanes
            groups.append(runs[:whole].reshape(-1, lanes))
            rest = runs[whole:]
            if len(rest) >= FEW:
                groups.append(np.concatenate([rest, np.full(lanes - len(rest), rest[-1])])[None])
            else:
                others.append(rest)
        return np.concatenate(groups) if groups else np.empty((0, lanes), np.intp), np.concatenate(others)

    @property
    def steps_of_pass(self) -> np.ndarray:
        """How many steps one tooth pass takes, shape (runs,)."""
        return self.I[:, fk.STEPS : fk.STEPS + lk.MOST_SEGMENTS].sum(axis=1)

    @property
    def nominal_pass(self) -> np.ndarray:
        """How long a tooth pass lasts at the nominal spindle speed, s, shape (runs,)."""
        return self.G[:, lk.PITCH] / self.G[:, lk.OMEGA]


def _pace(numbers: np.ndarray, speed: np.ndarray, stiffening: float | np.ndarray, crossing: np.ndarray, lengths: np.ndarray,
          teeth: np.ndarray) -> Pace:  # fmt: skip
    """What asks for short steps, of runs side by side; numbers: (runs, places)."""
    carried, integrated, turning, own, exact, steady = numbers.T[CARRIED:WANDERS, :, None]
    stiff = np.broadcast_to(stiffening, speed.shape)[:, None]
    with np.errstate(over="ignore"):
        # squared: the frequency grows, and so does the share of the force that is integrated and not carried exactly
        integrated = np.where(stiff > 1.0, np.maximum(integrated, stiff**2 * own), integrated)
    return Pace(carried, integrated, turning, own, speed[:, None], crossing[:, None], exact > 0, steady > 0, lengths, teeth)


def _turns(of: Sequence[OfModel], teeth: Sequence[OfLag], I: np.ndarray, speed: np.ndarray,  # noqa: E741
           stiffening: float | np.ndarray, steps: int | None, refinement: int) -> tuple[Turn, ...]:  # fmt: skip
    """The grids of a revolution under teeth of unequal pitch, of every run; what they take a pass goes into I."""
    found = []
    for run, (one, tooth) in enumerate(zip(of, teeth, strict=True)):
        assert tooth.turn is not None
        pace = _pace(np.array([one.numbers]), speed[run : run + 1], np.broadcast_to(stiffening, speed.shape)[run],
                     np.array([tooth.crossing]), np.diff(tooth.turn.corners)[None], np.array([tooth.turn.teeth]))  # fmt: skip
        pace = replace(pace, exact=pace.exact & pace.steady)  # free flight is stepped through, as the speed needs it
        counts = np.maximum(2, _gated(steps, pace, one.numbers[WANDERS] > 0, refinement)[0])  # a surface is read from four rows
        found.append(replace(tooth.turn, steps=counts))
        I[run, fk.STEPS] = math.ceil(int(counts.sum()) / one.cutter.flutes)
    return tuple(found)


def _gated(steps: int | None, pace: Pace, gated: np.ndarray | bool, refinement: int) -> np.ndarray:
    """Steps of each segment, more of them where the edge of an engagement wanders through it."""
    return refinement * np.where(gated & (pace.teeth > 0) & (not steps), GATED, 1) * steps_of_segments(steps, pace)


def _distinct(models: Sequence[Model], catalogue: Mapping[str, Effect]) -> tuple[list[OfModel], np.ndarray]:
    """What is made of each model, once, and which of them each run has."""
    known = {id(model): model for model in models}
    of = [of_model(model, catalogue) for model in known.values()]
    if len(of) == 1:
        return of, np.zeros(len(models), np.intp)
    place = {key: number for number, key in enumerate(known)}
    return of, np.array([place[id(model)] for model in models])


def _distinct_lags(of: Sequence[OfModel], which: np.ndarray, lags: np.ndarray) -> tuple[list[OfLag], np.ndarray]:
    """What is made of each model and lag of its helix, once, and which of them each run has."""
    if len(of) == 1 and lags.min() == lags.max():
        return [of_lag(of[0], float(lags[0]))], which
    keys = list(zip(which.tolist(), lags.tolist(), strict=True))
    place = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    return [of_lag(of[number], lag) for number, lag in place], np.array([place[key] for key in keys])


def pack_many(
    models: Sequence[Model],
    cuts: Sequence[Cut],
    catalogue: Mapping[str, Effect],
    steps: int | None = None,
    stiffening: float | np.ndarray = 1.0,
    refinement: int = 1,
) -> Stack:
    """What `pack` gives for each of these runs, side by side and at once; they agree in the first two parts of `kind_of`.

    stiffening: of `pack`, one number, or one a run.
    """
    of, which = _distinct(models, catalogue)
    given, numbers = Cuts.of(cuts), np.array([one.numbers for one in of])[which]
    cut = given.column
    lags = 2.0 * cut.axial_depth_of_cut * numbers[:, TANGENT] / numbers[:, DIAMETER]
    teeth, at = _distinct_lags(of, which, lags)
    G, I = np.array([one.G for one in teeth])[at], np.array([one.I for one in teeth])[at]  # noqa: E741
    slices, crossing = np.array([(one.slices, one.crossing) for one in teeth])[at].T
    _fill_cuts(G, I, given, numbers[:, FLUTES], slices)
    turns: tuple[Turn, ...] = ()
    if of[0].cutter.pitch_angles:
        turns = _turns([of[place] for place in which], [teeth[place] for place in at], I, cut.spindle_speed, stiffening, steps,
                       refinement)  # fmt: skip
    else:
        last = lk.CORNERS + lk.MOST_SEGMENTS
        pace = _pace(numbers, cut.spindle_speed, stiffening, crossing, np.diff(G[:, lk.CORNERS : last + 1]),
                     I[:, fk.TEETH : fk.TEETH + lk.MOST_SEGMENTS])  # fmt: skip
        counts = _gated(steps, pace, numbers[:, WANDERS, None] > 0, refinement)
        there = np.arange(lk.MOST_SEGMENTS) < I[:, fk.SEGMENTS, None]
        I[:, fk.STEPS : fk.STEPS + lk.MOST_SEGMENTS] = np.where(there, counts, 0)
    further = max(len(one.model.structure.further) for one in of)
    Y = np.zeros((len(which), 3 + len(of[0].layout.state) + 2 * further))
    Y[:, 0], Y[:, 1] = cut.initial_displacement, cut.initial_velocity
    for run, states in enumerate(given.states):
        for path, value in states:
            Y[run, state_place(catalogue, path)] = value
    O = [np.zeros((one.layout.oscillators + further, 3)) for one in of]  # noqa: E741
    for rows, one in zip(O, of, strict=True):
        rows[: len(one.motion.oscillators)] = one.motion.oscillators
    return Stack(np.array([one.A for one in of])[which], _padded([one.P for one in of])[which], G, I, np.array(O)[which], Y,
                 turns)  # fmt: skip


def _fill_cuts(G: np.ndarray, I: np.ndarray, cuts: Cuts, flutes: np.ndarray, slices: np.ndarray) -> None:  # noqa: E741
    """What G and I say of the cut, each (runs, ...)."""
    cut, period = cuts.column, cuts.tooth_passing_period(flutes)
    G[:, lk.SLICE_DEPTH] = cut.axial_depth_of_cut / slices
    G[:, lk.FEED], G[:, lk.FEED_SPEED] = cut.feed_per_tooth, cut.feed_per_tooth / period
    G[:, lk.OMEGA], G[:, lk.LENGTH_BEFORE] = cut.spindle_speed, cut.length_cut_before
    G[:, lk.FIRST_TOOTH] = cut.idle_passes % flutes
    G[:, lk.HELD_UNTIL] = np.minimum(cut.held_until, cut.idle_passes * period)
    G[:, lk.SWUNG_FRONT] = (cut.swung_front > 0) & (cut.idle_passes > 0)
    G[:, lk.BEGIN] = cut.late_entry * G[:, lk.PITCH]
    G[:, lk.END] = (cut.passes - cut.early_exit) * G[:, lk.PITCH]
    I[:, fk.IDLE], I[:, fk.CUT], I[:, fk.RING_DOWN] = cut.idle_passes, cut.passes, cut.ring_down_passes


def _padded(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays of one dimension side by side, with zeros behind the shorter ones."""
    found = np.zeros((len(arrays), max(len(one) for one in arrays)))
    for row, one in zip(found, arrays, strict=True):
        row[: len(one)] = one
    return found


def pack(
    model: Model,
    cut: Cut,
    catalogue: Mapping[str, Effect],
    steps: int | None = None,
    stiffening: float = 1.0,
    refinement: int = 1,
) -> Packed:
    """Arrays for one run. `steps`: how many while the leading tooth crosses its cut; None chooses.

    refinement: how many times as many steps as that.
    stiffening: the highest frequency of the structure in this motion over its natural one, for the choice of steps.
    """
    many, of = pack_many([model], [cut], catalogue, steps, stiffening, refinement), of_model(model, catalogue)
    lag = 2.0 * cut.axial_depth_of_cut * of.numbers[TANGENT] / of.numbers[DIAMETER]
    A, P, G, I, O, Y = (array[0] for array in many.arrays())  # noqa: E741
    return Packed(A, P, G, I, O, Y, 1 + len(model.structure.further), of.planar,
                  of_lag(of, lag).crossing, many.turns[0] if many.turns else None)  # fmt: skip
