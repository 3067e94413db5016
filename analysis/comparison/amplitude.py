"""Frequency and damping of a free decay against its amplitude: does the spring bend, does something rub or drag?

The decay is cut into windows of a few cycles. In each a damped sinusoid on a curved offset is fitted, so that white noise
biases neither amplitude nor phase; their course through the windows is then set against closed forms of the envelope A(t),

    dA/dt = -(a A + b + c A^2):   a viscous damping, b dry friction (equal drops), c quadratic damping (damping ~ A),

and of the phase, d phi/dt = 2 pi (f0 + f2 A^2), the backbone of a cubic spring. What a term adds beyond chance is told by
an F test against the same course without it; the scatter about the course, not the noise alone, sets the errors.

Source: Nayfeh and Mook (1979), Nonlinear Oscillations, sections 3.2 and 4.1 (averaging).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.optimize import least_squares
from scipy.special import fdtrc, stdtr

from testbed.analysis.comparison.adequacy import Adequacy, controlled
from testbed.analysis.fit.observed import Observed
from testbed.analysis.records.free_decay import fit_free_decay, spectral_peak
from testbed.recording import quantity_of

CYCLES = (6, 4, 3, 2)  # of a window, the shorter ones for decays that end soon
LEAST, SHORTEST = 6, 16  # windows that a verdict needs; samples of a free decay
CLEAR = 8.0  # amplitude over its own standard error down to which windows count
FREQUENCY_MATTERS = 1e-4  # relative change of the frequency over the decay that counts
DAMPING_MATTERS = 0.1  # relative change of the damping over the decay that counts
LEVEL = 0.05  # false discoveries among the verdicts of several decays

FrequencyVerdict = Literal["constant", "rises", "falls"]
DampingVerdict = Literal["constant", "dry friction", "quadratic damping", "rises", "falls"]


@dataclass(frozen=True)
class Course:
    """Amplitude (channel's unit) and phase (rad) at the middle of each window, with standard errors; time (s)."""

    time: np.ndarray
    amplitude: np.ndarray
    amplitude_error: np.ndarray
    phase: np.ndarray
    phase_error: np.ndarray


@dataclass(frozen=True)
class AmplitudeDependence:
    """One free decay. Arrays (steps,): between neighbouring windows, amplitude in `unit`, frequency in Hz, damping ratio.

    small_frequency (Hz) and bend (Hz/unit^2): f = small_frequency + bend A^2. viscous (1/s), friction (unit/s) and
    quadratic (1/(unit s)): the envelope's a, b, c of the course chosen; the others 0. change_frequency and
    change_damping: relative change from the small to the large end. p values before control over decays.
    """

    name: str
    channel: str
    unit: str
    course: Course
    amplitude: np.ndarray
    frequency: np.ndarray
    frequency_error: np.ndarray
    damping: np.ndarray
    damping_error: np.ndarray
    small_frequency: float
    bend: float
    viscous: float
    friction: float
    quadratic: float
    change_frequency: float
    change_damping: float
    p_frequency: float
    p_damping: float
    frequency_verdict: FrequencyVerdict
    damping_verdict: DampingVerdict

    def damping_at(self, amplitude: np.ndarray) -> np.ndarray:
        """Equivalent damping ratio of the course at amplitudes (unit)."""
        rate = self.viscous + self.friction / np.maximum(amplitude, 1e-300) + self.quadratic * amplitude
        return rate / (2 * math.pi * self.small_frequency)

    def frequency_at(self, amplitude: np.ndarray) -> np.ndarray:
        """Frequency (Hz) of the course at amplitudes (unit)."""
        return self.small_frequency + self.bend * amplitude**2


def course(values: np.ndarray, rate: float) -> Course:
    """Amplitude and phase through a free decay `values` (samples,) taken at `rate` (Hz). ValueError where none is seen."""
    values = np.asarray(values, dtype=float)
    if len(values) < SHORTEST:
        raise ValueError(f"a free decay of {len(values)} samples is too short")
    peak = spectral_peak(values[: max(256, len(values) // 4)] - values.mean())
    if peak <= 0:
        raise ValueError("no oscillation is seen")
    tried = [_windows(values, max(16, round(cycles / peak)), peak) for cycles in CYCLES]
    rows = next((rows for rows in tried if len(rows) >= 2 * LEAST), max(tried, key=len))
    if len(rows) < LEAST:
        raise ValueError(f"the decay stands out of the noise for {len(rows)} windows of {CYCLES[-1]} cycles only")
    found = np.array(rows).T
    return Course(found[0] / rate, *found[1:])


def _windows(values: np.ndarray, length: int, peak: float) -> list[tuple[float, float, float, float, float]]:
    """(middle in samples, amplitude, its error, phase, its error) of windows of `length` samples, until noise takes over."""
    rows: list[tuple[float, float, float, float, float]] = []
    frequency, decay, turns = peak, 0.0, 0.0
    for first in range(0, len(values) - length + 1, length):
        fit = fit_free_decay(values[first : first + length], 0, frequency, decay)
        if fit is None:
            break
        middle = 0.5 * (length - 1)
        amplitude = fit.amplitude(middle)
        error = fit.rest * math.sqrt(2.0 / (length - 7))  # seven numbers were fitted to the window
        if not amplitude > CLEAR * error:
            break
        # noise lengthens a vector: the square of its length is right on average without two variances
        amplitude = math.sqrt(max(amplitude**2 - error**2, 0.0))
        phase = 2 * math.pi * fit.frequency * middle - math.atan2(fit.weights[1], fit.weights[0])
        expected = turns + 2 * math.pi * frequency * length if rows else phase
        turns = expected + (phase - expected + math.pi) % (2 * math.pi) - math.pi
        rows.append((first + middle, amplitude, error, turns, error / amplitude))
        frequency, decay = fit.frequency, fit.decay
    return rows


def _envelope(kind: str, parameters: np.ndarray, time: np.ndarray) -> np.ndarray:
    """A(t) of viscous damping with dry friction or quadratic damping; parameters (A0, a[, b or c])."""
    start, viscous = parameters[:2]
    extra = parameters[2] if len(parameters) > 2 else 0.0
    gone = np.exp(-viscous * time)
    lasted = -np.expm1(-viscous * time) / viscous if abs(viscous) > 1e-9 else time
    if kind == "dry friction":
        return start * gone - extra * lasted
    return start * gone / np.maximum(1.0 + extra * start * lasted, 1e-6)


def _fit_envelope(kind: str, seen: Course) -> tuple[np.ndarray, float]:
    """(parameters, chi-square) of one law; kind `viscous` has two parameters."""
    time = seen.time - seen.time[0]
    rate = math.log(seen.amplitude[0] / seen.amplitude[-1]) / time[-1]
    scale = {
        "viscous": [],
        "dry friction": [0.3 * rate * seen.amplitude.mean()],
        "quadratic damping": [0.3 * rate / seen.amplitude.mean()],
    }[kind]
    start = np.array([seen.amplitude[0], rate, *(0.0 * value for value in scale)])
    sizes = np.array([seen.amplitude[0], max(abs(rate), 1e-6), *scale])

    def rest(parameters: np.ndarray) -> np.ndarray:
        return (seen.amplitude - _envelope(kind, parameters, time)) / seen.amplitude_error

    found = least_squares(rest, start, x_scale=np.abs(sizes) + 1e-300)
    return found.x, 2.0 * found.cost


def _damping(seen: Course) -> tuple[str, np.ndarray, float]:
    """(law, its parameters, p value of what it adds to viscous damping)."""
    plain, without = _fit_envelope("viscous", seen)
    tried = {kind: _fit_envelope(kind, seen) for kind in ("dry friction", "quadratic damping")}
    kind = min(tried, key=lambda name: tried[name][1])
    found, squares = tried[kind]
    freedom = len(seen.time) - 3
    variance = max(1.0, squares / freedom)
    p_value = float(fdtrc(1, freedom, max((without - squares) / variance, 0.0)))
    return (kind, found, p_value) if p_value < LEVEL else ("viscous", plain, p_value)


def _straightened(seen: Course, friction: float) -> Course:
    """The course with the phase that dry friction shifts put right.

    Between turning points the equilibrium stands F/k to either side, a square wave whose fundamental lags by
    (4 / pi) F / (k A): more and more as A dies, which would pass for a lower frequency. A drop of 4 F/k a cycle gives F/k.
    """
    frequency = (seen.phase[-1] - seen.phase[0]) / (2 * math.pi * (seen.time[-1] - seen.time[0]))
    return replace(seen, phase=seen.phase + friction / (math.pi * frequency * seen.amplitude))


def _bend(seen: Course, kind: str, parameters: np.ndarray) -> tuple[float, float, float]:
    """(f0 in Hz, f2 in Hz/unit^2, its p value) from the phase's course."""
    time = seen.time - seen.time[0]
    fine = np.linspace(0.0, time[-1], 2000)
    square = _envelope(kind, parameters, fine) ** 2
    size = float(square.max())
    area = np.concatenate([[0.0], np.cumsum(0.5 * (square[1:] + square[:-1]) * np.diff(fine))]) / size
    columns = np.column_stack([np.ones_like(time), 2 * math.pi * time, 2 * math.pi * np.interp(time, fine, area)])
    weight = 1.0 / seen.phase_error
    values, *_ = np.linalg.lstsq(columns * weight[:, None], seen.phase * weight, rcond=None)
    rest = (seen.phase - columns @ values) * weight
    freedom = len(time) - 3
    variance = max(1.0, float(rest @ rest) / freedom)
    normal = (columns * weight[:, None]).T @ (columns * weight[:, None])
    error = math.sqrt(float(np.linalg.pinv(normal)[2, 2]) * variance)
    p_value = float(2.0 * stdtr(freedom, -abs(values[2]) / max(error, 1e-300)))
    return float(values[1]), float(values[2] / size), p_value


def amplitude_dependence(
    values: np.ndarray, rate: float, name: str = "", channel: str = "displacement", unit: str = "m"
) -> AmplitudeDependence:
    """What a free decay `values` (samples,) at `rate` (Hz) says of frequency and damping against amplitude.

    ValueError where the decay is too short or too quiet. The verdicts are those of this decay alone.
    """
    seen = course(values, rate)
    kind, law, p_damping = _damping(seen)
    if kind == "dry friction":
        seen = _straightened(seen, float(law[2]))
    small, bend, p_frequency = _bend(seen, kind, law)
    step = np.diff(seen.time)
    frequency = np.diff(seen.phase) / (2 * math.pi * step)
    frequency_error = np.hypot(seen.phase_error[1:], seen.phase_error[:-1]) / (2 * math.pi * step)
    relative = seen.amplitude_error / seen.amplitude
    damping = -np.diff(np.log(seen.amplitude)) / (2 * math.pi * frequency * step)
    damping_error = np.hypot(relative[1:], relative[:-1]) / (2 * math.pi * frequency * step)
    extra = float(law[2]) if kind != "viscous" else 0.0
    found = AmplitudeDependence(
        name,
        channel,
        unit,
        seen,
        np.sqrt(seen.amplitude[1:] * seen.amplitude[:-1]),
        frequency,
        frequency_error,
        damping,
        damping_error,
        small,
        bend,
        float(law[1]),
        extra if kind == "dry friction" else 0.0,
        extra if kind == "quadratic damping" else 0.0,
        0.0,
        0.0,
        p_frequency,
        p_damping,
        "constant",
        "constant",
    )
    ends = np.array([found.amplitude.min(), found.amplitude.max()])
    low, high = found.damping_at(ends)
    change = float((high - low) / max(abs(low), abs(high), 1e-300))
    found = replace(found, change_damping=change, change_frequency=float(bend * (ends[1] ** 2 - ends[0] ** 2) / small))
    return _judged(found, p_frequency < LEVEL, p_damping < LEVEL)


def _judged(one: AmplitudeDependence, frequency_speaks: bool, damping_speaks: bool) -> AmplitudeDependence:
    """The verdicts, given whether chance is ruled out; what does not matter is constant."""
    frequency: FrequencyVerdict = "constant"
    damping: DampingVerdict = "constant"
    if frequency_speaks and abs(one.change_frequency) > FREQUENCY_MATTERS:
        frequency = "rises" if one.bend > 0 else "falls"
    if damping_speaks and abs(one.change_damping) > DAMPING_MATTERS:
        if one.friction > 0:
            damping = "dry friction"
        elif one.quadratic > 0:
            damping = "quadratic damping"
        else:
            damping = "falls" if one.change_damping < 0 else "rises"
    return replace(one, frequency_verdict=frequency, damping_verdict=damping)


def free_decays(records: Sequence[Observed]) -> tuple[AmplitudeDependence, ...]:
    """Every free decay of the records (ring-downs, and the ring-down after each cut) that stands out of the noise.

    The verdicts hold with the false discoveries over all decays controlled (Benjamini and Hochberg).
    """
    units = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
    found = []
    for record in records:
        channel = record.channels[0]
        if channel.startswith("force") or record.kind == "excited" or record.modes > 1:  # of several, no amplitude is one's
            continue
        for segment in record.segments:
            if segment.kind != "ring-down":
                continue
            # half a revolution later than found: a last graze of the tooth is no free motion
            begin = segment.start + (0.5 * record.period / record.flutes if record.cut is not None else 0.0)
            first = max(0, round((begin - record.start) * record.rate))
            last = min(record.samples, round((segment.stop - record.start) * record.rate))
            try:
                found.append(
                    amplitude_dependence(
                        record.data[0, first:last], record.rate, record.name, channel, units.get(quantity_of(channel), "")
                    )
                )
            except (ValueError, np.linalg.LinAlgError):  # too short or too quiet to say anything
                continue
    tests = controlled(
        [
            Adequacy(one.name, test, 0.0, p_value)
            for one in found
            for test, p_value in (("frequency", one.p_frequency), ("damping", one.p_damping))
        ],
        LEVEL,
    )
    return tuple(_judged(one, tests[2 * place].fails, tests[2 * place + 1].fails) for place, one in enumerate(found))
