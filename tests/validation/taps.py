"""The tap test on machines that are known: blows with noise in, modes out, and what their stability limits are worth."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis.tap.tap import TapResult, tap_test
from testbed.machine import Mode
from testbed.taps_file import load_taps
from tests.made_taps import Hammer, write_taps

MACHINES = 50
CLOSE = 0.03  # of a frequency, that the modes of a close pair are apart
NAMES = ("natural_frequency", "damping_ratio", "mass")
HALF_DOWN = (math.pi / 2, math.pi)  # rad, from entry to exit
TEETH, TANGENTIAL, NORMAL_SHARE = 2, 1319.4e6, 788.8 / 1319.4  # the cutter of B2


def random_machine(seed: int) -> tuple[list[Mode], Hammer]:
    """2 to 6 modes along x and y, half the machines with a close pair; 1 to 8 blows."""
    random = np.random.default_rng([77, seed])
    count = int(random.integers(2, 7))
    pair = seed % 2 == 0
    modes: list[Mode] = []
    while len(modes) < count:
        axis = 0.0 if len(modes) % 2 == 0 else math.pi / 2
        frequency = 10 ** random.uniform(math.log10(250.0), math.log10(2500.0))
        if pair and len(modes) == 2:
            frequency = modes[0].natural_frequency * (1.0 + CLOSE * random.uniform(0.7, 1.0))
        elif any(mode.direction == axis and abs(frequency / mode.natural_frequency - 1.0) < 0.1 for mode in modes):
            continue
        stiffness = 10 ** random.uniform(6.8, 7.6)
        damping = 10 ** random.uniform(-2.2, -1.4) if not (pair and len(modes) in (0, 2)) else 10 ** random.uniform(-2.2, -1.8)
        modes.append(Mode(stiffness / (2 * math.pi * frequency) ** 2, frequency, damping, axis, "tool"))
    return modes, Hammer(blows=1 + seed % 8, spacing=0.6)


def receptance(modes: Sequence[Any], frequency: np.ndarray) -> np.ndarray:
    """(lines, 2, 2), m/N, of modes with mass, natural_frequency (Hz), damping_ratio and shape."""
    s, total = 2j * np.pi * frequency, np.zeros((len(frequency), 2, 2), dtype=complex)
    for mode in modes:
        omega = 2 * np.pi * mode.natural_frequency
        answer = 1.0 / (mode.mass * (s**2 + 2 * mode.damping_ratio * omega * s + omega**2))
        total += answer[:, None, None] * np.outer(mode.shape, mode.shape)
    return total


def zeroth_order_limit(modes: Sequence[Any]) -> float:
    """Least depth (m) at which a half-immersion down-milling cut chatters at some speed, after Altintas and Budak (1995)."""
    def terms(t: float, share: float) -> np.ndarray:
        return np.array([[math.cos(2 * t) - 2 * share * t + share * math.sin(2 * t),
                          -math.sin(2 * t) - 2 * t + share * math.cos(2 * t)],
                         [-math.sin(2 * t) + 2 * t + share * math.cos(2 * t),
                          -math.cos(2 * t) - 2 * share * t - share * math.sin(2 * t)]])

    directional = 0.5 * (terms(HALF_DOWN[1], NORMAL_SHARE) - terms(HALF_DOWN[0], NORMAL_SHARE))
    frequency = np.concatenate([mode.natural_frequency * np.linspace(0.9, 1.3, 20001) for mode in modes])
    values = np.linalg.eigvals(directional @ receptance(modes, frequency))
    kappa = values.imag / values.real
    depth = -2 * math.pi * values.real * (1 + kappa**2) / (TEETH * TANGENTIAL) / np.abs(values) ** 2
    return float(depth[depth > 0].min())


def measured(modes: Sequence[Mode], hammer: Hammer, seed: int, pairs: str = "xx yy",
             signs: dict[str, float] | None = None) -> TapResult:
    """The tap test of blows on a machine."""
    with tempfile.TemporaryDirectory() as folder:
        return tap_test(load_taps(write_taps(Path(folder), modes, pairs, hammer, seed, signs)))


def matched(found: TapResult, modes: Sequence[Mode]) -> list[tuple[Any, Mode]]:
    """Found modes with the true ones they are, each once, the nearest of its direction."""
    left, pairs = list(found.modes), []
    for mode in modes:
        same = [one for one in left if abs(math.sin(one.direction.value - mode.direction)) < 0.5]
        if same:
            best = min(same, key=lambda one: abs(one.natural_frequency.value / mode.natural_frequency - 1.0))
            left.remove(best)
            pairs.append((best, mode))
    return pairs


def one(seed: int) -> dict[str, Any]:
    """A random machine: errors of its modes, intervals that hold, and of its limit."""
    modes, hammer = random_machine(seed)
    found = measured(modes, hammer, seed)
    pairs = matched(found, modes)
    errors = {name: [getattr(one, name).value / getattr(mode, name) - 1.0 for one, mode in pairs] for name in NAMES}
    held = [getattr(one, name).low <= getattr(mode, name) <= getattr(one, name).high for one, mode in pairs for name in NAMES]
    limit = zeroth_order_limit([one.mode() for one in found.modes]) / zeroth_order_limit(modes) - 1.0
    return {"seed": seed, "true": len(modes), "found": len(found.modes), "errors": errors, "held": held, "limit": limit,
            "blows": hammer.blows, "residual": found.residual}
