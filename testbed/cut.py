"""One cut: at what speed, depth and feed, for how many tooth passes, from which state."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from operator import attrgetter
from types import SimpleNamespace
from typing import Any, overload

import numpy as np

REMEMBERED = 0.05  # s of the motion before a record that its sensor is taken to have followed: one that lags remembers


States = tuple[tuple[str, float], ...]  # (path, value) of states a run begins with


@dataclass(frozen=True)
class Cut:
    """Operating conditions and the course of one test (SI).

    spindle_speed (rad/s), axial_depth_of_cut (m), feed_per_tooth (m). The timeline is counted in tooth passes:
    `idle_passes` before the entry, `passes` in the cut, `ring_down_passes` after the exit; entry and exit fall on
    the start of a pass. Teeth are counted from time 0, so that the tooth that cuts first is number `idle_passes` modulo
    the flutes. initial_displacement (m) and initial_velocity (m/s) are the structure's state at time 0, or at `held_until` (s),
    at most the time of the entry, before which nothing is known of it: of its first mode's coordinate, where it has several;
    states: (path, value) of the others', `modes[1].displacement` and `modes[1].velocity`, where they do not stand still.
    Where teeth are of unequal pitch a tooth pass is a mean pitch: the first tooth enters where the cut begins, and after any
    number of passes the cut ends, wherever the teeth are.
    length_cut_before (m) is the feed length the tool has already cut. late_entry and early_exit are shares of a tooth pass
    by which the cut starts after the start of its first pass, and ends before the end of its last.
    swung_front: whether the first teeth meet what the structure's swing would have left on the idle pass before, as in a delay
    equation with its history, and not a straight front.
    """

    spindle_speed: float
    axial_depth_of_cut: float
    feed_per_tooth: float = 0.1016e-3
    idle_passes: int = 0
    passes: int = 60
    ring_down_passes: int = 0
    initial_displacement: float = 0.0
    initial_velocity: float = 0.0
    length_cut_before: float = 0.0
    late_entry: float = 0.0
    early_exit: float = 0.0
    held_until: float = 0.0
    swung_front: bool = False
    states: States = ()

    def __post_init__(self) -> None:
        for name in ("spindle_speed", "feed_per_tooth"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be above 0")
        if not (math.isfinite(self.axial_depth_of_cut) and self.axial_depth_of_cut >= 0):
            raise ValueError("axial_depth_of_cut must be at least 0")
        for name in ("idle_passes", "passes", "ring_down_passes"):
            if int(getattr(self, name)) != getattr(self, name) or getattr(self, name) < 0:
                raise ValueError(f"{name} must be a whole number of at least 0")

        if not (math.isfinite(self.held_until) and self.held_until >= 0):
            raise ValueError("held_until must be at least 0")
        for name in ("late_entry", "early_exit"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ValueError(f"{name} must be at least 0 and below 1")

    def tooth_passing_period(self, flutes: int) -> float:
        """Time between two teeth at the nominal speed, s."""
        return 2.0 * math.pi / (flutes * self.spindle_speed)

    @property
    def total_passes(self) -> int:
        """Idle, cutting and ring-down passes together."""
        return self.idle_passes + self.passes + self.ring_down_passes


_NAMES = tuple(one.name for one in fields(Cut) if one.name != "states")
_values = attrgetter(*_NAMES)


class Cuts(Sequence[Cut]):
    """Cuts side by side, without an object for each.

    column: by the names of Cut's fields, the values of all of them as floats, shape (cuts,). states: those of each cut, or
    empty where none has any.
    """

    def __init__(self, table: np.ndarray, states: Sequence[States] = ()) -> None:
        """table: the columns one under another, shape (fields, cuts), in the order of Cut's fields, `states` left out."""
        self.table, self.states = table, tuple(states)
        self.column = SimpleNamespace(**dict(zip(_NAMES, table, strict=True)))

    @classmethod
    def of(cls, cuts: Sequence[Cut]) -> Cuts:
        """The same cuts in columns."""
        if isinstance(cuts, Cuts):
            return cuts
        table = np.array([_values(cut) for cut in cuts], float).reshape(len(cuts), len(_NAMES)).T
        return cls(table, [cut.states for cut in cuts] if any(cut.states for cut in cuts) else ())

    @classmethod
    def alike(cls, count: int, **columns: Any) -> Cuts:
        """So many cuts of these values, each a number for all or an array (count,); else Cut's own. ValueError as for a Cut."""
        for end in (np.min, np.max):  # what may not be is too low, too high, or no number at all: the ends tell
            one = Cut(**{name: end(values) for name, values in columns.items()})
        return cls(np.array([np.broadcast_to(columns.get(name, getattr(one, name)), (count,)) for name in _NAMES], float))

    def __len__(self) -> int:
        return self.table.shape[1]

    @overload
    def __getitem__(self, index: int) -> Cut: ...
    @overload
    def __getitem__(self, index: slice) -> Cuts: ...

    def __getitem__(self, index):
        if isinstance(index, slice):
            return Cuts(self.table[:, index], self.states[index])
        values = {name: _KINDS.get(name, float)(value) for name, value in zip(_NAMES, self.table[:, index], strict=True)}
        return Cut(**values, states=self.states[index] if self.states else ())

    def some(self, places: Sequence[int] | np.ndarray) -> Cuts:
        """Those at these places."""
        return Cuts(self.table[:, places], [self.states[place] for place in places] if self.states else ())

    @property
    def total_passes(self) -> np.ndarray:
        """Idle, cutting and ring-down passes together, shape (cuts,)."""
        return self.column.idle_passes + self.column.passes + self.column.ring_down_passes

    def tooth_passing_period(self, flutes: int | np.ndarray) -> np.ndarray:
        """Time between two teeth at the nominal speed, s, shape (cuts,)."""
        return 2.0 * math.pi / (flutes * self.column.spindle_speed)


_KINDS = {"idle_passes": int, "passes": int, "ring_down_passes": int, "swung_front": bool}  # others: float


@dataclass(frozen=True)
class Sampling:
    """When the simulated motion is looked at: `count` samples at `rate` (Hz), the first at `start` (s)."""

    rate: float
    count: int
    start: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.rate) and self.rate > 0):
            raise ValueError("rate must be above 0")
        if self.count < 1:
            raise ValueError("count must be at least 1")


def whole_cut_sampling(cut: Cut, flutes: int, rate: float) -> Sampling:
    """Samples over the nominal length of the whole cut."""
    return Sampling(rate, int(whole_cut_counts(cut, flutes, rate)))


def whole_cut_counts(cuts: Cut | Cuts, flutes: int, rate: float) -> np.ndarray:
    """How many samples that is of each cut, as whole numbers in floats, shape (cuts,)."""
    duration = cuts.total_passes * cuts.tooth_passing_period(flutes)
    return np.maximum(1.0, np.floor(duration * rate * (1 + 1e-12)))
