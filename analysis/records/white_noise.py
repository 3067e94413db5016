"""White noise in a record of anything: how loud it is, and whether that can be told from a motion as fast as the sampling."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_FOURTH, _SIXTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0]), np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0])
_FEWEST = 16  # samples, without which nothing is told
_QUIET_PARTS, _QUIET_SAMPLES = 32, 64  # a record is cut into so many parts, of so many samples at the least
_FLAT_SAMPLES = 512  # samples whose spectrum shows whether its floor is flat
_SLOWEST_LINES = 6  # of a spectrum, in which drift lies
_QUANTILES = np.array([0.1, 0.25, 0.5])  # of the spectrum's power, which tell the same level where its floor is white noise
_SPREAD = np.array([3.15, 2.0, 1.44])  # standard errors of those levels times the root of the lines' number
_SURE, _UNLIKE = 3.5, 1.25  # standard errors, and a ratio of powers, by which levels differ beyond chance
_CONTRADICTS = 1.3  # ratio of two readings of the same noise, of which the larger then holds motion
_OWN_RMS = 0.5  # of the quietest part's rms: a reading above may be that part's motion
SAME_VALUE = 1e-9  # of a channel's range, within which two values are one step of its converter


@dataclass(frozen=True)
class WhiteNoise:
    """rms of the white noise (the signal's unit); known is False where it is but the most that the noise can be."""

    rms: float
    known: bool


def white_noise(values: np.ndarray) -> float:
    """Standard deviation of the white part of a signal (samples,), its own unit: at most this, where it cannot be told."""
    return read_white_noise(values).rms


def read_white_noise(values: np.ndarray) -> WhiteNoise:
    """The white part of a signal, from fourth differences, which a slow motion does not reach.

    A motion near half the sampling rate does. Then the floor of the spectrum tells it, where it is that of white noise. The
    quietest part of the record is as loud as its noise at least, and noise is never below the converter's rounding.
    """
    if len(values) < _FEWEST:
        return WhiteNoise(0.0, False)
    level, finer = _by_differences(values, _FOURTH), _by_differences(values, _SIXTH)
    smooth = level < _CONTRADICTS * finer  # no motion, but for one near half the rate
    level = level if smooth else finer
    floor, step = _flat_floor(values), rounding(values)
    if floor is not None and floor * _CONTRADICTS < level:
        level = floor
    quiet, count = _quietest_part(values)
    known = smooth and level <= _OWN_RMS * quiet or floor is not None and level < _CONTRADICTS * floor
    return WhiteNoise(max(min(level, quiet * (1.0 + _SURE / math.sqrt(count))), step), known or level <= step)


def _by_differences(values: np.ndarray, weights: np.ndarray) -> float:
    """rms of white noise, by the median size of such differences of neighbours."""
    left = np.convolve(values, weights, "valid")
    return float(1.4826 * np.median(np.abs(left - np.median(left))) / math.sqrt(float(weights @ weights)))


def rounding(values: np.ndarray) -> float:
    """rms error of rounding to the converter's step, its own unit: what noise cannot be below, however quiet the idle."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > SAME_VALUE * float(np.ptp(values))]
    return float(steps.min()) / math.sqrt(12.0) if len(steps) else 0.0


def _quietest_part(values: np.ndarray) -> tuple[float, int]:
    """(the least rms about a straight line of a part that is not constant, samples of a part)."""
    length = min(len(values), max(_QUIET_SAMPLES, len(values) // _QUIET_PARTS))
    rows = values[: len(values) // length * length].reshape(-1, length)
    time = np.arange(length) - 0.5 * (length - 1)
    rows = rows - rows.mean(axis=1, keepdims=True)
    squares = (rows**2).sum(axis=1) - (rows @ time) ** 2 / (time @ time)
    moving = squares[squares > 0.0]
    return (math.sqrt(float(moving.min()) / max(1, length - 2)) if len(moving) else 0.0), length


def _flat_floor(values: np.ndarray) -> float | None:
    """rms of white noise by the floor of the spectrum; None where that floor is none of white noise.

    The power of its lines is distributed exponentially about one level: its lower quantiles, which lines of a motion do not
    reach, must all tell that level.
    """
    if len(values) < _FLAT_SAMPLES:
        return None
    place = np.linspace(-1.0, 1.0, len(values))
    window = np.hanning(len(values))
    flat = values - np.polynomial.Polynomial.fit(place, values, 2)(place)
    power = np.abs(np.fft.rfft(flat * window)[_SLOWEST_LINES:-1]) ** 2 / float(window @ window)
    levels = np.quantile(power, _QUANTILES) / -np.log1p(-_QUANTILES)
    if not levels.min() > 0.0:
        return None
    lines = len(power) / 1.5  # neighbours share what a Hann window smears
    spread = _SURE * np.hypot(_SPREAD[:-1], _SPREAD[-1]) / math.sqrt(lines)
    away = np.abs(np.log(levels[:-1] / levels[-1]))
    return math.sqrt(float(levels[-1])) if (away < math.log(_UNLIKE) + spread).all() else None
