"""How many passes a record cut, tried again with everything refitted: a pass too many is a valley of its own.

Entry and exit are whole numbers, and once they are wrong, speed, tooth angle and the coefficients that all records share
have bent to suit them. Moved at fixed coefficients the right pass then looks worse than the wrong one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.held_out import own_refit
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.pass_search import place_entries, place_exits, recently_entered
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter

MISFIT = 1.1  # mean square residual, in units of the noise, from which a record's passes are doubted
DOUBTED = 2  # records, the worst fitted, whose passes are tried
ITERATIONS = 8  # of a fit that only has to show which valley is deeper


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """Short fits with a pass more or less in each doubted record, the worst record first.

    Of a record's moves (entry or exit, a pass earlier or later, or wherever it is best) the one that its own unknowns make
    the most of is tried.
    """
    for index in fit.worst(DOUBTED):
        if float(np.mean(fit.residuals[index] ** 2)) < MISFIT:
            return
        moved = [fit.state.with_record(index, nuisances) for nuisances in neighbours(fitter, fit.state, index)]
        states = [own_refit(fitter, state, [index]) for state in moved]
        if states:
            best = min(states, key=lambda state: fitter.cost(state, [index]))
            yield Trial(fitter, fitter.fit(best, iterations=ITERATIONS))


MOVE = Move(propose, repeats=6, finish=4 * ITERATIONS)


def neighbours(fitter: Fitter, state: State, index: int) -> list[Nuisances]:
    """The nuisances of one cut with its entry or its exit a pass earlier or later, or looked for over the whole record."""
    record, own = fitter.records[index], state.nuisances[index]
    if record.cut is None:
        return []
    found = []
    if not record.starts_in_cut:
        found += [replace(own, entry=own.entry + by) for by in (-1, 1)]
    if own.exit <= record.last_pass(state.angle, own):
        found += [replace(own, exit=own.exit + by) for by in (-1, 1)]
    single = fitter.on([record])
    alone = replace(state, nuisances=(own,))
    moved = (place_entries(single, alone), place_exits(single, alone), recently_entered(single, alone))
    found += [one.nuisances[0] for one in moved]
    return [one for one in found if one.entry < one.exit and one != own]
