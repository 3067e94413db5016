"""From when to when a record cuts, where chatter may lead its segments astray: a limit cycle whose level wanders looks like an
exit or a ring-down, and idling among hum like a steady cut."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

QUIET = 0.25  # of the power of the cut, above that of the idling: a stretch that does not cut
IDLES = 1.5  # times the power of the idling, that such a stretch has at the most
RINGS = 4.0  # times that power, from which what follows rings down from a cut, however quiet that was
LASTS = {"exit": 0.5, "idle": 0.5, "ring-down": 0.9}  # of its level at its start, that a stretch keeps if it cuts still
LONG = {"exit": 0.25, "idle": 1.0, "ring-down": 1.0}  # times what cut before, how long such a stretch is: else it is what it is
FEWEST = 4  # revolutions in a stretch that are needed to tell
CUTS = ("entry", "steady")

Kind = Literal["idle", "entry", "steady", "exit", "ring-down"]
Place = tuple[Kind, int, int]  # kind, first sample, sample behind the last


def still_cutting(places: Sequence[Place], values: np.ndarray, turn: float) -> list[Place]:
    """Segments of a cut, with what cuts still named so, and idling that was taken for a steady cut.

    turn: samples a revolution. What comes behind the cut belongs to it where it is as loud, does not die away, and is long
    beside all before it; what is called steady, but is as quiet as the idling was, does not.
    """
    def power(first: int, last: int) -> float:
        return _power(values[first:last], turn)

    places = [place for place in places if place[2] > place[1]]
    parts = [place for place in places if place[0] in CUTS]
    later = [place for place in places if place not in parts and (not parts or place[1] >= parts[-1][2])]
    before = [place for place in places if place not in parts and place not in later]
    still = power(*places[0][1:]) if places and places[0][0] == "idle" else 0.0
    if not parts and later and later[0][0] == "idle":
        before, later = later[:1], later[1:]
    rings = [power(start, start + max(1, (stop - start) // 4)) for kind, start, stop in later if kind == "ring-down"]
    quiet = len(parts) == 2 and parts[0][2] - parts[0][1] > 2 * FEWEST * turn and power(*parts[1][1:]) < IDLES * still
    if quiet and not any(one > RINGS * still for one in rings):  # only what ends can ring
        return [*before, parts[0], ("idle", parts[1][1], len(values))]
    count = _absorbed(parts, later, power, still, turn)
    if count:
        kind: Kind = parts[-1][0] if parts else "entry"
        first = parts.pop()[1] if parts else later[0][1]
        parts.append((kind, first, later[count - 1][2]))
    return [*before, *parts, *later[count:]]


def _absorbed(parts: Sequence[Place], later: Sequence[Place], power: Callable[[int, int], float], still: float,
              turn: float) -> int:  # fmt: skip
    """How many of the stretches behind the cut's parts cut still. still: power of the idling."""
    first, last = (parts[0][1], parts[-1][2]) if parts else (0, 0)
    for count, (kind, start, stop) in enumerate(later):
        quarter = (stop - start) // 4
        if stop - start < FEWEST * turn:
            return count
        at_start, at_end = power(start, start + quarter) - still, power(stop - quarter, stop) - still
        cuts = power(first, last) - still if last > first else 0.0
        if at_end < max(LASTS[kind] ** 2 * at_start, QUIET * cuts) or stop - start < LONG[kind] * (last - first):
            return count
        first, last = (first if last > first else start), stop
    return len(later)


def _power(values: np.ndarray, turn: float) -> float:
    """Median over revolutions, or halves of what is shorter than two, of the power about a straight line."""
    size = max(8, min(round(turn), len(values) // 2))
    rows = values[: len(values) // size * size].reshape(-1, size)
    if not len(rows):
        return 0.0
    place = np.linspace(-1.0, 1.0, size)
    rows = rows - rows.mean(axis=1, keepdims=True)
    rows = rows - np.outer(rows @ place / (place @ place), place)
    return float(np.median(np.mean(rows**2, axis=1)))
