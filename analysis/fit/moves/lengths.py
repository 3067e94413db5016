"""Lengths that one tool had cut before each record, summed anew once a fit says how long each cut is."""

from __future__ import annotations

from collections.abc import Iterator

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.length_cut import passes_cut, summed
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter

AGAIN = 10  # iterations of a fit with other lengths


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit to records that were `carried_on`, with those lengths, whatever it costs: they are no reading, but a sum."""
    if not any(record.length_summed for record in fitter.records):
        return
    state = fit.state
    passes = [passes_cut(record, own, state.angle, 1.0 - state.share_in_arc(record))
              for record, own in zip(fitter.records, state.nuisances, strict=True)]  # fmt: skip
    records = summed(fitter.records, passes)
    if any(new.cut != old.cut for new, old in zip(records, fitter.records, strict=True)):
        found = fitter.on(records)
        yield Trial(found, found.fit(state, iterations=AGAIN))


MOVE = Move(propose, incomparable=True)
