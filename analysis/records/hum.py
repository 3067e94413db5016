"""Mains hum in a record: whether it covers the noise, and the record without it."""

from __future__ import annotations

import numpy as np

MAINS = (50.0, 60.0)  # Hz
MOST_PERIODS = 8  # apart, at which a hum still agrees with itself: a motion near to one of its lines does so over one period


def without_hum(values: np.ndarray, lag: int) -> np.ndarray:
    """x(t) - x(t - lag): with a lag of one mains period, what is left without a hum and all its harmonics.

    Nothing is seen before it came; `lag` 0 returns the values.
    """
    if lag == 0:
        return values
    change = values[lag:] - values[:-lag]
    return np.concatenate([change[:lag], change])


def hum_lag(values: np.ndarray, rate: float, turn: float) -> int:
    """Samples of one mains period (50 or 60 Hz) where the front of the record is mostly hum, else 0.

    Not where the spindle itself turns at the mains frequency, which could not be told apart.
    """
    front = values[: max(len(values) // 12, 8 * round(turn))]
    for mains in MAINS:
        lag = round(rate / mains)
        if len(front) < 4 * lag or lag < 4 or abs(rate / mains - lag) > 0.02 or _whole(mains * turn / rate):
            continue
        flat = front - np.polynomial.Polynomial.fit(np.arange(len(front)), front, 2)(np.arange(len(front)))
        halves = np.var(flat[: len(flat) // 2]), np.var(flat[len(flat) // 2 :])
        if max(halves) > 1.6 * min(halves):
            return 0  # idling among hum is even; this is a motion that grows or dies
        periods = range(1, min(MOST_PERIODS, len(flat) // (2 * lag)) + 1)
        if all(np.var(flat[count * lag :] - flat[: -count * lag]) < 0.7 * np.var(flat) for count in periods):
            return lag
    return 0


def _whole(number: float) -> bool:
    """Whether revolutions and mains periods fall together, once or at a small multiple."""
    return any(abs(number * part - round(number * part)) < 0.04 * part and round(number * part) for part in (1, 2))
