"""How much a set of residuals says: the number of independent values in them, and the Bayesian information criterion."""

from __future__ import annotations

import math

import numpy as np

from analysis.waveform import WaveformFit

DELTA_BIC = 10.0  # gain in the criterion from which something is worth having: very strong evidence


def effective_size(fit: WaveformFit) -> float:
    """Number of independent residuals, from their autocorrelation up to where it first dies away."""
    total = 0.0
    for rest in fit.residuals:
        values = rest - rest.mean()
        power = np.abs(np.fft.rfft(values, 2 * len(values))) ** 2
        correlation = np.fft.irfft(power)[: len(values)]
        correlation = correlation / correlation[0] if correlation[0] > 0 else correlation
        negative = np.flatnonzero(correlation <= 0.05)
        last = int(negative[0]) if len(negative) else len(values)
        total += len(values) / (1.0 + 2.0 * float(correlation[1:last].sum()))
    return max(total, 10.0)


def bic(fit: WaveformFit, size: float) -> float:
    """Bayesian information criterion with the noise's variance unknown, on `size` independent values.

    Counted are the shared unknowns and what every record has for itself, an effect's phase for instance.
    """
    count = sum(rest.size for rest in fit.residuals)
    unknowns = len(fit.names) + sum(part.own.shape[1] for part in fit.parts)
    return size * math.log(max(fit.squares, 1e-300) / count) + unknowns * math.log(size)
