"""Free decays alone, fitted on ever longer openings: over a whole decay, phases that run apart hide where the fit should go."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.structure_start import structure_start
from testbed.analysis.fit.waveform import Fitter

GROWTH = (0.006, 0.02, 0.06, 0.2, 0.6, 1.0)  # shares of free decays that are fitted one after the other


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit of decays under some effect grown from the structure that they show, or from where it ended."""
    if goal.prior is not None and goal.laws and decays_alone(fitter.records):
        begun = replace(fit.state, model=structure_start(fitter.records, goal.prior))
        yield Trial(fitter, grown(fitter, [begun, fit.state]))


MOVE = Move(propose, rescues=True)


def decays_alone(records: Sequence[Observed]) -> bool:
    """Whether these are free decays, and nothing else."""
    return all(record.kind == "ring-down" for record in records)


def grown(fitter: Fitter, states: Sequence[State]) -> WaveformFit:
    """A fit of free decays on ever longer openings, from the state that explains the second of them best."""
    first, second, *longer = [_opened(fitter, share) for share in GROWTH]
    tries = [first.fit(_released(first, state), iterations=10) for state in states]
    tries = [second.fit(one.state, iterations=10) for one in tries]
    fit = min(tries, key=lambda one: one.cost)
    for part in longer:
        fit = part.fit(fit.state, iterations=15)
    return fit


def _opened(fitter: Fitter, share: float) -> Fitter:
    """The fitter on the first part of every record."""
    records = []
    for record in fitter.records:
        count = min(record.samples, max(64, round(share * record.samples)))
        records.append(record.part(0, count, None if share > 0.5 else 1))
    return fitter.on(records)


def _released(fitter: Fitter, state: State) -> State:
    """The state with every decay started where its record starts: displacement and velocity as the samples show them."""
    own = []
    for record, nuisances in zip(fitter.records, state.nuisances, strict=True):
        if record.motion is not None:
            displacement, velocity = _first_state(record, *record.motion)
            nuisances = replace(nuisances, displacement=displacement, velocity=velocity)
        own.append(nuisances)
    return replace(state, nuisances=tuple(own))


def _first_state(record: Observed, place: int, order: int, omega: float) -> tuple[float, float]:
    """Displacement (m) and velocity (m/s) at the first sample, of a vibration at `omega` of which a derivative is measured."""
    values = record.data[place] - record.data[place].mean()
    level, slope = float(values[0]), float(np.polyfit(np.arange(5) / record.rate, values[:5], 1)[0])
    for _ in range(order):  # integrated once: the slope of what is measured is -omega^2 times what is wanted
        level, slope = -slope / omega**2, level
    return level, slope
