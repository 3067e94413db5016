"""Free decays by their closed form, as a sensor would record them; nothing here knows the analysis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbed.recording import Recording


def decay(time: np.ndarray, start: float, frequency: float, damping: float, phase: float = 0.0) -> np.ndarray:
    """exp(-zeta w s) sin(w_d s + phase) from `start` (s) on, 0 before; frequency undamped, Hz."""
    since, turning = time - start, 2 * np.pi * frequency
    wave = np.sin(turning * np.sqrt(1 - damping**2) * since + phase)
    return np.where(since >= 0, np.exp(-damping * turning * np.maximum(since, 0.0)) * wave, 0.0)


def rung(modes: Sequence[tuple[float, float, float, float]], time: np.ndarray, start: float = 0.0) -> np.ndarray:
    """Accelerations along x and y (2, samples) from `start` (s) on, of modes (Hz, damping ratio, direction in rad, m/s^2)."""
    total = np.zeros((2, len(time)))
    for frequency, damping, angle, size in modes:
        # displacement sin(w_d s), derived twice: its phase is turned by twice that of the pole
        turn = 2.0 * (np.pi - np.arccos(damping))
        total += np.outer([np.cos(angle), np.sin(angle)], size * decay(time, start, frequency, damping, turn))
    return total


def recorded(values: np.ndarray, rate: float, channel: str = "displacement") -> Recording:
    """Values as a measured recording of one channel."""
    return Recording({channel: values}, rate, {channel: "m"}, "measured")


def rubbed(amplitude: float, frequency: float, damping: float, stop: float, rate: float, samples: int) -> np.ndarray:
    """A decay with viscous and dry friction, half a swing after the other by its closed form, until it rests.

    stop: how far from the middle friction holds it (force over stiffness).
    """
    turning = 2 * np.pi * frequency
    damped, half = turning * np.sqrt(1 - damping**2), np.pi / (turning * np.sqrt(1 - damping**2))
    place, time = amplitude, np.arange(samples) / rate
    values, begin = np.full(samples, amplitude), 0.0
    while abs(place) > stop:
        middle = np.copysign(stop, place)
        here = (time >= begin) & (time < begin + half)
        since = time[here] - begin
        swing = np.cos(damped * since) + damping / np.sqrt(1 - damping**2) * np.sin(damped * since)
        values[here] = middle + (place - middle) * np.exp(-damping * turning * since) * swing
        place = middle - (place - middle) * np.exp(-damping * turning * half)
        begin += half
    values[time >= begin] = place
    return values


def taps(
    rate: float, samples: int, blows: Sequence[tuple[float, float]], frequency: float, damping: float, noise: float, seed: int
) -> np.ndarray:
    """Blows (time in s, size) on one mode, in white noise."""
    time = np.arange(samples) / rate
    motion = sum(size * decay(time, start, frequency, damping) for start, size in blows)
    return motion + noise * np.random.default_rng(seed).standard_normal(samples)
