"""A spindle speed that swings: where the fit of an effect that says so starts, if marks show its course.

A swing that turns the spindle by more than a tooth's arc is not found in the vibration alone: its phase in every record, the
tooth's angle and the pass of entry hang together. Marks tell them all: a sinusoid is fitted to their times, and a fit at the
speed that they show is carried over to it, pass by pass.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from testbed.analysis.fit.fit_state import FreeParameter, State, WaveformFit
from testbed.analysis.fit.moves import COURSES
from testbed.analysis.fit.nuisances import Nuisances, turned_by
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.solve import alternate_fit_and_passes, solve
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.records.spindle_clock import turns_of
from testbed.effect import Effect
from testbed.machine import Model

LEAST = 1.25  # periods of a swing in the longest record: less may as well be a speed that falls under load and comes back
LEFT = 0.2  # of the rms by which the marks stray from a constant speed, that a sinusoid may leave of it
FEWEST = 8  # marks of a record from which they tell a sinusoid
FINE = 0.1  # step of the frequencies tried, over the inverse of the longest record's duration
FASTEST = 0.25  # of the marks' frequency: what is faster they show as something slow
TRIALS = 60  # of that fit to the marks: where they show a sinusoid, a tenth of them will do
ITERATIONS = 20  # to solve for the time of an angle


@dataclass(frozen=True)
class Clock:
    """Spindle angle (rad, 0 at the first mark) of one record: `angle` at time `zero` (s), and from there at a speed (rad/s) of

    speed (1 + amplitude sin(2 pi frequency (t - zero) + phase)).
    """

    zero: float
    angle: float
    speed: float
    phase: float
    amplitude: float
    frequency: float

    def angle_at(self, time: float | np.ndarray) -> float | np.ndarray:
        """Spindle angle (rad) at a time (s)."""
        past, omega = time - self.zero, 2 * math.pi * self.frequency
        swung = np.cos(self.phase) - np.cos(omega * past + self.phase)
        return self.angle + self.speed * (past + self.amplitude / omega * swung)

    def phase_at(self, time: float) -> float:
        """Phase (rad) of the variation at a time (s)."""
        return self.phase + 2 * math.pi * self.frequency * (time - self.zero)

    def time_of(self, angle: float) -> float:
        """Time (s) at which the spindle has turned to an angle (rad)."""
        time = self.zero + (angle - self.angle) / self.speed
        for _ in range(ITERATIONS):
            rate = self.speed * (1 + self.amplitude * math.sin(self.phase_at(time)))
            time -= (float(self.angle_at(time)) - angle) / rate
        return time


def swings_the_speed(effect: Effect) -> bool:
    """Whether by this effect the spindle's speed recurs in time, with a phase of its own in every record."""
    return "speed" in effect.hooks and any(one.each_record for one in effect.parameters)


def marks_show(effect: Effect, records: Sequence[Observed]) -> bool:
    """Whether the marks of all cuts, left out of these records for that, follow the course that the effect gives the speed."""
    return swings_the_speed(effect) and swing_clocks(records, effect) is not None


def swing_clocks(records: Sequence[Observed], effect: Effect) -> list[Clock | None] | None:
    """A clock for every cut, alike in amplitude and frequency, for an effect that swings the speed.

    None where marks are not left out of the records, or show no sinusoid.
    """
    told = [record.measured.marks if record.measured is not None else None for record in records if record.cut is not None]
    marks = [np.asarray(one) for one in told if one is not None and len(one) >= FEWEST and (np.diff(turns_of(one)) > 0).all()]
    if not marks or len(marks) < len(told):
        return None
    longest = max(float(np.ptp(one)) for one in marks)
    frequency_bounds = next(one.bounds for one in effect.parameters if one.unit == "Hz")
    highest = min(frequency_bounds[1], FASTEST / max(float(np.median(np.diff(one))) for one in marks))
    tried = np.arange(LEAST, max(highest * longest, LEAST + FINE), FINE) / longest
    left = [sum(_swung(one, frequency)[0] for one in marks) for frequency in tried]
    frequency = float(tried[int(np.argmin(left))])
    found = _together(marks, frequency)
    steady = sum(_swung(one, None)[0] for one in marks)
    if found is None or sum(_squares(one, clock) for one, clock in zip(marks, found, strict=True)) > LEFT**2 * steady:
        return None
    clocks = iter(found)
    return [None if record.cut is None else next(clocks) for record in records]


def _swung(marks: np.ndarray, frequency: float | None) -> tuple[float, np.ndarray]:
    """(sum of squares left, coefficients of 1, time, cos and sin) of the angle at the marks, by linear least squares."""
    time, angle = marks - marks[0], 2 * math.pi * turns_of(marks)
    columns = [np.ones_like(time), time]
    if frequency is not None:
        columns += [np.cos(2 * math.pi * frequency * time), np.sin(2 * math.pi * frequency * time)]
    basis = np.stack(columns, axis=1)
    solved = np.linalg.lstsq(basis, angle, rcond=None)[0]
    return float(np.sum((angle - basis @ solved) ** 2)), solved


def _squares(marks: np.ndarray, clock: Clock) -> float:
    return float(np.sum((clock.angle_at(marks) - 2 * math.pi * turns_of(marks)) ** 2))


def _together(marks: Sequence[np.ndarray], frequency: float) -> list[Clock] | None:
    """Clocks of one amplitude and frequency, from the best of each record at a frequency near by; None if the fit fails."""
    first, amplitudes = [], []
    for one in marks:
        offset, speed, cosine, sine = _swung(one, frequency)[1]
        phase = math.atan2(sine, -cosine)  # angle: - speed a / omega cos(omega t + phase)
        amplitudes.append(math.hypot(cosine, sine) * 2 * math.pi * frequency / speed)
        first += [offset + cosine, speed, phase]

    def clocks(values: np.ndarray) -> list[Clock]:
        amplitude, now, own = float(values[0]), float(values[1]), values[2:].reshape(-1, 3)
        return [Clock(float(one[0]), float(angle), float(speed), float(phase), amplitude, now)
                for one, (angle, speed, phase) in zip(marks, own, strict=True)]

    def rest(values: np.ndarray) -> np.ndarray:
        return np.concatenate([clock.angle_at(one) - 2 * math.pi * turns_of(one)
                               for one, clock in zip(marks, clocks(values), strict=True)])

    found = least_squares(rest, np.array([float(np.median(amplitudes)), frequency, *first]), x_scale="jac", max_nfev=TRIALS)
    repeats = found.x[1] * max(float(np.ptp(one)) for one in marks) >= LEAST
    return clocks(found.x) if found.success and 0.0 < found.x[0] < 1.0 and repeats else None


def free_vibration_fit(
    engine: Engine, records: Sequence[Observed], model: Model, laws: Sequence[Effect], free: Sequence[FreeParameter]
) -> tuple[Fitter, WaveformFit] | None:
    """The model fitted from where marks show the swing of its speed; None where it has none, or they show no sinusoid.

    The model without the swing is fitted at the speed that the marks show, and carried over.
    """
    effect = next((law for law in laws if swings_the_speed(law)), None)
    clocks = None if effect is None else swing_clocks(records, effect)
    if effect is None or clocks is None:
        return None
    others = [one for one in free if one.path.partition(".")[0] != effect.name]
    measured = [record if record.measured is None else record.measured for record in records]
    _, fit = base_fit(engine, measured, model.without_effect(effect.name), free=others)
    fitter = Fitter(engine, records, free)
    begun = _carried_over(fit.state, records, measured, clocks, effect)
    return solve(fitter, alternate_fit_and_passes(fitter, begun), COURSES)


def _carried_over(
    state: State, records: Sequence[Observed], measured: Sequence[Observed], clocks: Sequence[Clock | None], effect: Effect
) -> State:
    """The state of a fit at the measured speed as one of records whose speed the effect rules."""
    phase = next(one for one in effect.parameters if one.each_record)
    strength = next(one for one in effect.parameters if one.vanishes)
    frequency = next(one for one in effect.parameters if one.unit == "Hz")
    known = next(clock for clock in clocks if clock is not None)
    values = {strength.name: known.amplitude, frequency.name: known.frequency, phase.name: 0.0}
    own = [
        nuisances if clock is None else _by_clock(record, was, nuisances, state.angle, clock, f"{effect.name}.{phase.name}")
        for record, was, nuisances, clock in zip(records, measured, state.nuisances, clocks, strict=True)
    ]
    return State(state.model.with_effect(effect.name, **values), 0.0, tuple(own))


def _by_clock(record: Observed, was: Observed, own: Nuisances, angle: float, clock: Clock, path: str) -> Nuisances:
    """One record's nuisances such that its passes begin when they did at the measured speed."""
    first = record.first_simulated
    entered = angle + own.angle  # spindle angle at which pass 0 of the measured record begins
    target = record.start + first / record.flutes * record.period
    turns = round((float(clock.angle_at(target)) - entered) / (2 * math.pi))
    start = clock.time_of(entered + 2 * math.pi * turns)
    speed = clock.speed * record.period / (2 * math.pi)
    moved = first - turns * record.flutes
    found = replace(
        own,
        angle=2 * math.pi * ((start - record.start) * speed / record.period - first / record.flutes),
        speed=speed,
        entry=first if record.starts_in_cut and own.entry <= was.first_simulated else own.entry + moved,
        exit=own.exit + moved,
    )
    return turned_by(found, path, clock.phase_at(start))
