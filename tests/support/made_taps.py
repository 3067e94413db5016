"""Hammer blows on machines that are known: force and acceleration as they would be sampled, exact but for their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import cont2discrete, lfilter, resample_poly

from testbed.machine import Mode

OVERSAMPLED = 8
B2 = (Mode(7.9331e6 / (2 * np.pi * 456.78) ** 2, 456.78, 0.11171, 0.0, "tool"),
      Mode(1.46918e7 / (2 * np.pi * 1448.89) ** 2, 1448.89, 0.01704, 0.0, "tool"),
      Mode(9.3746e6 / (2 * np.pi * 516.52) ** 2, 516.52, 0.02458, np.pi / 2, "tool"),
      Mode(1.24064e7 / (2 * np.pi * 1408.45) ** 2, 1408.45, 0.03136, np.pi / 2, "tool"))
B3 = (Mode(0.8369**-2, 369.85, 0.0316, 0.0, "tool"), Mode(2.4757**-2, 1146.36, 0.0114, 0.0, "tool"),
      Mode(0.9727**-2, 411.21, 0.0168, np.pi / 2, "tool"), Mode(2.7837**-2, 1069.21, 0.0155, np.pi / 2, "tool"))


@dataclass(frozen=True)
class Hammer:
    """How a structure is struck: blows at `spacing` s, pulses of `width` s, peaks near `force` N; noise over the peak."""

    blows: int = 4
    spacing: float = 1.0
    width: float = 0.3e-3
    force: float = 300.0
    rate: float = 25600.0
    force_noise: float = 3e-4
    response_noise: float = 1e-3


def blows(modes: Sequence[Mode], along: tuple[float, float], sensed: tuple[float, float], hammer: Hammer,
          seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Force (N) and acceleration (m/s^2) of a record of blows."""
    rng = np.random.default_rng(seed)
    step = 1.0 / (hammer.rate * OVERSAMPLED)
    time = np.arange(round((hammer.blows * hammer.spacing + 0.05) / step)) * step
    force = np.zeros(len(time))
    for number in range(hammer.blows):
        start = 0.05 + number * hammer.spacing + rng.uniform(0.0, 1e-3)
        width = hammer.width * rng.uniform(0.9, 1.1)
        inside = (time >= start) & (time <= start + width)
        force[inside] += hammer.force * rng.uniform(0.7, 1.3) * np.sin(np.pi * (time[inside] - start) / width)
    response = np.zeros(len(time))
    for mode in modes:
        response += _answer(mode, force, step) * float(np.dot(mode.shape, along) * np.dot(mode.shape, sensed))
    force, response = (resample_poly(one, 1, OVERSAMPLED) for one in (force, response))  # with the filter of a converter
    return (force + rng.normal(0.0, hammer.force_noise * hammer.force, len(force)),
            response + rng.normal(0.0, hammer.response_noise * max(np.abs(response).max(), 10.0), len(response)))


def _answer(mode: Mode, force: np.ndarray, step: float) -> np.ndarray:
    """Acceleration of one mode, m/s^2, exact for a force that is straight from sample to sample."""
    omega, zeta = mode.natural_frequency_rad, mode.damping_ratio
    system = (np.array([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]]), np.array([[0.0], [1.0 / mode.mass]]),
              np.array([[-(omega**2), -2 * zeta * omega]]), np.array([[1.0 / mode.mass]]))
    a, b, c, d, _ = cont2discrete(system, step, "foh")
    trace, determinant = a[0, 0] + a[1, 1], a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    denominator = np.array([1.0, -trace, determinant])
    first = (c @ b)[0, 0]
    second = (c @ a @ b)[0, 0]
    numerator = np.array([d[0, 0], first - trace * d[0, 0], second - trace * first + determinant * d[0, 0]])
    return lfilter(numerator, denominator, force)


def write_taps(folder: Path, modes: Sequence[Mode], pairs: str = "xx yy", hammer: Hammer | None = None, seed: int = 0,
               signs: dict[str, float] | None = None) -> Path:
    """taps.yaml and its files: `xy` is a force along x and the response along y. signs: of a pair's response."""
    hammer = hammer or Hammer()
    axes = {"x": (1.0, 0.0), "y": (0.0, 1.0)}
    lines = [f"sampling_rate: {hammer.rate!r} Hz", "on: tool", "force: {column: F, unit: N}", "taps:"]
    for place, pair in enumerate(pairs.split()):
        force, response = blows(modes, axes[pair[0]], axes[pair[1]], hammer, 100 * seed + place)
        table = np.column_stack([force, response * (signs or {}).get(pair, 1.0)])
        np.savetxt(folder / f"{pair}.csv", table, delimiter=",", header="F,a", comments="", fmt="%.9g")
        sensor = "" if pair[0] == pair[1] else f", direction: {pair[1]}"
        lines.append(f"  - {{file: {pair}.csv, direction: {pair[0]}, "
                     f"response: {{column: a, unit: m/s^2, quantity: acceleration{sensor}}}}}")
    path = folder / "taps.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path
