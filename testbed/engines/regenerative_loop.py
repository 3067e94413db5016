"""A machine in a cut as a delay equation in the spindle angle, as the effects' own files have it.

    dY/dphi = f(phi, Y(phi), Y(phi - delay), ...),    Y = [q, q', t, states of the active effects, further modes]

q is the motion of the structure's first mode. A delay is a pitch of spindle angle whatever the speed does: one for all teeth,
over a period of that pitch, or one for each tooth where they are of unequal pitch, over a period of a revolution.
`testbed.analysis.linear.linearise` finds its multipliers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import ModuleType

import numpy as np

from testbed.catalogue import catalogue as known_effects
from testbed.cut import Cut
from testbed.effect import Effect
from testbed.engines import fast_kernel as fk
from testbed.engines import loop_kernel as lk
from testbed.engines.compose import Layout, compose
from testbed.engines.grid import Turn
from testbed.engines.linearised_kernel import LANE, LEAD, NUMBER, OLDER
from testbed.engines.model_arrays import active_effects, state_place
from testbed.engines.packing import Packed, pack
from testbed.engines.stiffening import fastest_frequency
from testbed.machine import Model

TIME = 2  # the place of the time in the state


@dataclass(frozen=True)
class Rates:
    """f (n, K), its derivatives by Y(phi), `now` (n, K, K), and by Y a delay ago, `before` (n, delays, K, K), at n phases.

    speed (n,) rad/s; bent (n,): a law of the chip bends there, so that a tooth meets what was left longer ago; contact (n, 2):
    edges in the cut, and those of them out of the work, whose chip would be negative.
    """

    f: np.ndarray
    now: np.ndarray
    before: np.ndarray
    speed: np.ndarray
    bent: np.ndarray
    contact: np.ndarray


@dataclass(frozen=True)
class Segment:
    """Phases from `low` to `high` (rad) between which f is smooth; teeth (in the cut there, 4), see `linearised_kernel`."""

    low: float
    high: float
    teeth: np.ndarray

    @property
    def lanes(self) -> list[int]:
        """Which of the delays act here."""
        return sorted({int(lane) for lane in self.teeth[:, LANE]})


@dataclass(frozen=True)
class RegenerativeLoop:
    """The delay equation of one machine at one cut.

    unknowns (K,): places in the whole state (of `size`) of the coordinates that move; prescribed (K,): those that set
    the spindle speed, taken as a given course when the motion is perturbed. segments: of the period, in order; delays: of the
    lanes, rad. fastest: highest angular frequency, rad/s. steady: the speed is constant. period_passes: tooth passes in a
    period; periods_alike: how many periods until the same tooth returns, 1 where teeth are alike.
    """

    packed: Packed
    kernel: ModuleType
    unknowns: np.ndarray
    prescribed: np.ndarray
    segments: tuple[Segment, ...]
    delays: tuple[float, ...]
    nominal_speed: float
    fastest: float
    steady: bool
    period_passes: int
    periods_alike: int

    @property
    def size(self) -> int:
        """Length of the whole state."""
        return self.packed.Y.size

    @property
    def period(self) -> float:
        """Spindle angle after which the same delays act again, rad."""
        return self.segments[-1].high

    def rates(self, phases: np.ndarray, segment: int, number: int, states: np.ndarray, pasts: np.ndarray,
              scale: np.ndarray | None = None) -> Rates:
        """Rates at `phases` (n,) of a segment in a period, for states (n, size) and those a delay ago (n, delays, size), whole.

        scale (K,): half-widths of the differences; without it the derivatives are left empty.
        """
        count, teeth = phases.size, self.segments[segment].teeth.copy()
        teeth[:, NUMBER:] = (teeth[:, NUMBER:] + number * self.period_passes) % self.packed.G[lk.FLUTES]
        kept = self.unknowns if scale is not None else self.unknowns[:0]
        out = Rates(np.empty((count, kept.size)), np.empty((count, kept.size, kept.size)),
                    np.zeros((count, len(self.delays), kept.size, kept.size)), np.empty(count), np.empty(count, dtype=np.bool_),
                    np.empty((count, 2)))
        one = self.packed
        self.kernel.linearise(one.A, one.P, one.G, np.ascontiguousarray(phases), teeth, states.copy(), pasts.copy(), kept,
                              np.empty(0) if scale is None else scale, out.f, out.now, out.before, out.speed,
                              out.bent, out.contact)
        return out


def _segments_of_pitch(packed: Packed) -> tuple[Segment, ...]:
    """Of one pitch, after which the next tooth does the same: tooth q entered q pitches ago, after tooth q + 1."""
    pitch, first, found = packed.G[lk.PITCH], packed.G[lk.FIRST_TOOTH], []
    for segment in range(packed.I[fk.SEGMENTS]):
        low, high = packed.G[lk.CORNERS + segment : lk.CORNERS + segment + 2]
        teeth = np.zeros((packed.I[fk.TEETH + segment], 4))
        entered = np.arange(len(teeth))
        teeth[:, LEAD], teeth[:, NUMBER], teeth[:, OLDER] = entered * pitch, first - entered, first - entered - 1
        found.append(Segment(float(low), float(high), teeth))
    return tuple(found)


def _segments_of_turn(packed: Packed, turn: Turn) -> tuple[Segment, ...]:
    """Of a revolution, with a lane for each tooth; a hook is told its place in mean pitches, as the fast engine tells it."""
    enters, found = turn.tooth[:, 0], []
    number = packed.G[lk.FIRST_TOOTH] + enters / packed.G[lk.PITCH]
    window = packed.G[lk.ENGAGED] + packed.G[lk.SLICES] * packed.G[lk.SLICE_LAG]
    for low, high in pairwise(turn.corners):
        middle = 0.5 * (low + high)
        lead = -enters - 2.0 * math.pi * np.floor((middle - enters) / (2.0 * math.pi))
        lane = np.flatnonzero(middle + lead < window)
        found.append(Segment(low, high, np.column_stack([lead[lane], lane, number[lane], number[lane - 1]])))
    return tuple(found)


def regenerative_loop(model: Model, cut: Cut, catalogue: Mapping[str, Effect] | None = None) -> RegenerativeLoop:
    """The delay equation of `model` at `cut`. ValueError where the model has no cutter, or an effect no linear answer."""
    if model.cutter is None:
        raise ValueError("the model has no cutter: nothing is cut")
    effects = known_effects() if catalogue is None else catalogue
    packed, layout = pack(model, cut, effects), Layout(effects)
    active = active_effects(model, effects)
    for name in active:
        if effects[name].no_linear_answer:
            raise ValueError(effects[name].no_linear_answer)
    further = [state_place(effects, f"modes[{mode}].displacement") for mode in range(1, len(model.structure.modes))]
    unknowns = [0, 1, *(place + order for place in further for order in (0, 1))]
    prescribed = [False] * len(unknowns)
    for name in active:
        for state in effects[name].states:
            unknowns.append(layout.state[name, state])
            prescribed.append("speed" in effects[name].hooks)
    flutes, turn = model.cutter.flutes, packed.turn
    differ = turn is None and any("edge_position" in effects[name].hooks for name in active)
    kernel = compose(effects, ("array_kernel", "plane_kernel", "loop_kernel", "linearised_kernel"), packed.planar)
    return RegenerativeLoop(
        packed, kernel, np.array(unknowns), np.array(prescribed),
        _segments_of_turn(packed, turn) if turn is not None else _segments_of_pitch(packed),
        tuple(model.cutter.pitch_angles) if turn is not None else (float(packed.G[lk.PITCH]),), cut.spindle_speed,
        fastest_frequency(model, effects), bool(packed.I[fk.STEADY_SPEED]), flutes if turn is not None else 1,
        flutes if differ else 1)
