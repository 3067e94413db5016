"""Marks of a tachometer: the instants of its edges, found between the samples, one a revolution."""

from __future__ import annotations

import numpy as np

EDGE = 3e-4  # of a gap: how far an edge may come early or late in all revolutions alike
UNEVEN = 6.0  # standard errors by which the gaps between slots must differ, to tell the slots apart
IRREGULAR = 0.3  # share of neighbouring periods that differ by half, above which the edges are no pulses of a spindle


def edges(values: np.ndarray, rate: float, start: float = 0.0, *, rising: bool = True) -> np.ndarray:
    """Times (s) at which a pulse signal passes half its swing, by linear interpolation between two samples.

    values: (samples,), any unit. The levels are the outermost quantiles, so that a pulse of 0.3 % duty is still seen;
    a crossing counts once the signal has been a fifth of the swing beyond either side (no double marks from noise).
    """
    signal = np.asarray(values, dtype=float) if rising else -np.asarray(values, dtype=float)
    low, high = np.quantile(signal, [0.002, 0.998])
    if high - low <= 0 or _unclear(signal, low, high):
        low, high = float(signal.min()), float(signal.max())
    swing = high - low
    if swing <= 0:
        return np.empty(0)
    middle = 0.5 * (low + high)
    state = np.zeros(len(signal), dtype=np.int8)
    state[signal > middle + 0.2 * swing] = 1
    state[signal < middle - 0.2 * swing] = -1
    known = np.flatnonzero(state)
    if len(known) == 0:
        return np.empty(0)
    risen = np.flatnonzero((state[known[:-1]] == -1) & (state[known[1:]] == 1))
    found = []
    for place in risen:
        first, last = known[place], known[place + 1]
        inside = signal[first : last + 1]
        # the last passage of the middle before the signal stays high
        below = first + int(np.flatnonzero(inside[:-1] <= middle)[-1])
        step = signal[below + 1] - signal[below]
        found.append(below + (middle - signal[below]) / step)
    return start + np.array(found) / rate


def _unclear(signal: np.ndarray, low: float, high: float) -> bool:
    """Whether the quantiles missed pulses that are rarer than they look."""
    return float(signal.max() - signal.min()) > 3 * (high - low)


def _irregular(periods: np.ndarray) -> bool:
    """Whether neighbouring periods differ as those of mere noise do (of a spindle that stands still), and not now and then."""
    ratio = periods[1:] / periods[:-1]
    return len(ratio) >= 8 and float(np.mean((ratio > 1.5) | (ratio < 1 / 1.5))) > IRREGULAR


def marks(
    values: np.ndarray, rate: float, start: float = 0.0, *, rising: bool = True, pulses_per_revolution: int = 1
) -> tuple[np.ndarray, int, list[str]]:
    """One mark a revolution (s), of how many slots they may be any, and notes: too few marks, lost or extra pulses, an
    unsteady speed."""
    found, slots = same_slot(edges(values, rate, start, rising=rising), max(1, pulses_per_revolution))
    if len(found) < 3:
        return found, slots, [f"tachometer: {len(found)} marks only, so that it gives no speed"]
    notes = []
    periods = np.diff(found)
    if _irregular(periods):
        note = "tachometer: no regular pulses (spindle at rest, noise, uneven marks), so that it gives no speed"
        return np.empty(0), slots, [note]
    usual = float(np.median(periods))
    lost, extra = int((periods > 1.5 * usual).sum()), int((periods < 0.6 * usual).sum())
    if lost or extra:
        notes.append(
            f"tachometer: {lost} gaps and {extra} short periods among {len(periods)} revolutions: "
            "marks were lost or added"
        )
    spread = float(np.quantile(np.abs(periods / usual - 1), 0.9))
    if spread > 0.02:
        notes.append(f"tachometer: the speed varies by {100 * spread:.2g} %")
    return found, slots, notes


def same_slot(found: np.ndarray, slots: int) -> tuple[np.ndarray, int]:
    """(edges of one of the spindle's slots, of how many it may be any): 1 where the slots are uneven.

    The gaps then tell which slot it is, the same one in every record; of even slots, it is the record's first.
    """
    gaps = np.diff(found)
    if slots == 1 or len(gaps) < 3 * slots:
        return found[::slots], slots
    middles = np.array([np.median(gaps[first::slots]) for first in range(slots)])
    scatter = max(float(np.median(np.abs(gaps[first::slots] - middles[first]))) for first in range(slots))
    weights = np.arange(slots)[::-1]
    scores = np.array([weights @ np.roll(middles, -first) for first in range(slots)])  # long gaps first
    second, best = np.sort(scores)[-2:]
    error = 1.4826 * scatter * np.sqrt(slots / len(gaps)) + EDGE * float(middles.mean())
    uneven = best - second > UNEVEN * error
    return (found[int(np.argmax(scores)) :: slots], 1) if uneven else (found[::slots], slots)


def speed(found: np.ndarray) -> float | None:
    """Spindle speed (rad/s) from marks once a revolution: the median period refined over all of them; None below 3."""
    if len(found) < 3:
        return None
    periods = np.diff(found)
    usual = float(np.median(periods))
    turns = np.round(periods / usual)
    turns[turns < 1] = 0
    if turns.sum() < 1:
        return None
    good = np.abs(periods / usual - turns) < 0.2
    return float(2 * np.pi * turns[good].sum() / periods[good].sum()) if good.any() else 2 * np.pi / usual
