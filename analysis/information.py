"""How much a set of residuals says: the number of independent values in them, the Bayesian information criterion, and how
many standard errors an interval reaches.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analysis.fit_state import WaveformFit

Z_95 = 1.959964  # standard errors to either side within which 95 % of a normal distribution lie
DELTA_BIC = 10.0  # gain in the criterion from which something is worth having: very strong evidence


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


def effective_size(fit: WaveformFit) -> float:
    """Number of independent residuals of all records."""
    return max(sum(independent(autocorrelation(rest)) for rest in fit.residuals), 10.0)


def bic(fit: WaveformFit, size: float) -> float:
    """Bayesian information criterion with the noise's variance unknown, on `size` independent values.

    Counted are the shared unknowns and what every record has for itself, an effect's phase for instance.
    """
    count = sum(rest.size for rest in fit.residuals)
    unknowns = len(fit.names) + sum(part.own.shape[1] for part in fit.parts)
    return size * math.log(max(fit.squares, 1e-300) / count) + unknowns * math.log(size)
