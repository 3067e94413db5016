"""A swing of the spindle's speed that was fitted to the vibration: do the marks of a steady speed allow it, and does it recur?

Where another law is missing, a chatter that runs on at a slightly wrong frequency is followed as well by a speed that creeps
by parts in ten thousand over a record. That is no swing: over no record does it come back, and marks, where there are any,
do not show it.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Collection, Mapping

import numpy as np

from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.free_vibration_start import swings_the_speed
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.analysis.records.spindle_clock import MARK_SHARE, clock_of, turns_of
from testbed.analysis.search.candidate import Candidate
from testbed.effect import Effect

RECURS = 0.25  # periods of a swing in the longest record, below which it is none
REFUTED = 50.0  # mean rise of chi-square of a record's marks from which they refute a swing
FALSE_MARK = 4.0  # robust standard deviations from which a mark is a lost or false one
POINTS = 40  # places a period, and
FEWEST = 500  # in a record at the least, between which the speed is a straight line


def no_swing(one: Candidate, catalogue: Mapping[str, Effect]) -> bool:
    """Whether a fitted set has a swing of the speed that recurs in no record, or that the marks refute."""
    cuts = [(record, own) for record, own in zip(one.fitter.records, one.fit.state.nuisances, strict=True)
            if record.cut is not None]
    swings = [catalogue[name] for name in one.effects if swings_the_speed(catalogue[name])]
    return any(_creeps(effect, one.fit.state, cuts) or _refuted(effect, one.fit.state, cuts) for effect in swings)


def _creeps(effect: Effect, state: State, cuts: list[tuple[Observed, Nuisances]]) -> bool:
    """Whether not even a part of the swing's period passes in the longest record."""
    frequencies = [state.model.value(f"{effect.name}.{one.name}") for one in effect.parameters if one.unit == "Hz"]
    longest = max(record.samples / record.rate for record, _ in cuts)
    return bool(frequencies) and max(frequencies) * longest < RECURS


def _refuted(effect: Effect, state: State, cuts: list[tuple[Observed, Nuisances]]) -> bool:
    """Whether the marks of a steady speed follow a constant one far better than that which the fit says."""
    law = _law(effect)
    told = [_rise(law, effect.complete(own.shifted(state.model).effects[effect.name]), state.angle, record, own)
            for record, own in cuts if law is not None and record.steady_marks is not None]
    return bool(told) and float(np.mean(told)) > REFUTED


def _law(effect: Effect) -> Callable[..., float] | None:
    """The relative speed of a time and the effect's parameters; None where it depends on more."""
    law = effect.hooks["speed"]
    known = {"time", *(one.name for one in effect.parameters)}
    return law if set(inspect.signature(law).parameters) <= known else None


def _rise(law: Callable[..., float], values: Mapping[str, float], angle: float, record: Observed, own: Nuisances) -> float:
    """Chi-square of the marks at the speed that the fit says, less that at a constant one."""
    assert record.steady_marks is not None
    asked = inspect.signature(law).parameters
    cut, sampling = record.timeline(angle, own)
    begin = record.start - sampling.start  # of the simulation, from which its time counts
    marks, turns = record.steady_marks, turns_of(record.steady_marks)
    period, anchor, _ = clock_of(marks)
    constant = marks - anchor - period * turns
    good = np.abs(constant - np.median(constant)) <= FALSE_MARK * _robust(constant)
    turned = marks - begin + _integral(law, asked, values, marks - begin)  # by the spindle, in s at its nominal speed
    late = 2 * math.pi * turns / cut.spindle_speed - turned  # s; which tooth the marks belong to is another unknown
    spread = max(_robust(constant), MARK_SHARE / record.rate)
    squares = [float(np.sum((rest[good] - np.mean(rest[good])) ** 2)) for rest in (late, constant)]
    return (squares[0] - squares[1]) / spread**2


def _robust(values: np.ndarray) -> float:
    return max(1.4826 * float(np.median(np.abs(values - np.median(values)))), 1e-12)


def _integral(law: Callable[..., float], asked: Collection[str], values: Mapping[str, float], at: np.ndarray) -> np.ndarray:
    """The relative speed integrated from 0 to each of these times (s)."""
    last = max(float(at[-1]), 0.0)
    times = np.linspace(min(0.0, float(at[0])), last, max(FEWEST, math.ceil(POINTS * values.get("frequency", 0.0) * last)))
    known = {key: value for key, value in values.items() if key in asked}
    speeds = np.array([law(**known, **({"time": float(time)} if "time" in asked else {})) for time in times])
    steps = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times))])
    return np.interp(at, times, steps) - np.interp(0.0, times, steps)
