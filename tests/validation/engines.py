"""The two engines against each other and against closed forms: agreement, order through entry and exit, ring-down."""

from __future__ import annotations

import math
from types import ModuleType

import numpy as np

from testbed.cut import Cut, whole_cut_sampling
from testbed.engines import fast, mujoco_engine
from testbed.machine import Model
from tests.validation.claims import FLEXURE, Claim, Section, below, rpm

RATE = 12800.0
_COURSE = {"idle_passes": 1, "passes": 25, "ring_down_passes": 2, "initial_displacement": 1e-5}
STABLE, GROWING = rpm(3810, 2.9, **_COURSE), rpm(3635, 2.0, **_COURSE)


def motion(engine: ModuleType, model: Model, cut: Cut, steps: int | None) -> np.ndarray:
    """The displacement of the whole course, m."""
    recording = engine.simulate(model, cut, whole_cut_sampling(cut, model.cutter.flutes, RATE), steps=steps)
    signal = recording.channels["displacement"]
    return signal[recording.time <= recording.pass_times[-1]]


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(one - other).max() / np.abs(other).max())


def orders(engine: ModuleType, model: Model, cut: Cut, steps: tuple[int, ...], reference: np.ndarray) -> np.ndarray:
    """Orders between neighbouring step counts against a reference."""
    errors = np.array([difference(motion(engine, model, cut, count), reference) for count in steps])
    return np.log(errors[:-1] / errors[1:]) / np.log(np.array(steps[1:]) / np.array(steps[:-1]))


def ring_down_error(engine: ModuleType) -> float:
    """Largest error of a free decay of 60 passes against the closed form, relative to its start."""
    cut = rpm(3810, 2.9, idle_passes=0, passes=0, ring_down_passes=60, initial_displacement=1e-4,
              initial_velocity=0.05)
    sampling = whole_cut_sampling(cut, 1, RATE)
    recording = engine.simulate(FLEXURE, cut, sampling)
    omega, zeta = FLEXURE.structure.natural_frequency_rad, FLEXURE.structure.damping_ratio
    damped, t = omega * math.sqrt(1 - zeta**2), recording.time
    exact = np.exp(-zeta * omega * t) * (1e-4 * np.cos(damped * t)
                                         + (0.05 + zeta * omega * 1e-4) / damped * np.sin(damped * t))
    return difference(recording.channels["displacement"], exact)


def check() -> Section:
    """The section of the table."""
    claims = []
    for name, cut, limit in (("stable", STABLE, 1e-9), ("growing", GROWING, 1e-7)):
        found = difference(motion(mujoco_engine, FLEXURE, cut, 480), motion(fast, FLEXURE, cut, 800))
        claims.append(below(f"MuJoCo (480 steps) against fast (800 steps), {name} cut", found, limit))
    for name, engine, steps in (("fast", fast, (6, 12, 24)), ("MuJoCo", mujoco_engine, (15, 30, 60))):
        for kind, cut in (("stable", STABLE), ("growing", GROWING)):
            found = orders(engine, FLEXURE, cut, steps, motion(fast, FLEXURE, cut, 800))
            claims.append(Claim(f"order of {name} through entry and exit, {kind} cut", ">= 3.5",
                                ", ".join(f"{value:.2f}" for value in found), bool(found.min() >= 3.5)))
    for name, engine, limit in (("fast", fast, 1e-9), ("MuJoCo", mujoco_engine, 1e-5)):
        note = "" if engine is fast else "at its default step"
        claims.append(below(f"{name}: ring-down of 60 periods against the closed form", ring_down_error(engine), limit,
                            note=note))
    return Section("Engines", tuple(claims))
