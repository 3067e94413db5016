"""What every part is given: engines, seed and effort; the paper's machine, its tests and records of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from testbed.cut import Cut, whole_cut_sampling
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.recording import Recording

MASS = 2.573  # kg
RATIO = 0.3  # Gamma2 over Gamma1, the paper's (Tlusty's rule)
IMMERSION = 0.162  # inferred: the only range that reproduces all published outcomes is 0.155-0.187
RATE = 12800.0  # Hz
NOISE = 0.5e-6  # m
COUNTS = 2e-3 / 2**16  # m: 16 bits over +-1 mm
START_OMEGA, START_GAMMA = 930.0, 5.0e8  # the paper's starting guess: rad/s, N m^-2 kg^-1
FOUND_OMEGA, FOUND_GAMMA = 921.1, 2.16e8  # the paper's converged estimates
IDLE, PASSES, RING_DOWN = 10, 60, 60  # tooth passes of a test

# the paper's identified machine, and the one of modal test and dynamometer
IDENTIFIED = Model(Structure(MASS, FOUND_OMEGA / (2 * math.pi), 0.0032), Cutter(),
                   Cutting("up-milling", IMMERSION, FOUND_GAMMA * MASS, RATIO * FOUND_GAMMA * MASS))
MEASURED = Model(Structure(MASS, 920.0 / (2 * math.pi), 0.0032), Cutter(),
                 Cutting("up-milling", IMMERSION, 5.5e8, 2.0e8))

Simulate = Callable[..., Recording]


@dataclass(frozen=True)
class Bench:
    """reference: the MuJoCo engine's simulate; fast: the compiled engine's; render(path, camera): draws the rig, None
    where nothing can. quick: few repeats and coarse grids, for a look and for tests. folder: where pictures go."""

    reference: Simulate
    fast: Simulate
    folder: Path
    seed: int = 2006
    quick: bool = False
    render: Callable[[Path, str], Any] | None = None

    def count(self, full: int, quick: int) -> int:
        """How many: `full`, or `quick` where only a look is asked for."""
        return quick if self.quick else full

    def random(self, *key: object) -> np.random.Generator:
        """A generator that depends on the seed and the key alone."""
        return np.random.default_rng([self.seed, crc32(repr(key).encode())])


def cut_at(speed_rpm: float, depth_mm: float, **course: float) -> Cut:
    """A cut by its speed in rpm and its depth in mm."""
    return Cut(speed_rpm * math.pi / 30.0, depth_mm * 1e-3, **course)  # type: ignore[arg-type]


def course_of(cut: Cut, passes: int = PASSES, ring_down: int = RING_DOWN) -> Cut:
    """The cut as a whole test: idling, entry at once, cutting, an abrupt stop, ring-down."""
    return replace(cut, idle_passes=IDLE, passes=passes, ring_down_passes=ring_down)


def clean_record(simulate: Simulate, model: Model, cut: Cut, *, catalogue: Mapping[str, Any] | None = None,
                 steps: int | None = None) -> Recording:
    """The displacement of a whole test as it is, with the times of entry and exit in its conditions."""
    more: dict[str, Any] = {} if catalogue is None else {"catalogue": catalogue}
    recording = simulate(model, cut, whole_cut_sampling(cut, 1, RATE), steps=steps, **more)
    tau = cut.tooth_passing_period(1)
    times = {"entry_time": cut.idle_passes * tau, "exit_time": (cut.idle_passes + cut.passes) * tau}
    return replace(recording, conditions={**recording.conditions, **times})


def measured(recording: Recording, random: np.random.Generator, noise: float = NOISE) -> Recording:
    """The record as a 16-bit sensor with white noise and an offset gives it; marks lag by an unknown, constant angle."""
    clean = recording.channels["displacement"]
    signal = clean + noise * random.standard_normal(clean.size) + 3e-6 * random.standard_normal()
    lag = random.uniform(0.0, 2.0 * math.pi) / float(recording.conditions["spindle_speed"])
    return replace(recording, channels={"displacement": np.round(signal / COUNTS) * COUNTS}, units={"displacement": "m"},
                   marks=recording.marks + lag, pass_times=recording.pass_times[:0])
