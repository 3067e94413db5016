"""The better half of the records alone, where a few stand out, and all of them from there.

A record whose entry or exit is a pass wrong drags the coefficients to where that pass seems right; without it they are free,
and its passes are looked for again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.held_out import own_refit
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.pass_search import settle_passes
from testbed.analysis.fit.record_restart import begun_afresh
from testbed.analysis.fit.solve import Goal, Move, Trial, alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter

UNEVEN = 1.5  # mean square residual of the worst record over the median's, from which the worst are doubted
FEWEST = 4  # records, that half of them may be fitted alone


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit started again from the better half of the records."""
    left = fit.mean_squares
    if len(left) < FEWEST or left.max() < UNEVEN * float(np.median(left)):
        return
    kept = better_half(left)
    alone = fitted_alone(fitter, fit, kept).state
    begun = begun_there(fit, kept, alone, lambda place, state: begun_afresh(fitter.of_records([place]), state))
    state, _ = settle_passes(fitter, begun, reach=2)
    state = own_refit(fitter, state, [place for place in range(len(left)) if place not in kept])
    yield Trial(fitter, alternate_fit_and_passes(fitter, state, cost_limit=goal.cost_limit))


MOVE = Move(propose, repeats=2, rescues=True)


def better_half(left: np.ndarray) -> list[int]:
    """Places of the better half of the records, in their order, by the mean squares that are left of all."""
    return sorted(int(place) for place in np.argsort(left)[: (len(left) + 1) // 2])


def fitted_alone(fitter: Fitter, fit: WaveformFit, kept: Sequence[int], worth: float = math.inf) -> WaveformFit:
    """The fit of some records alone, from where the joint one ended; given up where their mean square stays above `worth`."""
    alone = fitter.of_records(kept)
    cost_limit = 0.5 * worth * sum(record.size for record in alone.records)
    return alternate_fit_and_passes(alone, fit.state.of_records(kept), rounds=2, iterations=12, cost_limit=cost_limit)


def begun_there(fit: WaveformFit, kept: Sequence[int], found: State, begin: Callable[[int, State], Nuisances]) -> State:
    """The state of some records fitted alone, each other begun at their machine: begin(place, its state alone) -> nuisances."""
    nuisances = [found.nuisances[kept.index(place)] if place in kept else begin(place, replace(found, nuisances=(own,)))
                 for place, own in enumerate(fit.state.nuisances)]
    return replace(found, nuisances=tuple(nuisances))
