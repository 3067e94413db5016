"""The shallow cuts alone, begun from the prior, and all of them from there.

A machine in x and y that is believed far off may chatter in a deep cut where the true one did not: the deep records then lead
every start away. In a shallow cut hardly anything feeds back, and the modes are found from the belief.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.moves import FRONTS
from testbed.analysis.fit.moves.best_half import begun_there
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.record_restart import own_course
from testbed.analysis.fit.solve import Goal, Move, Trial, alternate_fit_and_passes, solve
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.fit.waveform import Fitter

ASTRAY = 4.0  # mean square residual of the worst record, in noise, from which a fit may have gone astray
AGREED = 1.2  # the same of the shallow cuts alone, up to which they are explained
DEEPER = 1.2  # times as deep as the shallow ones must another cut be, at the least


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit begun at the machine of the shallow cuts, where they are explained by themselves."""
    if goal.prior is None or not goal.prior.structure.planar or fit.mean_squares.max() < ASTRAY:
        return
    shallow = _shallow(fitter.records)
    if not shallow or len(shallow) == len(fitter.records):
        return
    records = [(goal.records or fitter.records)[place] for place in shallow]
    alone = solve(*base_fit(fitter.engine, records, goal.prior, free=fitter.unknowns), FRONTS)[1]
    if alone.mean_squares.max() > AGREED:
        return
    begun = begun_there(fit, shallow, alone.state, lambda place, state: own_course(fitter, place, state).nuisances[0])
    yield Trial(fitter, alternate_fit_and_passes(fitter, begun))


MOVE = Move(propose)


def _shallow(records: Sequence[Observed]) -> list[int]:
    """Places of the shallower half of the cuts, and of what is no cut; none where hardly any is deeper."""
    depths = np.array([0.0 if record.cut is None else record.cut.axial_depth_of_cut for record in records])
    most = float(np.median(depths[depths > 0.0])) if (depths > 0.0).any() else 0.0
    found = [place for place, depth in enumerate(depths) if depth <= most]
    return found if depths.max(initial=0.0) > DEEPER * most else []
