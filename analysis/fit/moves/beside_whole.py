"""Ends of cuts a little beside a whole pass, in a fit that is nearly right.

A tooth that enters at its full chip a five-hundredth of a pass too late is a kick, in a valley between the places tried before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.moves.parts_of_passes import GAIN, LAST, NEARLY
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.part_search import beside_whole, settled
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter
from testbed.system.threads import threaded


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with such ends where they explain a record better."""
    if fit.variance >= NEARLY:
        return

    def one(index: int) -> Nuisances:
        now, record = fit.state.nuisances[index], fitter.records[index]
        if record.cut is None or record.forces_only:
            return now
        cost, own = min((settled(fitter, index, fit.state, each) for each in beside_whole(fitter, index, fit.state)),
                        key=lambda pair: pair[0], default=(math.inf, now))  # fmt: skip
        return own if cost < fitter.cost(fit.state, [index]) - GAIN else now

    nuisances = threaded(one, range(len(fitter.records)))
    if nuisances != fit.state.nuisances:
        yield Trial(fitter, fitter.fit(replace(fit.state, nuisances=nuisances), iterations=LAST))


MOVE = Move(propose, worth=GAIN)
