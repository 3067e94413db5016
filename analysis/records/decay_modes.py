"""The modes of a free decay of one or several channels: how many there are, their poles, their shapes, and what is none.

Modes are taken one by one. One more is kept where the information criterion asks for it and it takes away enough of what is
no noise, as of a tap: real structures are no sum of a few damped vibrations, and small ones would mend that for ever.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from testbed.analysis.records.decay_fit import DecayFit, FreeDecays

MOST_MODES = 8
DECISIVE = 10.0  # gain of BIC that one more mode must bring
TAKES = 0.72  # of the squares that are left beyond the noise, that one more mode may leave at the most
_MUCH = 0.3  # of the decay, weighed: a fit that leaves more is no end of the search
_AHEAD = 2  # modes more, that are tried before the search ends
_STRONG = 2.0  # times the rms of what all leave, that the strongest mode's amplitude has
_STEPS, _FEW = 40, 12  # of a fit, and of one that only ranks
_RANKED, _TRIED = 4, 2  # of the poles that leave least where they stand, and after a few steps, how many are fitted
_BENDS = 0.3  # of a frequency, over which a mode may bend
_ALIKE = 0.5  # of two shapes, 0 to 1, from which modes must stand apart by their poles
_OVERTONES = (2, 3, 5)  # of a bent spring or a rattle
_OVERTONE, _DIES = 2e-3, (0.7, 1.5)  # of its frequency, within which it is one, and shares of its decay
_NEAR = 40  # lines of a spectrum about a mode, that tell the noise there


@dataclass(frozen=True)
class DecayModes:
    """The modes of a decay, strongest first.

    poles: (modes,), 1/sample. residues: (modes, channels), complex amplitudes at the first sample, each channel's unit.
    covariance: (modes, 2, 2) of decay and turning. residue_error: (modes, channels), of a real and of an imaginary part, with
    the poles held. rest: (channels,), rms of what is left. left_out: vibrations that are fitted but are no modes of a free
    decay, each with the reason. bends: the pole (1/sample) beside which more is left than a damped vibration explains.
    """

    poles: np.ndarray
    residues: np.ndarray
    covariance: np.ndarray
    residue_error: np.ndarray
    rest: np.ndarray
    left_out: tuple[tuple[complex, str], ...] = ()
    bends: complex | None = None

    def __len__(self) -> int:
        return len(self.poles)


def decay_modes(values: np.ndarray, most: int = MOST_MODES) -> DecayModes | None:
    """The modes of free decays (channels, samples), as many as the data ask for; None where none is told.

    most: so many at the most. A record shorter than 20 samples tells none.
    """
    values = np.asarray(values, dtype=float)
    moving = np.ptp(values, axis=1) > 0.0
    if values.shape[1] < 20 or not np.all(np.isfinite(values)) or not moving.any():
        return None
    decay = FreeDecays(values[moving])
    fit, bends = _searched(decay, most)
    return None if not len(fit.poles) else _told(decay, fit, bends, moving)


def _searched(decay: FreeDecays, most: int) -> tuple[DecayFit, complex | None]:
    """The fit that is chosen, and the pole beside which a further one was refused."""
    best = last = decay.at(np.empty(0, dtype=complex))
    size, bends = decay.cost(last), None
    while len(last.poles) < most and (len(last.poles) - len(best.poles) < _AHEAD or decay.cost(last) > _MUCH**2 * size):
        trial = _one_more(decay, last)
        if trial is None:
            break
        before, last, more, goes = last, trial, len(trial.poles) - len(best.poles), _together(decay, trial)
        if not decay.criterion(best, goes) - decay.criterion(trial, goes) > DECISIVE * more:
            continue
        if decay.beyond_noise(trial) > TAKES**more * decay.beyond_noise(best):
            continue
        if not np.any(np.abs(trial.residues) > _STRONG * np.std(trial.rest, axis=0)):
            continue
        beside = _beside(trial)
        if beside is None:
            beside = _bent(decay, before, trial)
        if beside is not None:
            bends = beside
            break
        best = trial
    return best, bends


def _one_more(decay: FreeDecays, fit: DecayFit) -> DecayFit | None:
    """The best fit with one mode more, None where no pole can be."""
    trials = [poles for poles in decay.proposals(fit) if decay.possible(poles)]
    ranked = sorted((decay.at(poles) for poles in trials), key=decay.cost)[:_RANKED]
    settled = sorted((decay.fit(one.poles, _FEW) for one in ranked), key=decay.cost)[:_TRIED]
    return min((decay.fit(one.poles, _STEPS) for one in settled), key=decay.cost, default=None)


def _together(decay: FreeDecays, fit: DecayFit) -> float:
    """Over how many of the samples fitted what is left goes together: 1 where it is white."""
    power = np.abs(np.fft.rfft(decay.left(fit.poles, fit.residues), axis=1)[:, 1:]) ** 2
    mean = np.maximum(power.mean(axis=1), 1e-300)
    return max(1.0, float(np.mean((power**2).mean(axis=1) / mean**2)) / 2.0 / decay.stride)


def _beside(fit: DecayFit) -> complex | None:
    """The stronger of two poles that overlap though they move alike: not two modes, but one whose pole changes as it dies."""
    for place, one in enumerate(fit.poles):
        for other in range(place):
            near = abs(one.imag - fit.poles[other].imag) < abs(one.real) + abs(fit.poles[other].real)
            if near and _same_shape(fit.residues[place], fit.residues[other]) > _ALIKE:
                return complex(max((one, fit.poles[other]), key=lambda pole: np.abs(fit.residues[fit.poles == pole]).max()))
    return None


def _bent(decay: FreeDecays, before: DecayFit, trial: DecayFit) -> complex | None:
    """The pole (of the fit with one mode less) that explains more by bending than by a neighbour, if one does."""
    if not len(before.poles):
        return None
    new = trial.poles[int(np.argmax([np.abs(one - before.poles).min() for one in trial.poles]))]
    place = int(np.argmin(np.abs(new - before.poles)))
    own = complex(before.poles[place])
    near = abs(new.imag / own.imag - 1.0) < _BENDS
    return own if near and decay.bent_cost(before, place) < decay.cost(trial) else None


def _same_shape(one: np.ndarray, other: np.ndarray) -> float:
    """Modal assurance criterion of two shapes, 0 to 1."""
    return float(abs(np.vdot(one, other)) ** 2 / max(np.vdot(one, one).real * np.vdot(other, other).real, 1e-300))


def _told(decay: FreeDecays, fit: DecayFit, bends: complex | None, moving: np.ndarray) -> DecayModes:
    """The modes of a fit with their errors, those left out that are none. moving: (channels,), which were fitted."""
    count, channels = fit.residues.shape
    free = max(1.0, len(decay.time) - 3.0 - 2.0 * count * (1.0 + 1.0 / channels))
    rest = np.maximum(np.sqrt(np.sum(fit.rest**2, axis=0) / free), 1e-300)
    parts = np.split(decay.slopes(fit), channels)
    slopes = np.concatenate([part / size for part, size in zip(parts, rest * decay.weight, strict=True)])
    whole = np.linalg.pinv(slopes.T @ slopes, rcond=1e-13, hermitian=True)
    loud = np.array(_noise_there(decay.left(fit.poles, fit.residues), fit.poles))
    covariance = np.array([whole[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] * loud[k] for k in range(count)])
    linear = np.maximum(np.diag(fit.gram)[: 2 * count].reshape(2, count).mean(axis=0), 0.0)
    errors = np.zeros((count, len(moving)))
    errors[:, moving] = np.outer(np.sqrt(linear * loud), rest)
    residues, left = np.zeros((count, len(moving)), dtype=complex), np.zeros(len(moving))
    residues[:, moving], left[moving] = fit.residues, rest
    order = [int(place) for place in np.argsort(-np.max(np.abs(fit.residues) / decay.scale, axis=1))]
    why = {place: reason for rank, place in enumerate(order)
           if (reason := _no_mode(fit.poles, covariance, place, order[:rank], decay.span))}
    kept = [place for place in order if place not in why]
    return DecayModes(fit.poles[kept], residues[kept], covariance[kept], errors[kept], left,
                      tuple((complex(fit.poles[place]), reason) for place, reason in why.items()), bends)


def _noise_there(rest: np.ndarray, poles: np.ndarray) -> list[float]:
    """Power of what is left (channels, samples) about each mode's frequency over its mean, 1 at the least."""
    power = np.mean(np.abs(np.fft.rfft(rest / np.maximum(rest.std(axis=1, keepdims=True), 1e-300), axis=1)) ** 2, axis=0)[1:]
    places = np.round(poles.imag / math.pi * len(power)).astype(int)
    return [max(1.0, float(power[max(0, place - _NEAR) : place + _NEAR].mean() / max(power.mean(), 1e-300)))
            for place in places]


def _no_mode(poles: np.ndarray, covariance: np.ndarray, place: int, stronger: list[int], span: float) -> str:
    """Why a vibration beside a stronger one is no mode, empty where it is one."""
    pole = poles[place]
    if not stronger:
        return ""
    error = math.sqrt(max(float(covariance[place, 0, 0]), 0.0))
    if -pole.real < 2.0 * error or -pole.real * span < 0.1:
        return "does not die away"
    for other in (poles[one] for one in stronger):
        for times in _OVERTONES:
            dies = pole.real / (times * other.real)
            if abs(pole.imag / (times * other.imag) - 1.0) < _OVERTONE and _DIES[0] < dies < _DIES[1]:
                return f"is {times} times a stronger one's frequency and dies as its overtone does"
    return ""
