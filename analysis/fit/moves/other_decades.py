"""The fit begun with both coefficients decades from what is believed: of a depth in inches, or of another unit.

Where the cut is believed a thousand times too strong, or too weak, no start is near and no descent comes from so far. What the
short fits to the openings leave tells which decades are worth a fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from testbed.analysis.fit.fit_state import FreeParameter, WaveformFit
from testbed.analysis.fit.free_parameters import at_a_bound, how_it_cuts
from testbed.analysis.fit.moves import FRONTS
from testbed.analysis.fit.moves.prior_coefficients import EXPLAINED
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.plausible import unlike_a_machine
from testbed.analysis.fit.solve import Goal, Move, Trial, solve
from testbed.analysis.fit.starts import base_fit, glance
from testbed.analysis.fit.structure_start import structure_start
from testbed.analysis.fit.waveform import Fitter
from testbed.machine import Model

DECADES = (1e-3, 1e-2, 0.1, 10.0, 100.0, 1e3)  # times the believed coefficients: from between two of them a descent finds home
LITTLE = 0.5  # share of the motion, squared, that a fit leaves which foretells little
BETTER = 0.8  # share of what the belief leaves of the openings that another decade must leave to be fitted to all


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit begun in the likeliest other decade, where this one foretells little, or ended where no machine is.

    Of the model as it is alone: an effect that is tried begins where that has come to.
    """
    held = goal.prior is None or not any(one.path.endswith("_coefficient") for one in fitter.unknowns)
    if held or goal.laws or fit.variance < EXPLAINED:
        return
    found = fit.state.model
    if not (_leaves_most(fitter, fit) or at_a_bound(fitter.free, found) or unlike_a_machine(found)):
        return
    assert goal.prior is not None
    records = goal.records or fitter.records
    believed = _opening(fitter, records, goal.prior)
    left = {factor: _opening(fitter, records, _scaled(goal.prior, factor)) for factor in DECADES}
    best = min(left, key=lambda factor: left[factor])
    if left[best] < BETTER * believed:
        scaled = _scaled(goal.prior, best)
        yield Trial(*solve(*base_fit(fitter.engine, records, scaled, free=_unknown(fitter, scaled)), FRONTS))


MOVE = Move(propose)


def _leaves_most(fitter: Fitter, fit: WaveformFit) -> bool:
    motion = sum(float(np.sum((one.project(one.data) / one.noise[:, None]) ** 2)) for one in fitter.records)
    return 2.0 * fit.cost > LITTLE * motion


def _scaled(prior: Model, factor: float) -> Model:
    return prior.with_values({one.path: factor * prior.value(one.path) for one in how_it_cuts(prior)})


def _unknown(fitter: Fitter, model: Model) -> list[FreeParameter]:
    """The unknowns of a fit, those of the cut within bounds that follow the model's size."""
    cutting = {one.path: one for one in how_it_cuts(model)}
    return [cutting.get(one.path, one) for one in fitter.unknowns]


def _opening(fitter: Fitter, records: Sequence[Observed], model: Model) -> float:
    """What a model leaves of the openings of records, as a cost."""
    return glance(fitter.engine, records, structure_start(records, model), _unknown(fitter, model))
