"""Machines drawn from what is known of one: values with a covariance, within their bounds.

A value with a standard deviation is a normal distribution cut off where no machine is: it keeps the value and the deviation
that were stated, and of a positive quantity given to a third of itself it loses one draw in a thousand. A lognormal one would
move either. What lies outside of any bound is drawn anew, with all else of that machine, so that correlations stay.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbed.effect import Effect
from testbed.machine import BASE_UNITS, Model

OPEN = (-math.inf, math.inf)
_BOUNDS = {"mass": (0.0, math.inf), "stiffness": (0.0, math.inf), "natural_frequency": (0.0, math.inf),
           "damping_ratio": (0.0, 1.0), "tangential_coefficient": (0.0, math.inf), "immersion": (0.0, 0.5)}
ROUNDS = 200  # times as many draws as are wanted, of which so many must lie within the bounds
LEAST_SHARE = 1e-6  # of the largest variance of the scaled values: an axis below is rounding


class NoDraws(ValueError):
    """Hardly any draw lies within the bounds: the values are not known well enough to draw from."""


@dataclass(frozen=True)
class Known:
    """What is known of a machine: `model` in the middle; of the parameters `paths` (n) the covariance (n, n), SI, and bounds.

    A mode that is known by its stiffness has `stiffness` among the paths; its mass follows from that and the frequency.
    """

    model: Model
    paths: tuple[str, ...]
    covariance: np.ndarray
    bounds: tuple[tuple[float, float], ...]

    @property
    def middle(self) -> np.ndarray:
        """The values of the parameters, (n,)."""
        return np.array([value_of(self.model, path) for path in self.paths])

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviations, (n,)."""
        return np.sqrt(np.diag(self.covariance))

    def axes(self) -> np.ndarray:
        """Independent steps of one standard deviation each, (k, n): the principal axes of the values over their deviations."""
        size = self.deviations
        values, vectors = np.linalg.eigh(self.covariance / np.outer(size, size))
        kept = values > LEAST_SHARE * values[-1]
        return (np.sqrt(values[kept]) * vectors[:, kept]).T * size

    def possible(self, values: np.ndarray) -> np.ndarray:
        """Which of some machines (m, n) lie within all bounds, (m,)."""
        low, high = np.array(self.bounds).T
        return np.all((values > low) & (values < high), axis=1)

    def at(self, values: np.ndarray) -> Model:
        """The machine with these values (n,) of the parameters."""
        return _with(self.model, dict(zip(self.paths, values.tolist(), strict=True)))

    def without_effects(self) -> Known:
        """The same of the machine without its effects."""
        model = self.model
        for name in model.effects:
            model = model.without_effect(name)
        kept = [place for place, path in enumerate(self.paths) if path.partition(".")[0] not in self.model.effects]
        return Known(model, tuple(self.paths[place] for place in kept), self.covariance[np.ix_(kept, kept)],
                     tuple(self.bounds[place] for place in kept))

    def drawn(self, count: int, seed: int) -> np.ndarray:
        """Values (count, n) of machines drawn; the same for the same seed. NoDraws where hardly any lies within the bounds."""
        random, axes, found = np.random.default_rng(seed), self.axes(), np.empty((0, len(self.paths)))
        for _ in range(ROUNDS):
            some = self.middle + random.standard_normal((count, len(axes))) @ axes
            found = np.vstack([found, some[self.possible(some)]])
            if len(found) >= count:
                return found[:count]
        raise NoDraws(f"hardly any of the machines drawn lies within the bounds of {', '.join(self.paths)}")


def of_spreads(model: Model, catalogue: Mapping[str, Effect]) -> Known | None:
    """What a model file says of its own values, each independent of the others; None where it gives no deviation."""
    if not model.spreads:
        return None
    paths, sizes = zip(*model.spreads, strict=True)
    return Known(model, paths, np.diag(np.square(sizes)), tuple(bounds_of(path, catalogue) for path in paths))


def value_of(model: Model, path: str) -> float:
    """A parameter's value by its path, a stiffness and the direction of a single mode along the feed among them. KeyError."""
    before, name = path[: path.rfind(".") + 1], path.rpartition(".")[2]
    if name not in ("stiffness", "direction") or before and not before.startswith("modes["):
        return model.value(path)
    return float(getattr(model.structure.modes[int(before[6:-2]) if before else 0], name))


def unit_of(path: str, catalogue: Mapping[str, Effect]) -> str:
    """SI unit of a parameter by its path."""
    effect, _, parameter = path.rpartition(".")
    if effect in catalogue:
        return catalogue[effect].parameter(parameter).unit
    return {**BASE_UNITS, "stiffness": "N/m"}[parameter]


def bounds_of(path: str, catalogue: Mapping[str, Effect]) -> tuple[float, float]:
    """Where a parameter of a machine may lie, by its path; the ends are outside."""
    effect, _, parameter = path.rpartition(".")
    if effect in catalogue:
        low, high = catalogue[effect].parameter(parameter).bounds
        return math.nextafter(low, -math.inf), math.nextafter(high, math.inf)
    return _BOUNDS.get(parameter, OPEN)


def _with(model: Model, values: dict[str, float]) -> Model:
    """The model with values, a stiffness turned into the mass that it and the frequency make."""
    for path in [one for one in values if one.endswith("stiffness") and one.partition(".")[0] not in model.effects]:
        before = path.removesuffix("stiffness")
        frequency = values.get(f"{before}natural_frequency", model.value(f"{before}natural_frequency"))
        values[f"{before}mass"] = values.pop(path) / (2.0 * math.pi * frequency) ** 2
    if "direction" in values:  # of a single mode along the feed, which is turned out of it
        model = replace(model, structure=replace(model.structure, direction=values.pop("direction")))
        values = {f"modes[0].{path}" if path in ("mass", "natural_frequency", "damping_ratio") else path: value
                  for path, value in values.items()}
    return model.with_values(values)
