"""Mains hum in a record: whether it covers the noise, and the record without it."""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.records.periods import lagrange_weights

MAINS = (50.0, 60.0)  # Hz
MOST_PERIODS = 8  # apart, at which a hum still agrees with itself: a motion near to one of its lines does so over one period


LEAST_LAG = 40.0  # samples of a mains period, from which one between samples is met: 6 to a period of its seventh harmonic
ON_SAMPLES = 0.02  # samples, within which a mains period counts as whole


def without_hum(values: np.ndarray, lag: float) -> np.ndarray:
    """x(t) - x(t - lag): with a lag (samples) of one mains period, what is left without a hum and all its harmonics.

    Nothing is seen before it came; `lag` 0 returns the values.
    """
    if lag == 0:
        return values
    change = _changes(values, lag)
    return np.concatenate([change[: len(values) - len(change)], change])


def _changes(values: np.ndarray, lag: float) -> np.ndarray:
    """x(t) - x(t - lag) from the first sample on that has one a lag before; four-point Lagrange between samples."""
    whole = math.ceil(lag)
    part = whole - lag  # the value a lag before lies so far behind sample -whole
    if part < ON_SAMPLES or part > 1.0 - ON_SAMPLES:
        whole = round(lag)
        return np.asarray(values[whole:] - values[:-whole])
    before = np.convolve(values, lagrange_weights(part)[::-1], "valid")  # at the samples 1, 2, ... plus the part
    first = whole + 1
    return np.asarray(values[first:] - before[: len(values) - first])


def hum_lag(values: np.ndarray, rate: float, turn: float) -> float:
    """Samples of one mains period (50 or 60 Hz) where the front of the record is mostly hum, else 0.

    Not where the spindle itself turns at the mains frequency, which could not be told apart.
    """
    front = values[: max(len(values) // 12, 8 * round(turn))]
    for mains in MAINS:
        lag = rate / mains
        whole = abs(lag - round(lag)) < ON_SAMPLES
        lag = float(round(lag)) if whole else lag
        if len(front) < 4 * lag or lag < (4 if whole else LEAST_LAG) or _whole(mains * turn / rate):
            continue
        flat = front - np.polynomial.Polynomial.fit(np.arange(len(front)), front, 2)(np.arange(len(front)))
        halves = np.var(flat[: len(flat) // 2]), np.var(flat[len(flat) // 2 :])
        if max(halves) > 1.6 * min(halves):
            return 0  # idling among hum is even; this is a motion that grows or dies
        periods = range(1, min(MOST_PERIODS, int(len(flat) // (2 * lag))) + 1)
        if all(np.var(_changes(flat, count * lag)) < 0.7 * np.var(flat) for count in periods):
            return lag
    return 0


def _whole(number: float) -> bool:
    """Whether revolutions and mains periods fall together, once or at a small multiple."""
    return any(abs(number * part - round(number * part)) < 0.04 * part and round(number * part) for part in (1, 2))
