"""A record cut into revolutions of any length in samples: how much each differs from the one before."""

from __future__ import annotations

import numpy as np


def revolutions(values: np.ndarray, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """A record laid out by revolutions of `turn` samples: (rows (revolutions, int(turn)), gains (revolutions,)).

    Samples between the grid are interpolated by four-point Lagrange weights; gains are their effect on white noise's power.
    """
    count = max(0, int((len(values) - 3) // turn))  # none in the scrap of a cut
    length = int(turn)
    rows, gains = np.empty((count, length)), np.empty(count)
    for index in range(count):
        first = index * turn + 1
        whole, part = int(first), first - int(first)
        weights = lagrange_weights(part)
        block = values[whole - 1 : whole + length + 2]
        if len(block) < length + 3:
            return rows[:index], gains[:index]
        rows[index] = np.convolve(block, weights[::-1], "valid")[:length]
        gains[index] = float(weights @ weights)
    return rows, gains


def period_changes(values: np.ndarray, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """Each revolution's rms change against the one before, and its level (rms about its mean), both (revolutions,).

    The interpolation's gain on white noise is divided out.
    """
    rows, gains = revolutions(values, turn)
    level = rows.std(axis=1)
    change = (
        np.sqrt(((rows[1:] - rows[:-1]) ** 2).mean(axis=1) * 2 / (gains[1:] + gains[:-1]))
        if len(rows) > 1
        else np.empty(0)
    )
    return change, level


def lagrange_weights(part: float) -> np.ndarray:
    """Weights of the samples at -1, 0, 1, 2 for a value at `part` (0 to 1), shape (4,)."""
    p = part
    return np.array(
        [
            -p * (p - 1) * (p - 2) / 6,
            (p + 1) * (p - 1) * (p - 2) / 2,
            -(p + 1) * p * (p - 2) / 2,
            (p + 1) * p * (p - 1) / 6,
        ]
    )
