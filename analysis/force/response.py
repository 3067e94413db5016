"""How the oscillator answers a force that is known over the cells of a record: its exact response, sample by sample."""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.force.cut_variables import SUBSTEPS
from testbed.machine import Model


def response(model: Model, force: np.ndarray, rate: float, kind: str) -> np.ndarray:
    """Response (samples,) from rest to a force over the cells (cells,), N; kind: displacement, velocity or acceleration."""
    from scipy.signal import lfilter  # slow to import, wanted by few

    structure = model.structure
    rows = force.reshape(-1, SUBSTEPS)
    dt = 1.0 / rate
    whole = _free(structure.natural_frequency_rad, structure.damping_ratio, dt)
    pushes = np.array([_push(model, dt / SUBSTEPS, dt * (1 - (cell + 1) / SUBSTEPS)) for cell in range(SUBSTEPS)])
    push = np.vstack([np.zeros(2), rows @ pushes])  # (samples, 2), of the interval that ends at each sample
    bottom = [1.0, -float(np.trace(whole)), float(np.linalg.det(whole))]
    late = np.vstack([np.zeros(2), push[:-1]])
    if kind != "velocity":
        x = lfilter([1.0], bottom, push[:, 0] - whole[1, 1] * late[:, 0] + whole[0, 1] * late[:, 1])
        if kind == "displacement":
            return x
    v = lfilter([1.0], bottom, push[:, 1] - whole[0, 0] * late[:, 1] + whole[1, 0] * late[:, 0])
    if kind == "velocity":
        return v
    means = np.concatenate([rows[:1, 0], 0.5 * (rows[:-1, -1] + rows[1:, 0]), rows[-1:, -1]])
    return (means - structure.damping * v - structure.stiffness * x) / structure.mass


def _free(omega: float, zeta: float, dt: float) -> np.ndarray:
    """Exact transition of [x, v] in free vibration."""
    decay, damped = zeta * omega, omega * math.sqrt(1.0 - zeta**2)
    c, s, e = math.cos(damped * dt), math.sin(damped * dt) / damped, math.exp(-decay * dt)
    return e * np.array([[c + decay * s, s], [-(omega**2) * s, c - decay * s]])


def _push(model: Model, length: float, rest: float) -> np.ndarray:
    """[x, v] at the end of a sample of a unit force that acts for `length` and then leaves the structure free for `rest`."""
    structure = model.structure
    over = _free(structure.natural_frequency_rad, structure.damping_ratio, length)
    static = 1.0 / structure.stiffness
    pushed = np.array([static, 0.0]) - over @ np.array([static, 0.0])
    return _free(structure.natural_frequency_rad, structure.damping_ratio, rest) @ pushed
