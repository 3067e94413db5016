"""A window of a signal in a few numbers, for the simple classifier of chatter that a better one has to beat.

Chatter vibrates between the harmonics of the tooth passing, a stable cut at them, a free structure at one frequency that dies
away. Only the samples and the conditions are looked at, never where in its run a window lies.
"""

from __future__ import annotations

import math

import numpy as np

FEATURES = ("log rms", "log growth of the rms", "kurtosis", "share of power at tooth harmonics",
            "share at other harmonics of the spindle", "share half-way between tooth harmonics",
            "share of the strongest line off the harmonics", "log frequency of that line",
            "log spindle speed", "log axial depth of cut", "log feed per tooth")
NEAR = 0.06  # of the tooth passing frequency: what is as near to a harmonic counts as at it
HALF_WAY = 0.44  # of it: what is farther off


def window_features(values: np.ndarray, rate: float, speed: float, depth: float, feed: float, flutes: int) -> np.ndarray:
    """The features (F,) of samples (n,) at `rate` (Hz); speed rad/s, depth and feed m. NaN for fewer than 32 samples."""
    values = np.asarray(values, float)
    if values.size < 32:
        return np.full(len(FEATURES), np.nan)
    values = values - values.mean()
    half = values.size // 2
    level, early, late = (float(np.sqrt(np.mean(part**2))) + 1e-300 for part in (values, values[:half], values[half:]))
    return np.array([math.log(level), math.log(late / early), float(np.mean((values / level) ** 4)),
                     *_shares(values, rate, speed * flutes / (2 * math.pi), flutes),
                     math.log(speed), math.log(max(depth, 1e-9)), math.log(feed)])


def _shares(values: np.ndarray, rate: float, tooth: float, flutes: int) -> tuple[float, ...]:
    """Shares of the power at, half-way between and off the tooth harmonics; the strongest line off them, and its frequency."""
    power = np.abs(np.fft.rfft(values * np.hanning(values.size))) ** 2
    frequency = np.fft.rfftfreq(values.size, 1.0 / rate)
    away = np.abs(frequency / tooth - np.round(frequency / tooth))
    turn = flutes * frequency / tooth
    at_tooth, at_turn = away <= NEAR, np.abs(turn - np.round(turn)) <= NEAR
    total = float(power.sum()) + 1e-300
    off = np.where(at_tooth, 0.0, power)
    peak = 1 + int(np.argmax(off[1:]))
    return (float(power[at_tooth].sum()) / total, float(power[at_turn & ~at_tooth].sum()) / total,
            float(power[away >= HALF_WAY].sum()) / total, float(off[max(peak - 2, 0):peak + 3].sum()) / total,
            math.log(frequency[peak] / rate))
