"""A small milling record for the tests of readers, segments and inspection: regenerative cut, sensor and tachometer.

Written for these tests alone, so that they share no code with the engines: velocity-Verlet steps, a delay line of the
displacement, then noise, offset and drift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from testbed.recording import Recording

MASS, FREQUENCY, DAMPING = 2.573, 146.6, 0.0032
K_T, K_N, RHO = 5.5e8, 1.65e8, 0.162


@dataclass(frozen=True)
class Truth:
    """When things happened (s) and how large the noise is (m)."""

    entry: float
    exit: float
    stop: float
    noise: float
    period: float


def milling_record(
    *,
    rpm: float = 3810.0,
    depth: float = 2.9e-3,
    idle: int = 20,
    cut: int = 40,
    ring: int = 30,
    noise: float = 0.5e-6,
    rate: float = 12800.0,
    feed: float = 0.1016e-3,
    offset: float = 3e-5,
    drift: float = 1e-5,
    seed: int = 1,
    tachometer: bool = True,
    hum: float = 0.0,
) -> tuple[Recording, Truth]:
    """Displacement (m) and tachometer (V) of a one-flute up-milling cut; idle, cut and ring count revolutions."""
    random = np.random.default_rng(seed)
    period = 60.0 / rpm
    substeps = int(np.ceil(period * rate)) * 4
    step = period / substeps
    total = (idle + cut + ring) * substeps
    position = _motion(total, substeps, step, idle * substeps, (idle + cut) * substeps, depth, feed)
    fine = np.arange(total + 1) * step
    time = np.arange(int(fine[-1] * rate)) / rate
    clean = np.interp(time, fine, position)
    moved = clean + offset + drift * np.sin(2 * np.pi * time / (2.5 * fine[-1])) + hum * np.sin(2 * np.pi * 50.0 * time)
    channels = {"displacement": moved + noise * random.standard_normal(len(time))}
    units = {"displacement": "m"}
    marks = np.empty(0)
    shift = 0.37 * period
    if tachometer:
        phase = (time - shift) % period
        rise = 3 / rate  # of an optical sensor behind an anti-aliasing filter
        pulse = np.clip(phase / rise, 0, 1) - np.clip((phase - 0.1 * period) / rise, 0, 1)
        channels["tachometer"] = 5.0 * pulse + 0.02 * random.standard_normal(len(time))
        units["tachometer"] = "V"
        marks = np.arange(shift + 0.5 * rise, time[-1], period)
    recording = Recording(
        channels,
        rate,
        units,
        "measured",
        marks=marks,
        conditions={"spindle_speed": 2 * np.pi / period, "axial_depth_of_cut": depth, "flutes": 1},
    )
    return recording, Truth(idle * period, (idle + cut) * period, fine[-1], noise, period)


def _motion(total: int, substeps: int, step: float, first: int, last: int, depth: float, feed: float) -> np.ndarray:
    """Displacement at every substep, shape (total + 1,)."""
    stiffness, damping = MASS * (2 * np.pi * FREQUENCY) ** 2, 2 * MASS * DAMPING * 2 * np.pi * FREQUENCY
    theta = 2 * np.pi * np.arange(substeps) / substeps
    gain = np.where(theta < 2 * np.pi * RHO, (K_T * np.cos(theta) + K_N * np.sin(theta)) * np.sin(theta) * depth, 0.0)
    x = [0.0] * (total + 1)
    velocity, acceleration = 0.0, 0.0
    gains = gain.tolist()
    for index in range(total):
        x[index + 1] = x[index] + step * velocity + 0.5 * step * step * acceleration
        half = velocity + 0.5 * step * acceleration
        after = index + 1
        force = 0.0
        if first <= after < last and gains[after % substeps]:
            force = -gains[after % substeps] * (feed + x[after] - (x[after - substeps] if after >= substeps else 0.0))
        acceleration = (force - stiffness * x[after] - damping * half) / MASS
        velocity = half + 0.5 * step * acceleration
    return np.array(x)
