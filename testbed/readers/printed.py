"""Numbers as they were printed: the unit of their last digit, and the straight lines that pass within it."""

from __future__ import annotations

import numpy as np


def resolution_of(time: np.ndarray) -> np.ndarray:
    """The unit of the last printed digit, s, of every time: of each power of ten, as exponents and significant digits are
    printed, the coarsest power of ten of which all its times are multiples."""
    size = np.abs(time)
    decade = np.floor(np.log10(np.where(size > 0, size, np.nan)))
    units = np.full(len(time), np.nan)
    for power in np.unique(decade[np.isfinite(decade)]):
        inside = np.flatnonzero(decade == power)
        units[inside] = _last_digit(time[inside[np.linspace(0, len(inside) - 1, min(len(inside), 400)).astype(int)]])
    return np.where(np.isnan(units), np.nanmin(units), units)


def _last_digit(sample: np.ndarray) -> float:
    largest = float(np.abs(sample).max())  # of one decade
    for exponent in range(-int(np.floor(np.log10(largest))), 16):
        unit = 10.0**-exponent
        if np.abs(sample / unit - np.round(sample / unit)).max() < 1e-6 + 4e-16 * largest / unit:
            return unit
    return 1e-15


def slopes_within(low: np.ndarray, high: np.ndarray) -> tuple[float, float] | None:
    """Smallest and largest slope (s a row) of a line that passes between low and high at every row; None without any."""
    rows = len(low) - 1
    ends = [_steepest(low, high, (high[-1] - low[0]) / rows, 1), _steepest(low, high, (low[-1] - high[0]) / rows, -1)]
    if ends[0] is None or ends[1] is None or not ends[1] <= ends[0]:
        return None
    return float(ends[1]), float(ends[0])


def _steepest(low: np.ndarray, high: np.ndarray, slope: float, side: int) -> float | None:
    """The extreme slope that fits, from one outside it (side 1: the largest). The room left for the line is a concave
    function of its slope, and linear between changes of the two rows that bind it: Newton's steps come to its root."""
    rows, off = np.arange(len(low)), np.empty(len(low))
    for _ in range(200):
        line = slope * rows
        first = int(np.argmax(np.subtract(low, line, out=off)))
        below = off[first]
        last = int(np.argmin(np.subtract(high, line, out=off)))
        if off[last] >= below:
            return slope
        if side * (last - first) <= 0:
            return None
        fresh = (high[last] - low[first]) / (last - first)
        if not side * (slope - fresh) > 0:  # the last digits of the numbers
            return slope
        slope = fresh
    return None
