"""How much a series of values says: the number of independent ones in it, and how many standard errors an interval reaches."""

from __future__ import annotations

import numpy as np

Z_95 = 1.959964  # standard errors to either side within which 95 % of a normal distribution lie


def autocorrelation(values: np.ndarray) -> np.ndarray:
    """Autocorrelation (samples,) of values about their mean, at lags from 0 on."""
    power = np.abs(np.fft.rfft(values - values.mean(), 2 * len(values))) ** 2
    correlation = np.fft.irfft(power)[: len(values)]
    return correlation / max(float(correlation[0]), 1e-300)


def independent(correlation: np.ndarray) -> float:
    """Number of independent values among those of this autocorrelation, which counts up to where it first dies away."""
    low = np.flatnonzero(correlation <= 0.05)
    last = int(low[0]) if len(low) else len(correlation)
    return len(correlation) / (1.0 + 2.0 * float(correlation[1:last].sum()))
