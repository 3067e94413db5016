"""A cut laid out by revolutions: what repeats with the spindle, and the lines of what does not, in orders of the spindle.

What repeats is taken out as the mean revolution, which leaves lines between the orders as they are: nothing of a loud tooth
passing leaks into them, and one that lies a bin from an order is still seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import median_filter

from testbed.analysis.records.spindle_clock import along_marks
from testbed.analysis.records.spindle_clock import turns_of as turns_from_first

PADDED = 4  # times as long as the revolutions: points of the spectrum to a bin
WIDE = 12  # bins to either side, of which the floor is the median
FEWEST_MARKS = 4
PIECE, OVERLAP = 1 << 18, 64  # places found at once; samples to either side, behind which a spline is that of all samples


@dataclass(frozen=True)
class Turns:
    """Revolutions of a channel: rows (revolutions, samples a revolution), the duration of one (s), start of the first (s)."""

    rows: np.ndarray
    period: float
    start: float

    @property
    def pattern(self) -> np.ndarray:
        """What repeats: the mean revolution about its mean, (samples,)."""
        mean = self.rows.mean(axis=0)
        return np.asarray(mean - mean.mean())

    def amplitudes(self) -> np.ndarray:
        """Amplitude of the repeating part at the orders 0, 1, 2, ... of the spindle."""
        return np.abs(np.fft.rfft(self.pattern)) * 2.0 / self.rows.shape[1]

    def last(self, count: int) -> Turns:
        """The last revolutions."""
        skipped = len(self.rows) - count
        return Turns(self.rows[skipped:], self.period, self.start + skipped * self.period)


def turns_of(values: np.ndarray, time: np.ndarray, marks: np.ndarray, period: float) -> Turns:
    """The whole revolutions of samples (samples,) at `time` (s), the last ending with them, by the marks or the period (s)."""
    rate = (len(time) - 1) / (time[-1] - time[0])
    per_turn = max(16, int(np.ceil(rate * period)))
    count = int((time[-1] - time[0]) / period)
    if len(marks) >= FEWEST_MARKS:
        beyond = (time[-1] - np.clip(time[-1], marks[0], marks[-1])) / period
        places = np.interp(time[-1], marks, turns_from_first(marks)) + beyond
        wanted = along_marks(marks, places - count + np.arange(count * per_turn) / per_turn, period)
    else:
        wanted = time[-1] - count * period + np.arange(count * per_turn) * period / per_turn
    wanted = wanted[per_turn * int(np.sum(wanted[::per_turn] < time[0])):] if count else wanted
    rows = _between(time, values, wanted).reshape(-1, per_turn)
    return Turns(rows, period, float(wanted[0]) if len(wanted) else float(time[-1]))


def _between(time: np.ndarray, values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Cubic splines through samples, at rising times: piece by piece, since a spline takes twenty times what it joins."""
    found = np.empty(len(wanted))
    for first in range(0, len(wanted), PIECE):
        piece = slice(first, first + PIECE)
        begin, end = np.searchsorted(time, (wanted[piece][0], wanted[piece][-1])) + (-OVERLAP, OVERLAP)
        samples = slice(max(0, begin), end) if len(wanted) > PIECE else slice(None)
        found[piece] = CubicSpline(time[samples], values[samples])(wanted[piece])
    return found


def spectrum(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(complex amplitudes, the floor about each) of samples (samples,) under a Hann window, PADDED points to a bin."""
    size = len(values)
    window = np.hanning(size)
    place = np.linspace(-1.0, 1.0, size)
    flat = values - np.polynomial.Polynomial.fit(place, values, 1)(place)
    lines = np.fft.rfft(flat * window, PADDED * size) * 2.0 / window.sum()
    floor = median_filter(np.abs(lines), size=min(len(lines) // 4 * 2 + 1, 2 * WIDE * PADDED + 1), mode="nearest")
    return lines, np.maximum(floor, 1e-300)


def level_at(lines: np.ndarray, place: float, reach: float) -> float:
    """Largest amplitude of a spectrum within `reach` of a place, both in its points."""
    first, last = max(0, int(np.ceil(place - reach))), min(len(lines), int(place + reach) + 1)
    return float(np.abs(lines[first:last]).max()) if last > first else 0.0
