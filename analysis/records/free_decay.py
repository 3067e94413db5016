"""A free decay at a record's end, followed back to its start, or at its beginning, followed to where something else begins.

One damped sinusoid with offset and slow drift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_SAMPLES = 6000  # at most this many samples enter one fit
_TURNS = (3, 4, 6, 8, 12, 16, 24, 32, 48, 64)  # revolutions that a decay is looked for in
_FIRST = (1.5, 2)  # and those at a beginning: a cut with a single tooth shows one in each of them
_DIED = 0.5  # logarithm by which a decay at a record's beginning must have fallen: slower, it may be no decay
_PER_SWING = 16  # averages to a swing, where a decay is looked for that single samples hide in noise
_SPAN = 12  # revolutions that show how fast it swings
_OFFSET_LINES = 6  # first lines of a fourfold padded spectrum, in which what is left of offset and drift lies


@dataclass(frozen=True)
class FreeDecay:
    """x(t) = e^(-decay t) (a cos wt + b sin wt) + offset + drift s + bend s^2, t in samples from `first`, s = t / span.

    frequency (cycles a sample), decay (1/sample), with standard errors; rest: standard deviation of what the fit leaves, the
    signal's unit.
    """

    first: int
    span: float
    frequency: float
    decay: float
    weights: np.ndarray
    rest: float
    decay_error: float
    frequency_error: float

    def at(self, samples: np.ndarray) -> np.ndarray:
        """The fitted signal at sample numbers."""
        return (
            _basis(np.asarray(samples, dtype=float) - self.first, self.span, self.frequency, self.decay) @ self.weights
        )

    def amplitude(self, sample: float) -> float:
        """Amplitude of the oscillation at a sample number."""
        return float(np.hypot(self.weights[0], self.weights[1]) * np.exp(-self.decay * (sample - self.first)))


def _basis(time: np.ndarray, span: float, frequency: float, decay: float) -> np.ndarray:
    envelope = np.exp(-decay * time)
    angle = 2 * np.pi * frequency * time
    scaled = time / span
    return np.stack([envelope * np.cos(angle), envelope * np.sin(angle), np.ones_like(time), scaled, scaled**2], axis=1)


def fit_free_decay(values: np.ndarray, first: int, frequency: float, decay: float = 0.0) -> FreeDecay | None:
    """Gauss-Newton over frequency and decay, the rest linear (variable projection); None where it does not converge.

    values: all samples from `first` on; frequency in cycles a sample.
    """
    stride = max(1, len(values) // _SAMPLES)
    time = np.arange(0, len(values), stride, dtype=float)
    data = values[::stride]
    span = max(1.0, time[-1])
    for _ in range(12):
        basis = _basis(time, span, frequency, decay)
        weights, *_ = np.linalg.lstsq(basis, data, rcond=None)
        rest = data - basis @ weights
        oscillation = basis[:, :2] @ weights[:2]
        quadrature = basis[:, 0] * weights[1] - basis[:, 1] * weights[0]
        slopes = np.stack([2 * np.pi * time * quadrature, -time * oscillation], axis=1)
        slopes -= basis @ np.linalg.lstsq(basis, slopes, rcond=None)[0]
        normal = slopes.T @ slopes
        if not np.isfinite(normal).all() or np.linalg.cond(normal) > 1e14:
            return None
        step = np.linalg.solve(normal, slopes.T @ rest)
        step[0] = np.clip(step[0], -0.25 / span, 0.25 / span)
        step[1] = np.clip(step[1], -2.0 / span, 2.0 / span)
        frequency, decay = frequency + step[0], decay + step[1]
        if not 0 < frequency < 0.5 or abs(decay) * span > 40:
            return None
        if abs(step[0]) * span < 1e-6 and abs(step[1]) * span < 1e-5:
            break
    basis = _basis(time, span, frequency, decay)
    weights, *_ = np.linalg.lstsq(basis, data, rcond=None)
    left = float((data - basis @ weights).std())
    errors = left * np.sqrt(np.diag(np.linalg.inv(normal)))
    return FreeDecay(first, span, float(frequency), float(decay), weights, left, float(errors[1]), float(errors[0]))


def spectral_peak(values: np.ndarray) -> float:
    """Frequency (cycles a sample) of the strongest line, from an interpolated spectrum."""
    window = np.hanning(len(values))
    time = np.linspace(-1, 1, len(values))
    flat = values - np.polynomial.Polynomial.fit(time, values, 1)(time)
    size = 4 * len(values)
    power = np.abs(np.fft.rfft(flat * window, size)) ** 2
    power[:_OFFSET_LINES] = 0.0
    top = int(np.argmax(power))
    return top / size


def free_decay_start(values: np.ndarray, turn: float, noise: float) -> int | None:
    """The sample from which a free decay explains everything to the end; None where the end is no free decay.

    turn: samples a revolution. A periodic motion is no decay: the decay must be certain, or the frequency lie between
    the spindle's harmonics.
    """
    end = len(values)
    best: FreeDecay | None = None
    for turns in _TURNS:
        first = end - int(turns * turn)
        if first < 0:
            break
        fit = fit_free_decay(values[first:], first, spectral_peak(values[first:]))
        if fit is not None and _explains(values, fit, turn, noise):
            best = fit
    if best is None:
        return None
    while best.first > 0:
        first = max(0, best.first - int(turn))
        fit = fit_free_decay(values[first:], first, best.frequency, best.decay)
        if fit is None or not _explains(values, fit, turn, noise):
            break
        best = fit
    return _back_to_contact(values, best, turn, noise)


def free_decay_end(values: np.ndarray, turn: float, noise: float) -> int | None:
    """The sample up to which a free decay from the record's beginning explains everything; None where it begins with none.

    What is lost in the noise of single samples is looked for in averages of a small part of a swing.
    """
    found = _first_decay(values, turn, noise)
    width = 1 if found is not None else _part_of_swing(values[: int(_SPAN * turn)])
    if width < 2:
        return found
    means = values[: len(values) // width * width].reshape(-1, width).mean(axis=1)
    found = _first_decay(means, turn / width, noise / np.sqrt(width))
    return None if found is None else found * width


def _part_of_swing(values: np.ndarray) -> int:
    """Samples of which several make a swing of the strongest motion."""
    peak = spectral_peak(values)
    return int(1.0 / (peak * _PER_SWING)) if peak else 1


def _first_decay(values: np.ndarray, turn: float, noise: float) -> int | None:
    best, last = None, 0
    for turns in (*_FIRST, *_TURNS):
        stop = int(turns * turn)
        if stop >= len(values):
            break
        fit = fit_free_decay(values[:stop], 0, spectral_peak(values[:stop]))
        if fit is not None and _explains(values[:stop], fit, turn, noise):
            best, last = fit, stop
    if best is None:
        return None
    while last + turn < len(values):
        stop = last + int(turn)
        fit = fit_free_decay(values[:stop], 0, best.frequency, best.decay)
        if fit is None or not _explains(values[:stop], fit, turn, noise):
            break
        best, last = fit, stop
    return _on_to_contact(values, best, last, turn, noise) if best.decay * last > _DIED else None


def _explains(values: np.ndarray, fit: FreeDecay, turn: float, noise: float) -> bool:
    """Whether a fit leaves only noise and is a decay."""
    end = len(values)
    samples = np.arange(fit.first, end)
    rest = values[fit.first :] - fit.at(samples)
    if fit.amplitude(fit.first) < 4 * fit.rest or fit.decay <= 0:
        return False
    block = max(4, int(turn / 2))
    count = len(rest) // block
    pieces = rest[: count * block].reshape(count, block)
    middle = fit.first + (np.arange(count) + 0.5) * block
    allowed = np.maximum(2.0 * noise, 0.05 * np.array([fit.amplitude(place) for place in middle]))
    if (np.sqrt((pieces**2).mean(axis=1)) > allowed).any():
        return False
    order = fit.frequency * turn
    synchronous = abs(order - round(order)) * (end - fit.first) / turn < 0.1
    certain = fit.decay > 5 * fit.decay_error and fit.decay * (end - fit.first) > 0.03
    return certain or (not synchronous and fit.decay * (end - fit.first) > 0.01)


def _on_to_contact(values: np.ndarray, fit: FreeDecay, last: int, turn: float, noise: float) -> int:
    """From the fit's end further on, to the first sample that the free decay does not explain."""
    samples = np.arange(last, min(len(values), last + int(2 * turn)))
    width = max(1, int(turn / 40))
    rest = np.convolve(values[samples] - fit.at(samples), np.ones(width) / width, "same")
    limit = max(4 * noise / np.sqrt(width), 0.02 * fit.amplitude(last))
    off = np.flatnonzero(np.abs(rest) > limit)
    return int(samples[off[0]]) if len(off) else int(samples[-1]) + 1


def _back_to_contact(values: np.ndarray, fit: FreeDecay, turn: float, noise: float) -> int:
    """From the fit's start further back, to the last sample that the free decay does not explain."""
    first = max(0, fit.first - int(2 * turn))
    samples = np.arange(first, fit.first)
    if not len(samples):
        return fit.first
    width = max(1, int(turn / 40))
    rest = np.convolve(values[first : fit.first] - fit.at(samples), np.ones(width) / width, "same")
    limit = max(4 * noise / np.sqrt(width), 0.02 * fit.amplitude(fit.first), 2 * fit.rest / np.sqrt(width))
    off = np.flatnonzero(np.abs(rest) > limit)
    return int(samples[off[-1]]) + 1 if len(off) else first
