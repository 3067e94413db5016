"""What a sensor adds beyond white noise: pink noise, a slow wandering, the hum of the mains, spikes, lost samples."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True)
class NoiseRecipe:
    """A sum of disturbances, in the channel's SI unit.

    pink: rms of noise whose power falls as 1/f, from the first to the last frequency of the record. wander: a random
    walk's rms after one second, unit/sqrt(s). hum: amplitude of a sine at hum_frequency (Hz) of random phase.
    spikes: height of single wrong samples, of either sign, of which there are spike_rate a second on average.
    lost: share of samples lost; a converter holds its last value then.
    """

    pink: float = 0.0
    wander: float = 0.0
    hum: float = 0.0
    hum_frequency: float = 50.0
    spikes: float = 0.0
    spike_rate: float = 0.0
    lost: float = 0.0

    def __post_init__(self) -> None:
        if any(not (math.isfinite(getattr(self, one.name)) and getattr(self, one.name) >= 0) for one in fields(self)):
            raise ValueError("every part of a noise recipe must be finite and at least 0")
        if self.lost >= 1.0:
            raise ValueError("lost must be below 1")

    def disturbed(self, signal: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
        """The signal, shape (samples,), with the recipe's disturbances; rate: samples a second."""
        count = len(signal)
        found = signal + self.pink * pink_noise(count, rng) if self.pink else signal.copy()
        if self.wander:
            found = found + self.wander * math.sqrt(1.0 / rate) * np.cumsum(rng.standard_normal(count))
        if self.hum:
            phase = rng.uniform(0.0, 2.0 * math.pi)
            found = found + self.hum * np.sin(2.0 * math.pi * self.hum_frequency * np.arange(count) / rate + phase)
        if self.spikes and self.spike_rate:
            struck = rng.random(count) < self.spike_rate / rate
            found = found + np.where(struck, self.spikes * rng.choice((-1.0, 1.0), count), 0.0)
        if self.lost:
            kept = rng.random(count) >= self.lost
            kept[:1] = True
            found = found[np.maximum.accumulate(np.where(kept, np.arange(count), 0))]
        return found


def pink_noise(count: int, rng: np.random.Generator) -> np.ndarray:
    """Noise of unit rms (expected) whose power density falls as 1/f, without a mean; shape (count,)."""
    if count < 2:
        return np.zeros(count)
    spectrum = np.fft.rfft(rng.standard_normal(count))
    weights = np.zeros(len(spectrum))
    weights[1:] = 1.0 / np.sqrt(np.arange(1, len(spectrum)))
    # One-sided: every line but the last of an even count stands for two.
    twice = np.where((np.arange(len(spectrum)) == len(spectrum) - 1) & (count % 2 == 0), 1.0, 2.0)
    return np.fft.irfft(spectrum * weights, count) / math.sqrt(float((twice * weights**2).sum()) / count)
