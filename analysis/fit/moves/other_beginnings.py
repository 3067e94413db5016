"""Cuts begun at rest, or as their first samples show, where that explains them better at once.

A vibration that a model without friction needed at the start of a record leads, with friction, to where no slope shows the way
back.
"""

from __future__ import annotations

from collections.abc import Iterator

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.pass_search import begun_otherwise
from testbed.analysis.fit.solve import Goal, Move, Trial, alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with such cuts begun otherwise."""
    state, moved = begun_otherwise(fitter, fit.state)
    if moved:
        yield Trial(fitter, alternate_fit_and_passes(fitter, state, rounds=goal.rounds, iterations=goal.iterations))


MOVE = Move(propose)
