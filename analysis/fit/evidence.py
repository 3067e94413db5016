"""How much the residuals of a fit say: the independent values in them, and the Bayesian information criterion."""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.information import autocorrelation, independent

DELTA_BIC = 10.0  # gain in the criterion from which something is worth having: very strong evidence


def noise_cost(fitter: Fitter) -> float:
    """What the noise of the records costs, in units of their scale."""
    return 0.5 * sum(one.count * float(np.sum((one.noise / one.scale) ** 2)) for one in fitter.records)


def excess(fitter: Fitter, cost: float) -> float:
    """What a cost is beyond that of the noise."""
    return max(cost - noise_cost(fitter), 0.0)


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
