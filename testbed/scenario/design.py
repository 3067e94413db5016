"""Where the runs of a scenario lie: a grid, a list, or a design that fills a space of parameters.

A design is a small value; its points are worked out when they are asked for, so that a million runs cost no memory and
travel to a worker as a few numbers.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import prod
from typing import Literal, overload

import numpy as np

Method = Literal["latin_hypercube", "sobol", "random"]
SPEED, DEPTH, FEED = "spindle_speed", "depth_of_cut", "feed"
STARTS = ("initial_displacement", "initial_velocity")


@dataclass(frozen=True)
class OperatingPoint:
    """Where to cut: spindle speed (rad/s), axial depth of cut (m), and other parameters by path where they vary too."""

    spindle_speed: float
    axial_depth_of_cut: float
    values: tuple[tuple[str, float], ...] = ()


def point(given: Mapping[str, float]) -> OperatingPoint:
    """The operating point of parameters by name."""
    return OperatingPoint(given[SPEED], given[DEPTH],
                          tuple((name, value) for name, value in given.items() if name not in (SPEED, DEPTH)))


class Design(Sequence[OperatingPoint]):
    """Operating points in order, worked out one at a time."""

    @abstractmethod
    def at(self, index: int) -> OperatingPoint:
        """The point of that number, from 0."""

    def slowest(self) -> float:
        """The lowest spindle speed of all points, rad/s."""
        return min(one.spindle_speed for one in self)

    @abstractmethod
    def columns(self, places: np.ndarray) -> dict[str, np.ndarray]:
        """Of the points of these numbers every parameter by its name, shape (points,)."""

    @overload
    def __getitem__(self, index: int) -> OperatingPoint: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[OperatingPoint, ...]: ...

    def __getitem__(self, index):
        if isinstance(index, slice):
            return tuple(self.at(place) for place in range(*index.indices(len(self))))
        place = index + len(self) if index < 0 else index
        if not 0 <= place < len(self):
            raise IndexError(index)
        return self.at(place)

    def __iter__(self) -> Iterator[OperatingPoint]:
        return (self.at(place) for place in range(len(self)))


@dataclass(frozen=True, eq=True)
class Grid(Design):
    """Every value of each axis with every value of the others; the last axis turns fastest."""

    axes: tuple[tuple[str, tuple[float, ...]], ...]

    def __len__(self) -> int:
        return prod(len(values) for _, values in self.axes)

    def at(self, index: int) -> OperatingPoint:
        """The point of that number, from 0."""
        return point({name: values.item() for name, values in self.columns(np.array([index])).items()})

    def columns(self, places: np.ndarray) -> dict[str, np.ndarray]:
        """Of the points of these numbers every parameter by its name, shape (points,)."""
        given: dict[str, np.ndarray] = {}
        for name, values in reversed(self.axes):
            places, turn = np.divmod(places, len(values))
            given[name] = np.array(values, float)[turn]
        return {name: given[name] for name, _ in self.axes}

    def slowest(self) -> float:
        """The lowest spindle speed of all points, rad/s."""
        return min(dict(self.axes)[SPEED])


@dataclass(frozen=True)
class Range:
    """A parameter from `low` to `high`, spread evenly, or evenly in its logarithm."""

    name: str
    low: float
    high: float
    logarithmic: bool = False

    def value(self, share: np.ndarray) -> np.ndarray:
        """Values at shares 0 to 1 of the way."""
        if self.logarithmic:
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share


@dataclass(frozen=True)
class Sampled(Design):
    """`size` points that fill a box of parameters: scipy.stats.qmc's Latin hypercube or scrambled Sobol sequence, or
    independent uniform draws."""

    method: Method
    size: int
    seed: int
    ranges: tuple[Range, ...]
    fixed: tuple[tuple[str, float], ...] = field(default=())

    def __len__(self) -> int:
        return self.size

    def at(self, index: int) -> OperatingPoint:
        """The point of that number, from 0."""
        return point({name: values.item() for name, values in self.columns(np.array([index])).items()})

    def columns(self, places: np.ndarray) -> dict[str, np.ndarray]:
        """Of the points of these numbers every parameter by its name, shape (points,)."""
        drawn = {one.name: values for one, values in zip(self.ranges, _filled(self)[places].T, strict=True)}
        return {name: np.full(len(places), value) for name, value in self.fixed} | drawn

    def slowest(self) -> float:
        """The lowest spindle speed of all points, rad/s."""
        names = [one.name for one in self.ranges]
        return float(_filled(self)[:, names.index(SPEED)].min()) if SPEED in names else dict(self.fixed)[SPEED]


@lru_cache(maxsize=4)
def _filled(design: Sampled) -> np.ndarray:
    """All points of a design, shape (count, ranges), in the ranges' own units."""
    from scipy.stats import qmc

    rng = np.random.default_rng(np.random.SeedSequence(design.seed, spawn_key=(2**32 - 1,)))  # apart from every run's
    width = len(design.ranges)
    if design.method == "random":
        shares = rng.random((design.size, width))
    elif design.method == "latin_hypercube":
        shares = qmc.LatinHypercube(width, rng=rng).random(design.size)
    else:
        whole = 1 << max(0, design.size - 1).bit_length()  # a Sobol sequence is balanced in powers of two
        shares = qmc.Sobol(width, rng=rng).random(whole)[: design.size]
    return np.column_stack([one.value(share) for one, share in zip(design.ranges, shares.T, strict=True)])
