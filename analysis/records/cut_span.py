"""From when to when a record cuts, where chatter may have led its segments astray: a limit cycle whose level wanders looks like
an exit or a ring-down, and idling among hum like a steady cut."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.records.segments import Segment
from testbed.recording import Recording

QUIET = 0.25  # of the power of the cut, above that of the idling: a stretch that does not cut
IDLES = 1.5  # times the power of the idling, that such a stretch has at the most
LASTS = {"exit": 0.5, "idle": 0.5, "ring-down": 0.9}  # of its level at its start, that a stretch keeps if it cuts still
FEWEST = 4  # revolutions in a stretch that are needed to tell


def cut_span(recording: Recording, segments: Sequence[Segment], name: str, turn: float) -> tuple[float, float] | None:
    """Start and stop (s) of the cut in a channel, by its segments as they are corrected; None where nothing cuts.

    turn: of the spindle, s. What comes behind the cut belongs to it where it is as loud and does not die away, and a free decay
    or idling only where it is longer than all before it; what is called steady, but is as quiet as the idling was, does not.
    """
    def power(first: float, last: float) -> float:
        return _power(values[(time >= first) & (time < last)], turn * recording.sampling_rate)

    values, time = np.asarray(recording.channels[name], dtype=float), recording.time
    parts = [part for part in segments if part.kind in ("entry", "steady")]
    later = [part for part in segments if part not in parts and (not parts or part.start >= parts[-1].stop)]
    still = power(segments[0].start, segments[0].stop) if segments and segments[0].kind == "idle" else 0.0
    if not parts and later and later[0].kind == "idle":
        later = later[1:]
    if len(parts) == 2 and parts[0].duration > 2 * FEWEST * turn and power(parts[1].start, parts[1].stop) < IDLES * still:
        return parts[0].start, parts[0].stop
    for part in later:
        quarter = 0.25 * part.duration
        if part.duration < FEWEST * turn:
            break
        at_start, at_end = power(part.start, part.start + quarter) - still, power(part.stop - quarter, part.stop) - still
        before = power(parts[0].start, parts[-1].stop) - still if parts else 0.0
        longer = part.duration > sum(one.duration for one in parts)
        if at_end < max(LASTS[part.kind] ** 2 * at_start, QUIET * before) or not longer and part.kind != "exit":
            break
        parts = [*parts, part]
    return (parts[0].start, parts[-1].stop) if parts else None


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
