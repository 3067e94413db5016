"""Weights of the records while much is missing: what a rough model leaves of each, in place of its noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.moves import PARTS
from testbed.analysis.fit.solve import alternate_fit_and_passes, solve
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.candidate_round import candidate_of

ROUGH = 8.0  # error over noise floor from which records are weighed by what is left of them,
STILL_ROUGH = 3.0  # and, once they were, from which they still are: else the quiet records take over half way


def reweighted(current: Candidate) -> Candidate:
    """The current set with records weighed by what it leaves of them, where that is far more than noise; else by the noise.

    A model that is rough everywhere would otherwise be fitted to the quietest record alone, and candidates with it.
    """
    records = current.fitter.records
    plain = all(record.weight is None for record in records)
    rough = current.error_held_out > (ROUGH if plain else STILL_ROUGH) * pooled(current.errors)[1]
    if not rough and plain:
        return current
    weighed = []
    for record, rest in zip(records, current.fit.residuals, strict=True):
        left = np.sqrt(np.mean((rest.reshape(len(record.channels), -1) * record.scale[:, None]) ** 2, axis=1))
        weighed.append(replace(record, weight=np.hypot(record.noise, left) if rough else None))
    fitter = current.fitter.on(weighed)
    fit = alternate_fit_and_passes(fitter, current.fit.state, rounds=2, iterations=20)
    if not rough:
        fitter, fit = solve(fitter, fit, PARTS)  # such weights hid what a cut that begins within an arc leaves
    return replace(candidate_of(fitter, fit, current.effects, None, 1.0), delta_bic=current.delta_bic)
