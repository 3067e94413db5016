"""Where a record idles, enters the cut, cuts steadily, leaves it and rings down, found from the signal itself.

The level of each revolution (its deviation from a straight line, which takes offset and drift out) is compared with
the idling before or after and with the noise; a free decay fitted backwards from the end says when the last tooth
left. No time is fixed in advance.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from testbed.analysis.records.blows import decays, find_blows, grows, swing_length
from testbed.analysis.records.cut_span import Kind, Place, still_cutting
from testbed.analysis.records.free_decay import free_decay_end, free_decay_start
from testbed.analysis.records.hum import hum_lag, without_hum
from testbed.analysis.records.periods import period_changes
from testbed.analysis.records.white_noise import white_noise
from testbed.readers.tachometer import speed as marks_speed
from testbed.recording import Recording

_STILL, _STILL_SAMPLES = 0.1, 16  # share of a swing that is none, and samples in which that is seen
_ABRUPT = 2.5  # growth of the level within two revolutions that ends idling
_QUIET, _OFTEN = 1.5, 0.1  # times the level of idling, below which samples are as quiet; share of samples
AT_ONCE = 1 << 22  # samples, overlapping windows each counted whole
_RESOLVED = 2e-3  # of the range: what is smaller than this is not looked for


@dataclass(frozen=True)
class Segment:
    """One stretch of a record, from `start` to `stop` (s, in the record's own time)."""

    kind: Kind
    start: float
    stop: float

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.stop - self.start


@dataclass(frozen=True)
class _Levels:
    """Deviation from a straight line in overlapping windows: first sample, window and hop in samples, level each."""

    first: np.ndarray
    window: int
    level: np.ndarray


def main_channel(recording: Recording) -> str:
    """The channel that segments are read from: displacement before velocity, acceleration, forces."""
    return main_channel_of(recording.channels)


def main_channel_of(channels: Iterable[str]) -> str:
    """The one of these channels that segments are read from."""
    names = list(channels)
    for wanted in ("displacement", "velocity", "acceleration", "force_x", "force_y", "force"):
        for name in names:
            if name == wanted or name.startswith(f"{wanted}_") and name not in ("force_x", "force_y"):
                return name
    return names[0]


def revolution_period(recording: Recording) -> float | None:
    """Time of one revolution (s): from the marks, else from the nominal speed, else None."""
    found = marks_speed(recording.marks)
    found = found if found is not None else recording.conditions.get("spindle_speed")
    return 2 * np.pi / found if found else None


def find_segments(
    recording: Recording, *, kind: str = "cut", channel: str | None = None, period: float | None = None
) -> tuple[Segment, ...]:
    """Segments of a record in the order of time; together they cover a cut's whole length.

    kind: the record's (`cut`, `ring-down`, `idle`, `excited`; the last has none). period: of one revolution, s; from
    marks or nominal speed where None. A cut that never settles has no `steady`; one that starts in the cut no `idle`.
    """
    if kind == "excited":
        return ()
    rate, start = recording.sampling_rate, recording.start
    values = np.asarray(recording.channels[channel or main_channel(recording)], dtype=float)
    end = len(values)
    if kind == "idle":
        return (Segment("idle", start, start + end / rate),)
    period = period or revolution_period(recording) or end / rate / 100
    turn = max(8, round(period * rate))
    if end < 4 * turn and kind == "cut":
        return (Segment("steady", start, start + end / rate),)
    if kind == "ring-down":
        turn = turn if end > 16 * turn else max(8, end // 100)
        places = _tap(values, max(turn, min(swing_length(values), end // 16)))
    else:
        places = _cut(values, period * rate, hum_lag(values, rate, period * rate))
    return tuple(
        Segment(name, start + first / rate, start + last / rate) for name, first, last in places if last > first
    )


def _levels(values: np.ndarray, window: int) -> _Levels:
    """Deviation of each window from its own straight line; windows overlap by three quarters."""
    window = min(window, len(values))
    first = np.arange(0, len(values) - window + 1, max(1, window // 4))
    time = np.arange(window) - 0.5 * (window - 1)
    # (windows, window) views; the line's mean and slope are removed
    views, rest = np.lib.stride_tricks.sliding_window_view(values, window), np.empty(len(first))
    together = max(1, AT_ONCE // window)
    for begin in range(0, len(first), together):
        rows = views[first[begin : begin + together]]
        rows -= rows.mean(axis=1, keepdims=True)
        rest[begin : begin + together] = (rows**2).sum(axis=1) - (rows @ time) ** 2 / (time @ time)
    return _Levels(first, window, np.sqrt(np.maximum(rest, 0.0) / window))


def _idle_end(values: np.ndarray, turn: int, white: float) -> int:
    """Samples of idling at the front: 0 where the record starts in the cut, or there are no samples."""
    if not len(values):
        return 0
    levels = _levels(values, turn)
    floor = max(white, 1e-3 * float(np.median(levels.level)), 1e-300)
    level = np.maximum(levels.level, floor)
    for place in range(4, len(level) - 1):
        reference = float(np.median(level[: place - 3 if place > 7 else place]))
        if not (level[place] > _ABRUPT * reference and level[min(place + 2, len(level) - 1)] > _ABRUPT * reference):
            continue
        quiet = level[: max(1, place - 4)]
        flat = len(quiet) < 8 or np.median(quiet[len(quiet) // 2 :]) < 1.4 * np.median(quiet[: len(quiet) // 2])
        later = float(np.median(level[place : place + 12]))
        noise_like = reference < 4 * white
        # what starts loud may be idling amid ambient vibration: then it ends at once, unlike growing chatter
        sudden = level[min(place + 4, len(level) - 1)] > 3 * level[max(0, place - 4)] and later > 4 * reference
        if flat and (noise_like or sudden):
            gradual = _gradual_start(level, place)
            if gradual is not None:
                return int(levels.first[gradual]) + levels.window // 2
            return _first_move(values, int(levels.first[place]), levels.window, turn, white)
        if not noise_like:
            return 0
    return 0


def _gradual_start(level: np.ndarray, place: int) -> int | None:
    """The window at which a level that creeps up first left its idling for good; None for a level that jumps."""
    quiet = level[: max(4, place // 2)]
    usual = float(np.median(quiet))
    scatter = 1.4826 * float(np.median(np.abs(quiet - usual)))
    below = np.flatnonzero(level[:place] < usual + 5 * scatter)
    first = int(below[-1]) + 1 if len(below) else place
    return first if place - first > 12 and len(quiet) >= 12 else None


def _first_move(values: np.ndarray, coarse: int, window: int, turn: int, white: float) -> int:
    """The sample at which the signal leaves its idling: beyond all it did before, smoothed over 1/40 turn."""
    sure = max(window, coarse - window // 4)
    quiet = np.arange(min(sure, coarse))[-20 * turn :]
    line = np.polynomial.Polynomial.fit(quiet, values[quiet], 1)
    width = max(1, turn // 40)
    stop = min(len(values), coarse + 2 * window)
    # only samples up to the present are averaged, so that the step is not seen before it came
    area = np.arange(max(0, quiet[0] - width), stop)
    rest = np.convolve(values[area] - line(area), np.ones(width) / width, "full")[: len(area)]
    before = rest[(area >= quiet[0] + width) & (area < sure)]
    spread = float(before.std()) if len(before) > 8 else 0.0
    limit = max(4.5 * spread, 1.15 * float(np.abs(before).max(initial=0.0)), 1.5 * white)
    beyond = np.flatnonzero((np.abs(rest) > limit) & (area >= sure))
    if not len(beyond):
        return coarse + window // 2
    place = int(beyond[0])
    back = np.flatnonzero(
        (np.abs(rest[:place]) < max(1.5 * spread, 0.4 * white)) | (np.sign(rest[:place]) != np.sign(rest[place]))
    )
    return max(sure, int(area[back[-1]]) - width // 2) if len(back) else int(area[place])


def _cut(values: np.ndarray, exact_turn: float, lag: float) -> list[Place]:
    """Segments of a cut as samples; `lag` is one mains period where a hum covers the noise, else 0."""
    end, turn = len(values), max(8, round(exact_turn))
    white = max(white_noise(values), _RESOLVED * float(np.ptp(values)))
    raw, values, backwards = values, without_hum(values, lag), without_hum(values[::-1], lag)
    entry, still = _first_cut(values, exact_turn, white)
    quiet_after = end - _idle_end(backwards[:end - entry], turn, white)  # before, an old motion may die away
    idled = still and entry > 2 * turn
    idle_level = float(np.median(_levels(values[:entry], turn).level)) if idled else white
    if quiet_after >= end or idled and _is_loud(values[quiet_after:], turn, idle_level):
        quiet_after = _faded(values, turn, idle_level)  # from behind, a ring-down creeps up like idling
    if quiet_after - entry < 2 * turn:
        return [("idle", 0, end)] if entry or quiet_after < end else [("steady", 0, end)]
    ring = free_decay_start(backwards[::-1][entry : min(quiet_after, end - math.ceil(lag))], exact_turn, max(idle_level, white))
    left = quiet_after if ring is None else entry + ring
    steady, leaving = _settled(raw[entry:left], exact_turn, white)
    steady, leaving = entry + steady, entry + leaving
    return still_cutting([
        ("idle", 0, entry),
        ("entry", entry, steady),
        ("steady", steady, leaving),
        ("exit", leaving, left),
        ("ring-down", left, quiet_after),
        ("idle", quiet_after, end),
    ], raw, exact_turn)  # fmt: skip


def _first_cut(values: np.ndarray, exact_turn: float, white: float) -> tuple[int, bool]:
    """(samples before a tooth cuts, whether they are still); 0 where the record starts in the cut.

    They are not where the structure still rings from before, louder perhaps than it will under the teeth.
    """
    turn = max(8, round(exact_turn))
    entry = _idle_end(values, turn, white)
    if entry:
        return entry, True
    died = free_decay_end(values, exact_turn, white) or 0
    return (died + _idle_end(values[died:], turn, white) if died else 0), False


def _faded(values: np.ndarray, turn: int, idle_level: float) -> int:
    """Where the tail has died away to the level of idling; the record's end where it never does."""
    levels = _levels(values, turn)
    loud = np.flatnonzero(levels.level > _QUIET * idle_level)
    if not len(loud) or loud[-1] >= len(levels.level) - 8:
        return len(values)
    return int(levels.first[loud[-1]] + levels.window)


def _is_loud(values: np.ndarray, turn: int, idle_level: float) -> bool:
    """Whether samples taken for idling, from behind, are loud after they were quiet, or often: a cut and its ring-down."""
    level = _levels(values, turn).level / max(idle_level, 1e-300) if len(values) >= turn else np.zeros(1)
    loud, quiet = level > _ABRUPT, level < _QUIET
    return bool(loud.mean() > _OFTEN or quiet.any() and loud[np.argmax(quiet) :].any())


def _median3(values: np.ndarray) -> np.ndarray:
    padded = np.concatenate([values[:1], values, values[-1:]])
    return np.median(np.stack([padded[:-2], padded[1:-1], padded[2:]]), axis=0)


def _settled(values: np.ndarray, turn: float, white: float) -> tuple[int, int]:
    """First and last sample of steady cutting: level and change a revolution stay near those of the later cut.

    The end itself twice where it never settles.
    """
    end = len(values)
    change, level = period_changes(values, turn)
    if len(level) < 6:
        return 0, end
    late = slice(len(level) // 2, max(len(level) // 2 + 1, len(level) - 2))
    usual = float(np.median(level[late]))
    spread = 1.4826 * float(np.median(np.abs(level[late] - usual)))
    near = np.abs(_median3(level) - usual) < max(0.12 * usual, 4 * spread, white)
    calm = float(np.median(change[late]))
    moving = _median3(np.concatenate([change[:1], change]))
    ragged = calm + 7 * float(np.median(np.abs(change[late] - calm)))
    near &= (moving < max(1.8 * calm, ragged, 1.3 * np.sqrt(2) * white, 0.02 * usual)) & (moving > 0.4 * calm)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
    runs = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    runs = [run for run in runs if run[1] - run[0] >= 3]
    if not runs:
        return end, end
    merged = runs[:1]
    for run in runs[1:]:  # a revolution or two outside does not end steady cutting
        if run[0] - merged[-1][1] <= 2:
            merged[-1] = (merged[-1][0], run[1])
        else:
            merged.append(run)
    first, last = max(merged, key=lambda run: run[1] - run[0])
    leaving = int(last * turn) if len(level) - last >= 2 else end
    return (int(first * turn) if first else 0), leaving


def _still(values: np.ndarray, swing: float) -> bool:
    """Whether samples before a blow show none of its swing: idling too short to be told otherwise."""
    return len(values) >= _STILL_SAMPLES and float(np.abs(values).max()) < _STILL * swing


def _tap(values: np.ndarray, turn: int) -> list[Place]:
    """Segments of a tap test: of each blow quiet, the free decay from its largest swing, quiet again."""
    if grows(values) is not None:
        first = _idle_end(values, turn, white_noise(values))
        return [("idle", 0, first), ("ring-down", first, len(values))]
    blows = [(first, _blow(values[first:last], turn)) for first, last in decays(values)]
    return [(kind, first + start, first + stop) for first, parts in blows for kind, start, stop in parts]


def _blow(values: np.ndarray, turn: int) -> list[Place]:
    """The same of one blow; between quiet and decay lies the blow itself."""
    white = white_noise(values)
    line = np.median(values)
    largest, struck = int(np.argmax(np.abs(values - line))), find_blows(values)[:1]
    before = _idle_end(values, turn, white) if largest > 8 * turn else 0
    still = _still(values[: largest // 2] - line, abs(float(values[largest] - line)))
    quiet = min(struck[0] if struck else before or (max(0, largest - turn) if still else 0), largest)
    first = largest if quiet and not before else min(before, largest)
    idle_level = float(np.median(_levels(values[:quiet], turn).level)) if quiet > 2 * turn else white
    stop = _faded(values, turn, max(idle_level, white))
    return [("idle", 0, min(quiet, first)), ("ring-down", first, max(stop, first)), ("idle", max(stop, first), len(values))]
