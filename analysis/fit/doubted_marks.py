"""Marks that the motion contradicts, and a fit that their angles no longer hold.

A channel that is recorded later than the other, or a tool taken out in between, moves the mark against the teeth by far more
than the marks themselves scatter. Held there, all parameters bend a little, so that the teeth come nearer to their marks.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.waveform import Fitter

EXPLAINED = 1.1  # mean square residual, in noise, up to which the model is not what moves the teeth
SURE = 0.999  # probability that the marks' own scatter makes them differ by less
FEWEST = 3  # records
ROUNDS = 4  # of widening: held more loosely, teeth and marks move further apart


def with_marks_doubted(fitter: Fitter, fit: WaveformFit) -> tuple[Fitter, WaveformFit]:
    """The fit with the marks' angles known only as well as they agree with the motion, where that is worse than they seem.

    The same one where they agree, or where so much is left that the model may be what moves the teeth.
    """
    for _ in range(ROUNDS):
        off = {place: record.off_marks(own)[0]
               for place, (record, own) in enumerate(zip(fitter.records, fit.state.nuisances, strict=True))
               if record.cut is not None and record.clock_error is not None}
        squares = float(np.sum(np.square(list(off.values()))))
        if len(off) < FEWEST or fit.variance > EXPLAINED or squares <= chdtri(len(off) - 1, 1.0 - SURE):
            break
        wider = math.sqrt(squares / (len(off) - 1))
        records = [replace(record, clock_error=(wider * record.clock_error[0], record.clock_error[1]))
                   if place in off and record.clock_error is not None else record
                   for place, record in enumerate(fitter.records)]
        fitter = fitter.on(records)
        fit = fitter.fit(fit.state)
    return fitter, fit
