"""A scenario: which machine, which cuts, through which sensors, how often. Expanded, it is a list of runs.

See `scenarios/` for commented examples, and `testbed.scenario.scenario_file` for their reading.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Literal

import numpy as np

from testbed.cut import Cut, Cuts, Sampling, whole_cut_counts, whole_cut_sampling
from testbed.effect import Effect
from testbed.machine import Model
from testbed.scenario.design import DEPTH, FEED, SPEED, STARTS, Design, Grid, OperatingPoint, Sampled
from testbed.scenario.draws import Chance, Distribution
from testbed.scenario.streams import streams
from testbed.sensors.chain import SensorChain

Engine = Literal["fast", "mujoco"]
ENGINES: tuple[Engine, ...] = ("fast", "mujoco")


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


@dataclass(frozen=True)
class Runs:
    """Neighbouring runs of a scenario, side by side: the same values as each `Run`, a column for each.

    counts: samples of each, shape (runs,), at `rate` (Hz) from time 0. models, sensors: of each run, often one and the same.
    """

    first: int
    models: Sequence[Model]
    cuts: Cuts
    counts: np.ndarray
    rate: float
    sensors: Sequence[SensorChain]
    seed: int
    steps: int | None

    def __len__(self) -> int:
        return len(self.models)

    def __getitem__(self, some: slice) -> Runs:
        return replace(self, first=self.first + range(len(self))[some].start, models=self.models[some], cuts=self.cuts[some],
                       counts=self.counts[some], sensors=self.sensors[some])

    def sensed(self) -> Iterator[np.random.Generator]:
        """The random numbers of every run's sensors in turn, see `Run`; each is good until the next is asked for."""
        return streams(self.seed, self.first + np.arange(len(self)), 1)


def side_by_side(runs: Sequence[Run]) -> Runs:
    """Runs that are there one by one, in order."""
    head = runs[0]
    return Runs(head.index, [run.model for run in runs], Cuts.of([run.cut for run in runs]),
                np.array([run.sampling.count for run in runs]), head.sampling.rate, [run.sensors for run in runs], head.seed,
                head.steps)


def _generator(seed: int, index: int, purpose: int) -> np.random.Generator:
    """Run `index`'s stream: a child of SeedSequence(seed, spawn_key=(index,)), one for each purpose."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(index, purpose))))


@dataclass(frozen=True)
class Scenario:
    """Tests of one machine, each repeated through each sensor chain.

    tests: operating points, a design or a plain tuple of them. sensors: one chain a noise level. chances: what every run
    draws of its own; noise_drawn: channels whose white noise it draws. steps: the engine's own steps a tooth period; None
    leaves the choice to it. text: the file it was read from; `file` its name.
    """

    name: str
    model: Model
    tests: Sequence[OperatingPoint]
    course: Course
    sensors: tuple[SensorChain, ...] = (SensorChain(),)
    sampling_rate: float = 12_800.0
    repeats: int = 1
    seed: int = 0
    engine: Engine = "fast"
    steps: int | None = None
    chances: tuple[Chance, ...] = ()
    noise_drawn: tuple[tuple[str, Distribution], ...] = ()
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
        model, sensors = self.model, self.sensors[level]
        own = dict(test.values)
        if self.chances or self.noise_drawn:
            rng = _generator(self.seed, index, 2)
            for chance in self.chances:
                own |= chance.draw(rng)
            noises = {name: distribution.draw(rng) for name, distribution in self.noise_drawn}
            sensors = replace(sensors, channels={name: replace(sensor, noise=noises.get(name, sensor.noise))
                                                 for name, sensor in sensors.channels.items()},
                              mark_angle=own.pop("mark_angle", sensors.mark_angle))
        feed = own.pop(FEED, course.feed_per_tooth)
        displacement, velocity = (own.pop(name, value) for name, value in
                                  zip(STARTS, (course.initial_displacement, course.initial_velocity), strict=True))
        if own:
            model = model.with_values(own)
        if course.displacement_spread or course.velocity_spread:
            drawn = _generator(self.seed, index, 0).standard_normal(2)
            displacement += course.displacement_spread * float(drawn[0])
            velocity += course.velocity_spread * float(drawn[1])
        cut = Cut(test.spindle_speed, test.axial_depth_of_cut, feed, course.idle_passes, course.passes,
                  course.ring_down_passes, displacement, velocity)
        sampling = whole_cut_sampling(cut, self._flutes, self.sampling_rate)
        return Run(index, model, cut, sampling, sensors, self.seed, self.steps)

    def between(self, first: int, last: int) -> Runs:
        """Runs `first` up to `last`, side by side; each is what `run` gives."""
        given = self._columns(np.arange(first, last) // (self.repeats * len(self.sensors)))
        if given is None:
            return side_by_side([self.run(index) for index in range(first, last)])
        course, count, levels = self.course, last - first, np.arange(first, last) // self.repeats % len(self.sensors)
        displacement, velocity = (given.get(name, value) for name, value in
                                  zip(STARTS, (course.initial_displacement, course.initial_velocity), strict=True))
        if course.displacement_spread or course.velocity_spread:
            drawn = np.array([rng.standard_normal(2) for rng in streams(self.seed, np.arange(first, last), 0)]).T
            displacement, velocity = (displacement + course.displacement_spread * drawn[0],
                                      velocity + course.velocity_spread * drawn[1])
        cuts = Cuts.alike(count, spindle_speed=given[SPEED], axial_depth_of_cut=given[DEPTH],
                          feed_per_tooth=given.get(FEED, course.feed_per_tooth), idle_passes=course.idle_passes,
                          passes=course.passes, ring_down_passes=course.ring_down_passes, initial_displacement=displacement,
                          initial_velocity=velocity)
        counts = whole_cut_counts(cuts, self._flutes, self.sampling_rate).astype(int)
        return Runs(first, [self.model] * count, cuts, counts, self.sampling_rate, [self.sensors[level] for level in levels],
                    self.seed, self.steps)

    def _columns(self, places: np.ndarray) -> dict[str, np.ndarray] | None:
        """The parameters of these tests where they are those of the cut alone, and runs draw no others; None where not so."""
        if self.chances or self.noise_drawn or not isinstance(self.tests, Design):
            return None
        given = self.tests.columns(places)
        return given if set(given) <= {SPEED, DEPTH, FEED, *STARTS} else None

    @property
    def _flutes(self) -> int:
        return self.model.cutter.flutes if self.model.cutter else 1

    def runs(self) -> Iterator[Run]:
        """All runs, in order."""
        return (self.run(index) for index in range(len(self)))

    def longest(self) -> int:
        """Number of samples of the longest run."""
        tests = self.tests
        slowest = tests.slowest() if isinstance(tests, Design) else min(test.spindle_speed for test in tests)
        return whole_cut_sampling(replace(self.run(0).cut, spindle_speed=slowest), self._flutes, self.sampling_rate).count

    def with_seed(self, seed: int) -> Scenario:
        """The same scenario with another seed, in its design too."""
        tests = replace(self.tests, seed=seed) if isinstance(self.tests, Sampled) else self.tests
        return replace(self, seed=seed, tests=tests)

    def fingerprint(self, catalogue: Mapping[str, Effect] | None = None) -> str:
        """What a resumed sweep must agree with: a hash over all that the runs depend on."""
        from testbed.files.model_file import model_text

        parts = (model_text(self.model, catalogue), self.tests, self.course, self.sensors, self.sampling_rate,
                 self.repeats, self.seed, self.engine, self.steps, self.chances, self.noise_drawn)
        return sha256("\n".join(_stable(part) for part in parts).encode()).hexdigest()


def _stable(value: object) -> str:
    """A text of a value that is the same in every process."""
    if isinstance(value, tuple):
        return "(" + ",".join(_stable(item) for item in value) + ")"
    if isinstance(value, SensorChain):
        return f"{sorted(value.channels.items())!r} {value.mark_angle!r} {value.mark_jitter!r}" \
            + "".join(f" {name} on tool" for name in value.on_tool)
    return repr(value)


def grid(spindle_speeds: tuple[float, ...], depths: tuple[float, ...]) -> Grid:
    """Every speed (rad/s) with every depth (m); depths turn fastest."""
    return Grid(((SPEED, tuple(spindle_speeds)), (DEPTH, tuple(depths))))


def whole_passes(count: float, unit: str, flutes: int) -> int:
    """Tooth passes in a number of `revolutions` or `passes`. ValueError if they are not a whole number."""
    passes = count * flutes if unit == "revolutions" else count
    if not (math.isfinite(passes) and passes >= 0 and passes == round(passes)):
        raise ValueError("must be a whole number of tooth passes, at least 0")
    return int(passes)
