"""A scenario: which machine, which cuts, through which sensors, how often. Expanded, it is a list of runs.

See `scenarios/` for commented examples, and `testbed.scenario_file` for their reading.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import product
from typing import Literal

import numpy as np

from testbed.cut import Cut, Sampling, whole_cut_sampling
from testbed.effect import Effect
from testbed.machine import Model
from testbed.sensors.chain import SensorChain

Engine = Literal["fast", "mujoco"]
ENGINES: tuple[Engine, ...] = ("fast", "mujoco")


@dataclass(frozen=True)
class OperatingPoint:
    """Where to cut: spindle speed (rad/s) and axial depth of cut (m)."""

    spindle_speed: float
    axial_depth_of_cut: float


@dataclass(frozen=True)
class Course:
    """The course of every cut: feed per tooth (m) and its parts in tooth passes, and the structure's first state.

    initial_displacement (m), initial_velocity (m/s): the same for all runs; the spreads are the standard deviations of
    what each run adds to them, drawn from the run's own seed.
    """

    feed_per_tooth: float
    idle_passes: int
    passes: int
    ring_down_passes: int
    initial_displacement: float = 0.0
    initial_velocity: float = 0.0
    displacement_spread: float = 0.0
    velocity_spread: float = 0.0


@dataclass(frozen=True)
class Run:
    """One simulation: everything it depends on, itself a value. `index` is its place in the scenario."""

    index: int
    model: Model
    cut: Cut
    sampling: Sampling
    sensors: SensorChain
    seed: int
    steps: int | None = None

    def sensed(self) -> np.random.Generator:
        """The random numbers of this run's sensors, the same whoever computes the run and when."""
        return _generator(self.seed, self.index, 1)


def _generator(seed: int, index: int, purpose: int) -> np.random.Generator:
    """Run `index`'s stream: a child of SeedSequence(seed, spawn_key=(index,)), one for each purpose."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index, purpose)))


@dataclass(frozen=True)
class Scenario:
    """Tests of one machine, each repeated through each sensor chain.

    sensors: one chain a noise level. steps: the engine's own steps a tooth period; None leaves the choice to it.
    text: the file it was read from; `file` its name.
    """

    name: str
    model: Model
    tests: tuple[OperatingPoint, ...]
    course: Course
    sensors: tuple[SensorChain, ...] = (SensorChain(),)
    sampling_rate: float = 12_800.0
    repeats: int = 1
    seed: int = 0
    engine: Engine = "fast"
    steps: int | None = None
    text: str = ""
    file: str = ""

    def __len__(self) -> int:
        return len(self.tests) * len(self.sensors) * self.repeats

    def run(self, index: int) -> Run:
        """Run `index`: tests turn slowest, then the noise levels, then the repeats."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        place, _ = divmod(index, self.repeats)
        test_index, level = divmod(place, len(self.sensors))
        test, course = self.tests[test_index], self.course
        displacement, velocity = course.initial_displacement, course.initial_velocity
        if course.displacement_spread or course.velocity_spread:
            drawn = _generator(self.seed, index, 0).standard_normal(2)
            displacement += course.displacement_spread * float(drawn[0])
            velocity += course.velocity_spread * float(drawn[1])
        cut = Cut(test.spindle_speed, test.axial_depth_of_cut, course.feed_per_tooth, course.idle_passes,
                  course.passes, course.ring_down_passes, displacement, velocity)
        flutes = self.model.cutter.flutes if self.model.cutter else 1
        sampling = whole_cut_sampling(cut, flutes, self.sampling_rate)
        return Run(index, self.model, cut, sampling, self.sensors[level], self.seed, self.steps)

    def runs(self) -> Iterator[Run]:
        """All runs, in order."""
        return (self.run(index) for index in range(len(self)))

    def longest(self) -> int:
        """Number of samples of the longest run."""
        flutes = self.model.cutter.flutes if self.model.cutter else 1
        slowest = min(test.spindle_speed for test in self.tests)
        return whole_cut_sampling(replace(self.run(0).cut, spindle_speed=slowest), flutes, self.sampling_rate).count

    def fingerprint(self, catalogue: Mapping[str, Effect] | None = None) -> str:
        """What a resumed sweep must agree with: a hash over all that the runs depend on."""
        from testbed.model_file import model_text

        parts = (model_text(self.model, catalogue), self.tests, self.course, self.sensors, self.sampling_rate,
                 self.repeats, self.seed, self.engine, self.steps)
        return sha256("\n".join(_stable(part) for part in parts).encode()).hexdigest()


def _stable(value: object) -> str:
    """A text of a value that is the same in every process."""
    if isinstance(value, tuple):
        return "(" + ",".join(_stable(item) for item in value) + ")"
    if isinstance(value, SensorChain):
        return f"{sorted(value.channels.items())!r} {value.mark_angle!r} {value.mark_jitter!r}"
    return repr(value)


def grid(spindle_speeds: tuple[float, ...], depths: tuple[float, ...]) -> tuple[OperatingPoint, ...]:
    """Every speed (rad/s) with every depth (m); depths turn fastest."""
    return tuple(OperatingPoint(speed, depth) for speed, depth in product(spindle_speeds, depths))


def whole_passes(count: float, unit: str, flutes: int) -> int:
    """Tooth passes in a number of `revolutions` or `passes`. ValueError if they are not a whole number."""
    passes = count * flutes if unit == "revolutions" else count
    if not (math.isfinite(passes) and passes >= 0 and passes == round(passes)):
        raise ValueError("must be a whole number of tooth passes, at least 0")
    return int(passes)
