"""Records begun afresh that stand out while the others agree down to their noise.

Near its stability limit a cut that begins or ends within an arc, fitted with whole passes, loses its course, and bends what
all share; at the machine that the others show, its course is found. Those others are the half or more that agree in the fit,
or the better half, if they agree once they are fitted alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.moves.best_half import begun_there, better_half, fitted_alone
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.record_restart import own_course
from testbed.analysis.fit.solve import Goal, Move, Trial, alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter

SOUND = 1.2  # mean square residual, in noise, up to which a record counts as explained
AGREED = 1.1  # the same of half of them, fitted alone,
LOST = 2.0  # where another has more than this: a law that is a little wrong leaves a little more of all
LATE = 4.0  # standard errors of a mean square, by which a record that starts in its cut is off
FEWEST = 3  # such records, that the course of others may be found again by them


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with those records begun afresh."""
    left = fit.mean_squares
    kept = [int(place) for place in np.flatnonzero(left <= SOUND) if not _late_and_off(fitter.records[place], left, int(place))]
    if len(kept) == len(left):
        return
    most = SOUND
    if len(kept) < len(left) / 2.0 and left.max() > LOST:
        kept, most = better_half(left), AGREED
    if len(kept) < max(FEWEST, len(left) / 2.0):
        return
    alone = fitted_alone(fitter, fit, kept, most)
    if alone.mean_squares.max() <= most:
        begun = begun_there(fit, kept, alone.state, lambda place, state: own_course(fitter, place, state).nuisances[0])
        yield Trial(fitter, alternate_fit_and_passes(fitter, begun))


MOVE = Move(propose)


def _late_and_off(record: Observed, left: np.ndarray, place: int) -> bool:
    """Whether a record that starts in its cut leaves more of itself than the median record does, beyond chance."""
    return record.starts_in_cut and left[place] > float(np.median(left)) * (1.0 + LATE * math.sqrt(2.0 / record.size))
