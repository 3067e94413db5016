"""From the blows of a tap to its receptance: H1 over blows, coherence, and what each blow adds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbed.analysis.records.white_noise import white_noise
from testbed.analysis.tap.blows import lasting, left_at_end
from testbed.analysis.tap.frequency_response import FrequencyResponse
from testbed.machine import Carrier
from testbed.recording import DERIVATIVES

_POWER = 1e-4  # of the force's largest power over frequency: lines that were driven
_FLOOR = 10.0  # times the power of the force's noise
_HIGHEST = 0.45  # of the sampling rate: a converter's filter bends what is above
_ENDS_AT = 1e-3  # of a response's first swing, that the window leaves of it at the end
_FADES = 3.0  # e-folds of the window where all has died away: later samples hold noise alone


@dataclass(frozen=True)
class Stretch:
    """Force (N) and response (SI) of one blow, and what of each came before the pulse (samples)."""

    force: np.ndarray
    response: np.ndarray
    before: int


def averaged(name: str, stretches: Sequence[Stretch], rate: float, quantity: str, along: tuple[float, float],
             sensed: tuple[float, float], on: Carrier, window: float) -> FrequencyResponse:
    """The receptance of blows at one point. window: 1/s, of an exponential window that the response came with.

    Force and response are given one exponential window more: the receptance is then known at s = i omega + decay, without
    leakage from what still rings at the end and with less noise from what no longer does. Fits undo it exactly.
    """
    length = min(len(one.force) for one in stretches)
    noises = [white_noise(one.response[:length]) for one in stretches]
    length = min(length, max(lasting(one.response[:length], one.before, noise)
                             for one, noise in zip(stretches, noises, strict=True)))
    time = np.arange(length) / rate
    left = max(left_at_end(one.response[:length], noise) for one, noise in zip(stretches, noises, strict=True))
    decay = max(_FADES, np.log(max(left, 1e-300) / _ENDS_AT)) / time[-1]
    fade = np.exp(-decay * time)
    forces = np.array([np.fft.rfft(_levelled(one.force, one.before, length) * fade) for one in stretches])
    motions = np.array([np.fft.rfft(_levelled(one.response, one.before, length) * fade) for one in stretches])
    frequency = np.fft.rfftfreq(length, 1.0 / rate)
    s = 2j * np.pi * frequency + decay + window
    order = DERIVATIVES[quantity]
    kept = (frequency > 0) & (frequency <= _HIGHEST * rate)
    motions[:, kept] /= s[kept] ** order
    drive = (np.abs(forces) ** 2).sum(axis=0)
    mean = (motions * forces.conj()).sum(axis=0) / np.maximum(drive, 1e-300)
    deviations = (motions - mean * forces) * forces.conj() / np.maximum(drive, 1e-300)
    coherence = None
    if len(stretches) > 1:
        answer = (np.abs(motions) ** 2).sum(axis=0)
        coherence = (np.abs((motions * forces.conj()).sum(axis=0)) ** 2 / np.maximum(drive * answer, 1e-300))[kept]
    energy = float((fade**2).sum())
    floor = sum(white_noise(one.force[:length]) ** 2 for one in stretches) * energy
    loud = np.sqrt(np.mean(np.square(noises)) * energy / np.maximum(drive, 1e-300))[kept] / np.abs(s[kept]) ** order
    driven = (drive > _POWER * drive.max()) & (drive > _FLOOR * floor)
    return FrequencyResponse(name, frequency[kept], mean[kept], along, sensed, on, deviations[:, kept], coherence, driven[kept],
                             decay + window, loud)


def _levelled(values: np.ndarray, before: int, length: int) -> np.ndarray:
    """A stretch without its offset, as it stood before the pulse."""
    part = values[:length]
    quiet = part[:before] if before >= 8 else part[-max(8, length // 10) :]
    return part - float(np.mean(quiet))
