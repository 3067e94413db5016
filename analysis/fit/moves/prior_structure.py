"""The fit begun with the modes as believed: free from the beginning, one went to where nobody believes it.

With coefficients that are far off, a mode is worth more to the first rounds as something else: slow and heavily damped it makes
up for a force. Or what went on after the cut was no free decay, but a vibration from elsewhere. Once the coefficients fit
the modes as believed, these are close to where they belong.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.moves.prior_coefficients import EXPLAINED, begun_without
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter
from testbed.machine import STRUCTURE, Model, base_parameter

FAR_FREQUENCY = 1.1  # times the believed one, or as a part of it: no tap and no guess is so far off
FAR_DAMPING = 4.0  # the same of a damping ratio, of which little is believed


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with all but the modes fitted first, where one has strayed far from its belief and much is left."""
    if goal.prior is not None and fit.variance > EXPLAINED and _strayed(goal.prior, fit.state.model):
        records = goal.records or fitter.records  # which of them start in the cut was told by the fit that strayed
        modes = (*STRUCTURE, "direction")
        yield from begun_without(fitter, records, goal.prior, lambda path: base_parameter(path) in modes, as_believed=True)


MOVE = Move(propose)


def _strayed(prior: Model, found: Model) -> bool:
    """Whether a mode has another frequency, or another damping ratio, than anybody who knows the machine would believe."""
    return any(abs(math.log(now.natural_frequency / one.natural_frequency)) > math.log(FAR_FREQUENCY)
               or abs(math.log(now.damping_ratio / one.damping_ratio)) > math.log(FAR_DAMPING)
               for one, now in zip(prior.structure.modes, found.structure.modes, strict=True))
