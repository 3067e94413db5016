"""Cuts that are elsewhere than where they are taken to be, in records of hardly more than noise.

There an entry many passes off leaves a few per cent more than the right one, and so does a record taken to start in the cut:
less than the noise is known to. An effect that moves the entry would be named for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.held_out import own_refit
from testbed.analysis.fit.moves.pass_count import neighbours
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.pass_search import entered, left_at, squares_of
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter
from testbed.system.threads import threaded

ROUND = 24  # places round a tooth's pitch at which the angle of a record without marks is looked for,
LIKELY = 4  # and of them those whose own unknowns are refitted
EXPLAINED = 1.5  # mean square residual of all records up to which a model explains them,
UNLIKELY = 1.5  # times what a record leaves, that it leaves after a move of which no fit of its own unknowns makes the better,
GAIN = 20.0  # and in minus the log likelihood, by which an entry or exit elsewhere must then be better


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with the passes of cuts that it explains looked for once more, all unknowns refitted."""
    if fit.cost > 0.5 * EXPLAINED * sum(record.size for record in fitter.records):
        return
    elsewhere = threaded(lambda index: _elsewhere(fitter, fit, index), range(len(fitter.records)))
    if elsewhere != fit.state.nuisances:
        state = replace(fit.state, nuisances=elsewhere)
        wider = fitter.on(entered(fitter.records, state))
        yield Trial(wider, wider.fit(state))


MOVE = Move(propose, worth=GAIN)


def _elsewhere(fitter: Fitter, fit: WaveformFit, index: int) -> Nuisances:
    """The nuisances of a record that is cut elsewhere, as if it idled before; its own where that is hardly better.

    One that starts in the cut, unless it idles after all, has no other beginning.
    """
    record, own = fitter.records[index], fit.state.nuisances[index]
    if record.cut is None or record.forces_only:
        return own
    single, state = fitter.on([replace(record, starts_in_cut=False)]), replace(fit.state, nuisances=(own,))
    moves = neighbours(single, state, 0)
    if not record.starts_in_cut and record.first_mark is not None:
        moves = _likely(fitter, fit, index, moves)
    best = _best_of(single, state, moves)
    if record.first_mark is None:
        best = _best_of(single, best, _all_round(single, best))
    idles = not entered([record], best)[0].starts_in_cut
    better = single.cost(best) < 0.5 * float(np.sum(fit.residuals[index] ** 2)) - GAIN
    return best.nuisances[0] if idles and better else own


def _likely(fitter: Fitter, fit: WaveformFit, index: int, moves: Sequence[Nuisances]) -> list[Nuisances]:
    """Those moves of a record after which it may be explained as well as it is: what its own unknowns mend is left aside."""
    rests = left_at(fitter, fit, index, moves)
    squares, now = np.einsum("ij,ij->i", rests, rests), float(np.sum(fit.parts[index].residual ** 2))
    return [one for one, left in zip(moves, squares, strict=True) if left < UNLIKELY * now]


def _best_of(single: Fitter, state: State, tried: Sequence[Nuisances]) -> State:
    """The one record's state, or that with the nuisances that explain it best once its own unknowns are refitted."""
    moved = [own_refit(single, state.with_record(0, one), [0]) for one in tried]
    return min((state, *moved), key=single.cost)


def _all_round(single: Fitter, state: State) -> list[Nuisances]:
    """The nuisances of a record without marks at the likeliest other tooth angles, with the passes that suit them."""
    record, own = single.records[0], state.nuisances[0]
    pitch = 2 * math.pi / record.flutes
    ranked = []
    for part in range(ROUND):
        turned = replace(own, angle=own.angle + pitch * (part / ROUND - 0.5))
        tried = [replace(turned, entry=own.entry + late, exit=own.exit + later) for late in (-1, 0, 1) for later in (-1, 0, 1)
                 if own.entry + late < own.exit + later]  # fmt: skip
        squares = squares_of(single, 0, state, tried)
        ranked.append((float(squares.min()), tried[int(np.argmin(squares))]))
    return [one for _, one in sorted(ranked, key=lambda pair: pair[0])[:LIKELY]]
