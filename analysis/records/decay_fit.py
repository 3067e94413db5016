"""Damped vibrations fitted to free decays of several channels: least squares over their poles, and where a further pole may be.

    x_c(t) = sum over modes of Re(A_kc e^(s_k t))  +  offset + drift + bend,      s_k = -decay + i turning, t in samples

All channels share the poles. Amplitudes and drift are linear and projected out (variable projection), so that the poles alone
are searched. A further one is looked for where what is left is strongest: there it is brought down to 0 Hz, thinned out, and a
matrix pencil (Hua and Sarkar 1990, IEEE Trans. ASSP 38, 814) gives its pole.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from testbed.analysis.records.white_noise import rounding, white_noise

CYCLES = 1.5  # of a record: slower is drift
_SAMPLES = 6000  # at most so many of a channel enter a fit
_LENGTHS = (1, 4, 16)  # parts of the record, from its start, in which a mode is looked for
_FEWEST = 48  # samples of such a part
_THINNED = 96  # samples of a part that was brought down to 0 Hz
_WIDEST = 0.25  # cycles that such a sample averages at the most
_GUESSED = (-3.0, 0.3, 3.0, 8.0)  # by how much, in logarithms, a mode may die over a part
_GROWTH = 40.0  # logarithm by which a mode may grow over a record
_BEYOND_CHANCE = 3.0  # logarithm of one over the chance that a line is noise
_MOST_DAMPING = 0.6  # of a mode
_SEEN, _FAINT = 8.0, 0.02  # rms of the noise, and share of the largest amplitude, down to which a phase is followed
_BENT_STEPS = 20  # of the fit of a bent mode
_LEAST = 1e-9  # of a channel's own rms, that its noise has


@dataclass(frozen=True)
class DecayFit:
    """Poles (modes,), their residues (modes, channels), and what they leave of the samples fitted: rest (samples, channels).

    q, r, size: the columns of modes and drift, over `size`, split into an orthogonal and a triangular factor.
    """

    poles: np.ndarray
    residues: np.ndarray
    rest: np.ndarray
    q: np.ndarray
    r: np.ndarray
    size: np.ndarray

    @property
    def gram(self) -> np.ndarray:
        """Covariance of the weights for noise of 1."""
        return np.linalg.pinv(self.r.T @ self.r, rcond=1e-13, hermitian=True) / np.outer(self.size, self.size)


class FreeDecays:
    """The samples of a fit, time in samples, each channel in its own scale and weighed by its noise."""

    def __init__(self, values: np.ndarray) -> None:
        self.full = values
        count = values.shape[1]
        taken = np.arange(count)
        if count > _SAMPLES:  # the first ones all, for what dies at once; then not at even steps, where fast looks like slow
            edges = np.linspace(_SAMPLES // 2, count, _SAMPLES // 2 + 1)
            later = edges[:-1] + np.diff(edges) * np.random.default_rng(0).random(_SAMPLES // 2)
            taken = np.concatenate([np.arange(_SAMPLES // 2), np.unique(later.astype(int))])
        self.stride = count / len(taken)  # mean
        self.time = taken.astype(float)
        self.data = values[:, taken].T
        self.scale = np.maximum(np.std(values, axis=1), 1e-300)
        self.noise = np.array([max(white_noise(one), rounding(one), _LEAST * scale)
                               for one, scale in zip(values, self.scale, strict=True)])
        self.weight = 1.0 / self.noise
        self.span = max(1.0, float(values.shape[1] - 1))
        place = self.time / self.span
        self.trend = np.stack([np.ones_like(place), place, place**2], axis=1)

    def fit(self, poles: np.ndarray, steps: int) -> DecayFit:
        """Least squares from these poles (Levenberg and Marquardt); steps: at most so many, 0 leaves them where they are."""
        best, lift, moved_on, flat = self.at(poles), 1e-3, True, np.empty(0)
        for _ in range(steps):
            flat = self.slopes(best) if moved_on else flat
            normal, right = flat.T @ flat, -flat.T @ self._rows(best.rest)
            size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
            step = np.linalg.lstsq(normal / np.outer(size, size) + lift * np.eye(len(size)), right / size, rcond=None)[0] / size
            moved = best.poles - step[0::2] + 1j * step[1::2]
            trial = self.at(moved) if self.possible(moved) else None
            if trial is None or not self.cost(trial) < self.cost(best):
                if lift > 1e6:
                    break
                lift, moved_on = 10.0 * lift, False
                continue
            gain = self.cost(best) - self.cost(trial)
            best, lift, moved_on = trial, max(1e-9, 0.1 * lift), True
            if gain < 1e-9 * self.cost(best) and float(np.abs(step).max()) * self.span < 1e-6:
                break
        return best

    def at(self, poles: np.ndarray) -> DecayFit:
        """What poles leave where they stand."""
        waves = np.exp(np.outer(self.time, poles))
        basis = np.concatenate([waves.real, -waves.imag, self.trend], axis=1)
        size = np.maximum(np.linalg.norm(basis, axis=0), 1e-300)
        q, r = np.linalg.qr(basis / size)
        weights = np.linalg.lstsq(r, q.T @ self.data, rcond=1e-12)[0] / size[:, None]
        count = len(poles)
        residues = weights[:count] + 1j * weights[count : 2 * count]
        rest = self.data - basis @ weights
        return DecayFit(poles, residues, rest, q, r, size)

    def slopes(self, fit: DecayFit) -> np.ndarray:
        """Slopes of the weighted rest, (channels samples, 2 modes), by decay and turning of each mode."""
        waves, columns = np.exp(np.outer(self.time, fit.poles)), []
        for channel, weight in enumerate(self.weight):
            moving = -self.time[:, None] * (waves * fit.residues[:, channel])  # real by decay, imaginary by turning
            part = np.stack([moving.real, moving.imag], axis=2).reshape(len(self.time), 2 * len(fit.poles))
            columns.append(-weight * (part - fit.q @ (fit.q.T @ part)))
        return np.concatenate(columns)

    def _rows(self, rest: np.ndarray) -> np.ndarray:
        return np.concatenate([one * weight for one, weight in zip(rest.T, self.weight, strict=True)])

    def cost(self, fit: DecayFit) -> float:
        """Sum of squares left, over each channel's noise."""
        return float(np.sum((fit.rest * self.weight) ** 2))

    def beyond_noise(self, fit: DecayFit) -> float:
        """What of it the noise does not explain."""
        return max(0.0, self.cost(fit) - fit.rest.size)

    def bent_cost(self, fit: DecayFit, place: int) -> float:
        """Cost with one of the modes bent instead: its frequency and damping change with the square of its amplitude.

        Infinite where its amplitude and phase are not seen.
        """
        from scipy.signal import hilbert  # slow to load, and wanted by few

        others = np.delete(fit.poles, place)
        loud = int(np.argmax(np.abs(fit.residues[place]) * self.weight))
        signal = hilbert(self.left(others, np.delete(fit.residues, place, axis=0))[loud])
        size = np.abs(signal)
        faint = np.flatnonzero(size < max(_SEEN * self.noise[loud], _FAINT * float(size.max())))
        time = np.arange(int(faint[0]) if len(faint) else len(size), dtype=float)
        if len(time) < _FEWEST:
            return math.inf
        size = size[: len(time)]
        level, angle = np.log(size), np.unwrap(np.angle(signal[: len(time)]))
        dies = -float(np.polyfit(time, level, 1, w=size)[0])
        if dies <= 0.0:
            return math.inf
        columns = np.stack([np.ones_like(time), time, 1.0 - np.exp(-2.0 * dies * time)], axis=1) * size[:, None]
        (_, falls, squeezed), (_, turns, bent) = (np.linalg.lstsq(columns, one * size, rcond=None)[0] for one in (level, angle))
        grown = 1.0 - np.exp(-2.0 * dies * self.time)

        def rest(values: np.ndarray) -> np.ndarray:
            poles = values[0::2] + 1j * values[1::2]
            powers = np.outer(self.time, poles[1:])
            powers[:, 0] += poles[0] * grown
            waves = np.exp(np.minimum(powers.real, _GROWTH) + 1j * powers.imag)
            q = np.linalg.qr(np.concatenate([waves.real, waves.imag, self.trend], axis=1))[0]
            return ((self.data - q @ (q.T @ self.data)) * self.weight).ravel()

        start = np.array([squeezed + 1j * bent, falls + 1j * turns, *others])
        done = least_squares(rest, np.stack([start.real, start.imag], axis=1).ravel(), x_scale="jac", max_nfev=_BENT_STEPS)
        return 2.0 * float(done.cost)

    def criterion(self, fit: DecayFit, goes: float) -> float:
        """BIC with each channel's noise unknown, of as many independent samples as what is left shows."""
        rows, channels = len(self.time) / goes, fit.rest.shape[1]
        squares = np.maximum(np.sum(fit.rest**2, axis=0), (_LEAST * self.scale) ** 2)
        return rows * float(np.sum(np.log(squares / rows))) + 2 * len(fit.poles) * (1 + channels) * math.log(rows * channels)

    def possible(self, poles: np.ndarray) -> bool:
        return bool(np.all((poles.imag > 0.5 * CYCLES * 2.0 * math.pi / self.span) & (poles.imag < math.pi)
                           & (poles.real * self.span < _GROWTH)
                           & (-poles.real < _MOST_DAMPING * np.abs(poles))))

    def proposals(self, fit: DecayFit) -> Iterator[np.ndarray]:
        """Sets of poles with one more: where what these leave is strongest, or with one of them become two."""
        rest, seen = self.left(fit.poles, fit.residues), False
        for part in _LENGTHS:
            length = rest.shape[1] // part
            if part > 1 and length < _FEWEST:
                break
            own = rest[:, :length] * self.weight[:, None]
            for falling in (True, False) if part == 1 else (True,):
                frequency = _strongest(own, falling)
                seen |= frequency > 0.0
                if frequency > 0.0:
                    guessed = [complex(-died / length, 2.0 * math.pi * frequency) for died in _GUESSED]
                    yield from (np.append(fit.poles, pole) for pole in (*_pencil(own, frequency), *guessed))
        for place, pole in enumerate(fit.poles if seen else ()):
            others = np.delete(fit.poles, place)
            alone = self.left(others, np.delete(fit.residues, place, axis=0)) * self.weight[:, None]
            pair = _pencil(alone, float(pole.imag) / (2.0 * math.pi), (2,))
            if len(pair) == 2:
                yield np.append(others, pair)

    def left(self, poles: np.ndarray, residues: np.ndarray) -> np.ndarray:
        """All samples (channels, samples) without these modes and without a straight line."""
        time = np.arange(self.full.shape[1], dtype=float)
        left = self.full.copy()
        for pole, own in zip(poles, residues, strict=True):
            left -= (own[:, None] * np.exp(pole * time)[None, :]).real
        trend = np.stack([np.ones_like(time), time / self.span], axis=1)
        return left - (trend @ np.linalg.lstsq(trend, left.T, rcond=None)[0]).T


def _strongest(values: np.ndarray, falling: bool) -> float:
    """Frequency (cycles a sample) of the strongest line of several channels together, 0 where noise alone may show it."""
    length = values.shape[1]
    window = np.hanning(2 * length)[length:] if falling else np.hanning(length)
    power = np.sum(np.abs(np.fft.rfft(values * window, 2 * length)) ** 2, axis=0)
    power[: math.ceil(2 * CYCLES)] = 0.0
    top = int(np.argmax(power))
    most = 1.0 + (math.log(len(power)) + _BEYOND_CHANCE) / math.sqrt(len(values))  # of white noise, over the mean
    return top / (2 * length) if 0 < top < len(power) - 1 and power[top] > most * power.mean() else 0.0


def _pencil(values: np.ndarray, frequency: float, ranks: tuple[int, ...] = (1, 2)) -> list[complex]:
    """Poles (1/sample) near a frequency (cycles a sample), by a matrix pencil over the channels brought down to 0 Hz."""
    length = values.shape[1]
    width = max(1, min(length // _THINNED, int(_WIDEST / frequency)))
    count = min(length // width, 4 * _THINNED)
    turned = values[:, : count * width] * np.exp(-2j * math.pi * frequency * np.arange(count * width))
    thin = turned.reshape(len(values), count, width).mean(axis=2)
    rows = count // 3
    if rows < 4:
        return []
    hankel = np.concatenate([np.lib.stride_tricks.sliding_window_view(one, rows) for one in thin])
    right = np.linalg.svd(hankel, full_matrices=False)[2]
    found = []
    for rank in ranks:
        if len(right) >= rank:
            basis = right[:rank].T
            shifts = np.linalg.eigvals(np.linalg.lstsq(basis[:-1], basis[1:], rcond=None)[0])
            found += [np.log(one) / width + 2j * math.pi * frequency for one in shifts if abs(one) > 1e-6]
    return [complex(one) for one in found if 0.0 < one.imag < math.pi and one.real * length < _GROWTH]
