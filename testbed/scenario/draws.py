"""What differs from run to run by chance: parameters drawn from stated distributions, effects present or not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

Kind = Literal["fixed", "uniform", "loguniform", "normal", "lognormal"]
KINDS: tuple[Kind, ...] = ("uniform", "loguniform", "normal", "lognormal")
_TRIES = 1000


@dataclass(frozen=True)
class Distribution:
    """A distribution within bounds, by two numbers `a` and `b`.

    uniform and loguniform: from a to b. normal: mean a, standard deviation b. lognormal: median a, standard deviation b
    of the natural logarithm. fixed: always a. A draw outside `low` to `high` is drawn again.
    """

    kind: Kind
    a: float
    b: float = 0.0
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        if not (math.isfinite(self.a) and math.isfinite(self.b)):
            raise ValueError("must be finite")
        if self.kind in ("uniform", "loguniform") and not self.a <= self.b:
            raise ValueError("must go from the lower to the higher value")
        if self.kind in ("loguniform", "lognormal") and not self.a > 0:
            raise ValueError("of logarithms must begin above 0")
        if self.kind in ("normal", "lognormal") and not self.b >= 0:
            raise ValueError("must have a deviation of at least 0")
        ends = (self.a, self.b) if self.kind in ("uniform", "loguniform") else (self.a,)
        if not all(self.low <= end <= self.high for end in ends):
            raise ValueError(f"must lie within {self.low:g} to {self.high:g}")

    def draw(self, rng: np.random.Generator) -> float:
        """One value. ArithmeticError where the bounds leave next to nothing of the distribution."""
        for _ in range(_TRIES):
            value = self._once(rng)
            if self.low <= value <= self.high:
                return value
        raise ArithmeticError("nearly every draw lies out of bounds")

    def _once(self, rng: np.random.Generator) -> float:
        if self.kind == "uniform":
            return float(rng.uniform(self.a, self.b))
        if self.kind == "loguniform":
            return float(math.exp(rng.uniform(math.log(self.a), math.log(self.b))))
        if self.kind == "normal":
            return float(rng.normal(self.a, self.b))
        if self.kind == "lognormal":
            return float(self.a * math.exp(self.b * rng.standard_normal()))
        return self.a


@dataclass(frozen=True)
class Chance:
    """Parameters drawn together. effect: its name, present in a share `present` of the runs, else neutral; "" for
    parameters of the machine. parameters: distribution by path; neutral: the effect's values where it is absent."""

    parameters: tuple[tuple[str, Distribution], ...]
    effect: str = ""
    present: float = 1.0
    neutral: tuple[tuple[str, float], ...] = ()

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Values by path. As many random numbers are taken whether the effect is present or not."""
        here = self.present >= 1.0 or float(rng.random()) < self.present
        drawn = {path: distribution.draw(rng) for path, distribution in self.parameters}
        return drawn if here else dict(self.neutral)
