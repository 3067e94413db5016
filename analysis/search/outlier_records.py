"""Records that have no say in a fit, because no model follows them while the others agree.

A strong vibration may be chaotic: two that begin a nanometre apart have nothing in common a hundred turns later. Another
record may be disturbed. Such a one rules a least-squares fit and takes every parameter astray. It is still predicted, and its
error told.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.held_out import errors_in_fit
from testbed.analysis.fit.moves.best_half import begun_there
from testbed.analysis.fit.record_restart import own_course
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter

LOUD = 4.0  # mean square residual over the median record's, from which a record is doubted
SOUND = 1.15  # mean square residual, in noise, up to which a record counts as explained
MOST = 0.3  # share of the records that may be without a say
FEWEST = 3  # records that must be left
MUTE = 1e9  # times its own size that such a record's scale is


def agreed(fitter: Fitter, fit: WaveformFit, suspect: int | None = None) -> tuple[Fitter, WaveformFit]:
    """The fit of those records that agree down to their noise, where a few that stand far out bend it; else the fit itself.

    suspect: the place of the one record that is doubted instead of those that stand out.
    """
    left = fit.mean_squares
    loud = left > LOUD * max(float(np.median(left)), 1.0) if suspect is None else np.arange(len(left)) == suspect
    kept = [int(place) for place in np.flatnonzero(~loud)]
    if not loud.any() or loud.sum() > MOST * len(left) or len(kept) < FEWEST:
        return fitter, fit
    alone = alternate_fit_and_passes(fitter.of_records(kept), fit.state.of_records(kept))
    if alone.mean_squares.max() > SOUND:
        return fitter, fit
    state = begun_there(fit, kept, alone.state, lambda place, state: own_course(fitter, place, state).nuisances[0])
    strange = [int(place) for place in np.flatnonzero(loud) if still_loud(fitter, int(place), state)]
    if not strange:  # but its passes were wrong
        return fitter, min(fit, alternate_fit_and_passes(fitter, state), key=lambda one: one.cost)
    records = list(fitter.records)
    for place in strange:
        size = np.maximum(records[place].data.std(axis=1), records[place].noise)
        records[place] = replace(records[place], weight=MUTE * size, in_fit=False)
    wider = fitter.on(records)
    return wider, wider.fit(state, iterations=4)


def still_loud(fitter: Fitter, place: int, state: State) -> bool:
    """Whether the record at `place` still has a mean square residual, in noise, above that from which it is doubted."""
    return float(np.mean(fitter.residual_of(place, state) ** 2)) > LOUD


def misfit(fitter: Fitter, fit: WaveformFit) -> tuple[float, float]:
    """(minus twice the log likelihood with a variance for every record, mean square residual in noise of the worst).

    The first is hardly touched by a record that no model follows.
    """
    left = [one.squares / one.noise_squares for one in errors_in_fit(fitter, fit)]
    likelihood = sum(rest.size * math.log(max(one, 1e-300)) for rest, one in zip(fit.residuals, left, strict=True))
    return likelihood, max(left)
