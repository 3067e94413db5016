"""Marks that the motion contradicts, and a fit that their angles no longer hold.

A channel that is recorded later than the other, or a tool taken out in between, moves the mark against the teeth by far more
than the marks themselves scatter. Held there, all parameters bend a little, so that the teeth come nearer to their marks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter

EXPLAINED = 1.1  # mean square residual, in noise, up to which the model is not what moves the teeth
SURE = 0.999  # probability that the marks' own scatter makes them differ by less
FEWEST = 3  # records


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with the marks' angles known only as well as they agree with the motion, where that is worse than they seem.

    None where they agree, or where so much is left that the model may be what moves the teeth.
    """
    off = {place: record.off_marks(own)[0]
           for place, (record, own) in enumerate(zip(fitter.records, fit.state.nuisances, strict=True))
           if record.cut is not None and record.clock_error is not None}
    squares = float(np.sum(np.square(list(off.values()))))
    if len(off) < FEWEST or fit.variance > EXPLAINED or squares <= chdtri(len(off) - 1, 1.0 - SURE):
        return
    wider = math.sqrt(squares / (len(off) - 1))
    records = [replace(record, clock_error=(wider * record.clock_error[0], record.clock_error[1]))
               if place in off and record.clock_error is not None else record
               for place, record in enumerate(fitter.records)]
    looser = fitter.on(records)
    yield Trial(looser, looser.fit(fit.state))


MOVE = Move(propose, repeats=4, incomparable=True)  # asked again: held more loosely, teeth and marks move further apart
