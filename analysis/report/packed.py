"""Rows of numbers as a page carries them: 16-bit counts with a scale, and long signals as their envelope."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

_COUNTS = 32766  # to either side; -32768 stands for what is not a number


def packed(values: np.ndarray, logarithmic: bool = False) -> dict[str, Any]:
    """A row (n,) as 16-bit counts between its extremes: right to 2e-5 of its range. NaN and infinities become gaps.

    logarithmic: the counts are of the decimal logarithm; what is not above 0 becomes a gap.
    """
    values = np.asarray(values, dtype=float)
    if logarithmic:
        return packed(np.log10(np.where(values > 0, values, np.nan))) | {"log": 1}
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 0.0)
    offset, scale = 0.5 * (low + high), max(high - low, 1e-300) / (2 * _COUNTS)
    counts = np.full(values.shape, -32768, dtype="<i2")
    counts[known] = np.round((values[known] - offset) / scale).astype("<i2")
    return {"i2": base64.b64encode(counts.tobytes()).decode(), "scale": scale, "offset": offset}


def even(first: float, step: float, count: int) -> dict[str, Any]:
    """An even row of numbers."""
    return {"from": float(first), "step": float(step), "n": int(count)}


def thinned(
    values: np.ndarray, start: float, rate: float, points: int, logarithmic: bool = False
) -> tuple[dict[str, Any], dict[str, Any]]:
    """(times, values) of a signal (samples,) from `start` (s) at `rate` (Hz), packed.

    A signal of more than `points` samples becomes its envelope: the lowest and the highest of every stretch, in the order
    in which they came, so that no peak is lost.
    """
    values = np.asarray(values, dtype=float)
    if len(values) <= points:
        return even(start, 1.0 / rate, len(values)), packed(values, logarithmic)
    length = -(-len(values) // (points // 2))
    rows = np.pad(values, (0, -len(values) % length), mode="edge").reshape(-1, length)
    places = np.sort(np.stack([rows.argmin(axis=1), rows.argmax(axis=1)], axis=1), axis=1)
    ends = np.take_along_axis(rows, places, axis=1).ravel()
    return even(start + 0.25 * length / rate, 0.5 * length / rate, len(ends)), packed(ends, logarithmic)


def listed(values: np.ndarray, digits: int = 5) -> list[float | None]:
    """A short row as plain numbers of a few digits; what is not finite is null."""
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in np.asarray(values, float).ravel()]
