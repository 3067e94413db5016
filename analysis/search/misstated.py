"""A record that alone contradicts the others: would it agree, had another depth or feed been stated?

A wrong number in a log bends every parameter and looks like missing physics. Where all records but one agree with the
model down to their noise, that one is fitted with its own depth of cut, then with its own feed, the machine as the others
have it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.held_out import own_refit
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.pass_search import place_entries, place_exits
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.diagnosis import Diagnosis, verdict_of
from testbed.analysis.search.outlier_records import SOUND, agreed

CONDITIONS = {"axial_depth_of_cut": "depth of cut", "feed_per_tooth": "feed per tooth"}
WIDEST = 4.0  # times the stated value, or its inverse, that is looked at
SUSPECTS = 2  # records, the worst fitted, without which the others are asked whether they agree
GRID = 9  # points of a first look
CLOSE = 1e-3  # of the logarithm of the value
PLAIN = 0.1  # of that logarithm, below which a record is off by no more than a log is
REST = 0.01  # share of what is unexplained that such a value may leave: missing physics leaves more


@dataclass(frozen=True)
class Misstated:
    """A condition of one record as it was stated and as the record shows it (m)."""

    record: str
    condition: str
    stated: float
    found: float

    @property
    def sentence(self) -> str:
        """In words, what is to be checked."""
        return (f"{self.record} agrees as well if its {CONDITIONS[self.condition]} was {self.found * 1e3:.3g} mm, "
                f"not {self.stated * 1e3:.3g} mm: check what was written down of it.")


def contradicted(base: Candidate, noise: float, progress: Callable[[str], None]) -> Diagnosis | None:
    """The diagnosis where one record alone contradicts the model, and would not had another condition been written down."""
    if base.error_where_known <= ADEQUATE * noise:
        return None
    fitter, fit = agreed(base.fitter, base.fit)
    for suspect in base.fit.worst(SUSPECTS):  # the wrong one need not stand out: it has bent the fit to all others
        if all(record.in_fit for record in fitter.records):
            fitter, fit = agreed(base.fitter, base.fit, suspect)
    strange = [place for place, record in enumerate(fitter.records) if not record.in_fit]
    if len(strange) != 1:
        return None
    name = fitter.records[strange[0]].name
    progress(f"{name} alone contradicts the model: looking at its conditions")
    found = misstated(fitter, fit.state, strange[0])
    if found is None:
        return None
    told = candidate_of(fitter, fit, (), None, 1.0)
    result = verdict_of(told, told, [told], (), noise, ())
    sentence = f"All records but {name} agree with the model as it is. {found.sentence}"
    return replace(result, verdict="unexplained", sentence=sentence)


def misstated(fitter: Fitter, state: State, place: int) -> Misstated | None:
    """The condition of the record at `place` that, stated otherwise, makes it agree with the machine of `state`, or None.

    Of several such, the one that leaves least. `state` is that of all records.
    """
    record = replace(fitter.records[place], weight=None, in_fit=True)
    if record.cut is None:
        return None
    own, found = replace(state, nuisances=(state.nuisances[place],)), {}
    before = _left(fitter.on([record]), own)
    for condition in CONDITIONS:
        left, scale = _best_scale(fitter, record, own, condition)
        if left <= min(SOUND, 1.0 + REST * (before - 1.0)) and abs(math.log(scale)) > PLAIN:
            found[condition] = left, scale
    if not found:
        return None
    best = min(found, key=lambda one: found[one])
    stated = getattr(record.cut, best)
    return Misstated(record.name, best, stated, stated * found[best][1])


def _best_scale(fitter: Fitter, record: Observed, state: State, condition: str) -> tuple[float, float]:
    """(mean square residual in noise, scale of the condition) where the record agrees best, its own unknowns refitted."""
    assert record.cut is not None
    cut, states, own = record.cut, {0.0: state}, state.nuisances[0]
    seen = replace(first_nuisances(record, state.angle + own.angle), angle=own.angle, speed=own.speed)

    def left(log_scale: float) -> float:
        other = replace(cut, **{condition: getattr(cut, condition) * math.exp(log_scale)})
        single = fitter.on([replace(record, cut=other)])
        nearest = states[min(states, key=lambda one: abs(one - log_scale))]
        placed = [place_exits(single, place_entries(single, begun))  # with a wrong depth they may have been anywhere
                  for begun in (nearest, replace(state, nuisances=(seen,)))]
        states[log_scale] = min((own_refit(single, one, [0], rounds=4) for one in placed), key=single.cost)
        return _left(single, states[log_scale])

    widest = math.log(WIDEST)
    step = 2.0 * widest / (GRID - 1)
    start = min((widest - number * step for number in range(GRID)), key=left)
    found = minimize_scalar(left, bounds=(start - step, start + step), method="bounded", options={"xatol": CLOSE})
    return float(found.fun), math.exp(float(found.x))


def _left(single: Fitter, state: State) -> float:
    """Mean square residual of the one record, in noise."""
    return float(np.mean(single.residual_of(0, state) ** 2))
