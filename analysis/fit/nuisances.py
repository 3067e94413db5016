"""What belongs to one record and not to the machine: the state at its start, its passes, its speed, its angles."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from testbed.machine import Model

MISSING = {"entry": "late_entry", "exit": "early_exit"}  # what a cut may lack of its first and of its last pass


@dataclass(frozen=True)
class Nuisances:
    """What belongs to one record: state at its first sample (m, m/s), entry and exit pass, relative speed, tooth angle.

    Of a record that starts in the cut it is the state with which its simulation begins: long before, or at its first pass.
    entry: index of the pass that cuts first, counted from the anchor (see Observed.pass_start).
    exit: index of the first pass that cuts no more. late_entry, early_exit: shares of the first and the last pass that are not
    cut. angle (rad): a record's own share of the tooth angle.
    length (m): by how much more the tool had cut before than the record's cut says; of one that begins while it cuts.
    shifts: (path, shift) of the effects' parameters that every record has for itself, added to the model's value.
    states: (path, value) of the effects' own states at the first sample, where they are not at rest, and of modes beyond the
    first, `modes[1].displacement` and `modes[1].velocity`.
    """

    displacement: float = 0.0
    velocity: float = 0.0
    entry: int = 0
    exit: int = 0
    speed: float = 1.0
    angle: float = 0.0
    shifts: tuple[tuple[str, float], ...] = ()
    late_entry: float = 0.0
    early_exit: float = 0.0
    length: float = 0.0
    states: tuple[tuple[str, float], ...] = ()

    def with_fields(self, **values: float) -> Nuisances:
        """The same with fields of these names at these values."""
        return Nuisances(**{**vars(self), **values})

    def without_states_of(self, effect: str) -> Nuisances:
        """The same with an effect's own states at rest."""
        kept = tuple(one for one in self.states if one[0].partition(".")[0] != effect)
        return self if kept == self.states else replace(self, states=kept)

    @property
    def swings(self) -> bool:
        """Whether the structure is not at rest in that state."""
        return self.displacement != 0.0 or self.velocity != 0.0

    def ends_in_arc(self, gradual: bool = False) -> tuple[str, ...]:
        """The ends of the cut that are within a tooth's arc; of an entry that is `gradual` the place is another unknown."""
        return tuple(end for end, name in MISSING.items() if getattr(self, name) > 0.0 and not (gradual and end == "entry"))

    def shifted(self, model: Model) -> Model:
        """The model with this record's own values of its effects' parameters."""
        values = {path: model.value(path) + by for path, by in self.shifts if path.partition(".")[0] in model.effects}
        return model.with_values(values) if values else model


def turned_by(nuisances: Nuisances, path: str, angle: float) -> Nuisances:
    """The nuisances of a record with its own shift of an effect's parameter changed by an angle (rad)."""
    shifts = dict(nuisances.shifts)
    shifts[path] = math.remainder(shifts.get(path, 0.0) + angle, 2 * math.pi)
    return replace(nuisances, shifts=tuple(sorted(shifts.items())))


def begun_with(nuisances: Nuisances, path: str, by: float) -> Nuisances:
    """The nuisances of a record with an effect's own state at its first sample changed."""
    states = dict(nuisances.states)
    states[path] = states.get(path, 0.0) + by
    return replace(nuisances, states=tuple(sorted(states.items())))


def end_moved(nuisances: Nuisances, end: str, by: float) -> Nuisances:
    """The nuisances with more (or less, `by` < 0) of the first or the last pass missing; beyond its bounds, of the next one.

    end: "entry" or "exit"; by: in passes.
    """
    missing, outwards = getattr(nuisances, MISSING[end]) + by, 1 if end == "entry" else -1
    passes = math.floor(missing)
    share = missing - passes
    if share >= 1.0:  # of a little less than a whole number rounding makes a whole pass
        passes, share = passes + 1, 0.0
    return nuisances.with_fields(**{end: getattr(nuisances, end) + outwards * passes, MISSING[end]: share})


def end_moved_in_arc(nuisances: Nuisances, end: str, by: float, arc: float) -> Nuisances:
    """The same, `by` in arcs of engagement: where no tooth is in the work nothing is missed.

    arc: share of a pass in which a tooth is in the work.
    """
    moved = end_moved(end_whole(nuisances, end), end, arc_gone(nuisances, end, arc) + by)
    share = getattr(moved, MISSING[end])
    if end == "exit" and share > 0.0:
        return replace(moved, early_exit=min(1.0 - arc + share * arc, math.nextafter(1.0, 0.0)))
    return moved.with_fields(**{MISSING[end]: share * arc})


def end_whole(nuisances: Nuisances, end: str, passes: int = 0) -> Nuisances:
    """The nuisances with the first or the last pass cut whole, so many `passes` of those there are left out."""
    outwards = 1 if end == "entry" else -1
    return nuisances.with_fields(**{end: getattr(nuisances, end) + outwards * passes, MISSING[end]: 0.0})


def arc_gone(nuisances: Nuisances, end: str, arc: float) -> float:
    """How much of a tooth's arc the first or the last pass lacks, 0 to 1; `arc` as there."""
    missing = getattr(nuisances, MISSING[end])
    return float(min(missing / arc, 1.0) if end == "entry" else max(missing - (1.0 - arc), 0.0) / arc)


def nearly_whole(nuisances: Nuisances, ends: tuple[str, ...], arc: float, near: float) -> Nuisances:
    """The nuisances with those of the ends at a whole pass that are within a share `near` of an arc of it."""
    found = nuisances
    for end in ends:
        gone = arc_gone(found, end, arc)
        if min(gone, 1.0 - gone) < near:
            found = end_whole(found, end, round(gone))
    return found if found.entry < found.exit else nuisances


def other_teeth(nuisances: Nuisances, flutes: int, every: int = 1) -> list[Nuisances]:
    """The same course with another tooth (one in `every`) the first to cut: unequal teeth tell which it was.

    A simulation counts teeth from a pass that stays; the angle turns back by a pitch, and the passes that are meant move on.
    """
    found = []
    for tooth in range(every, flutes, every):
        angle = nuisances.angle - 2 * math.pi * tooth / flutes
        back = flutes if angle < -math.pi else 0  # a whole turn on, so that angles do not wander off
        found.append(
            replace(
                nuisances,
                angle=angle + 2 * math.pi * back / flutes,
                entry=nuisances.entry + tooth - back,
                exit=nuisances.exit + tooth - back,
            )
        )
    return found
