"""Ends of cuts that are nearly at a whole pass, put there all at once.

A tooth angle a hundredth of a pass off makes every sudden entry begin a little within the arc, and each of them holds the angle
there: one alone does not become whole.
"""

from __future__ import annotations

from collections.abc import Iterator

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.moves.parts_of_passes import LAST
from testbed.analysis.fit.part_search import PLAIN
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter

NEAR = 0.1  # of the arc: so near a whole pass an end may be at it


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with all those ends at whole passes, the plainer reading."""
    whole = fit.state.with_nearly_whole(fitter.records, fitter.gradual, NEAR)
    if whole != fit.state:
        yield Trial(fitter, fitter.fit(whole, iterations=LAST, cost_limit=fit.cost + PLAIN), -1)


MOVE = Move(propose, worth=PLAIN)
