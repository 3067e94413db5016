"""Which few terms of a library describe a missing force: best subsets on sums of products, judged on held-out conditions.

Terms are chosen by the residual that they leave on operating conditions held out of the regression, by BIC, and by
length: a longer formula must take away a clear share of what the shorter one leaves. The model's own parameters are
refitted with every subset, since the fit of an incomplete model has bent them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbed.analysis.fit.evidence import DELTA_BIC
from testbed.analysis.force.regression import Products
from testbed.analysis.information import Z_95, autocorrelation, independent
from testbed.trial.proposal import Coefficient

MOST_TERMS = 4
WORTH = 0.04  # share of the excess that one term more must take away
NEAR = 1e-3  # share of the excess within which the simpler of two formulas is taken
REACH = 0.035  # rad, how far from each of them the linear change by the angle is believed
RIDGE = 1e-11
BEAM = 12  # subsets that are extended by one term more
RIVALS = 4  # formulas beside the chosen one that are kept for a closer look,
RIVAL = 0.5  # where they explain this share of what it does: parameters bent by a strong law favour another one


@dataclass(frozen=True)
class Subset:
    """Terms tried together: their places, the held-out sum of squares, that over all, and which tooth angle suits them."""

    places: tuple[int, ...]
    held_out: float
    squares: float
    at: int


def _left(sums: np.ndarray, columns: Sequence[int], values: np.ndarray) -> float:
    """Sum of squares that coefficients leave."""
    square = sums[np.ix_(columns, columns)]
    return float(sums[-1, -1] - 2 * values @ sums[columns, -1] + values @ square @ values)


class Chooser:
    """Least squares on the sums of products, over all conditions and with each left out in turn, at several tooth angles."""

    def __init__(self, found: Sequence[Products]) -> None:
        self.found = tuple(found)
        self.terms = found[0].terms
        self.base = list(range(len(found[0].nuisances)))
        self.rows = int(found[0].rows.sum())
        totals = [one.sums.sum(axis=0) for one in found]
        self.stacks = [np.concatenate([total[None], total - one.sums]) for one, total in zip(found, totals, strict=True)]
        self.turning = found[0].nuisances.index("mark_angle") if "mark_angle" in found[0].nuisances else None

    def columns(self, places: Sequence[int]) -> list[int]:
        """Columns of the nuisances and of the terms at `places`."""
        return self.base + [len(self.base) + place for place in places]

    def solve(self, at: int, columns: Sequence[int]) -> np.ndarray:
        """Coefficients (1 + conditions, columns): over all conditions, then without each."""
        stack = self.stacks[at]
        square = stack[:, columns][:, :, columns] + RIDGE * np.eye(len(columns))
        return np.linalg.solve(square, stack[:, columns, -1][:, :, None])[:, :, 0]

    def subset(self, places: Sequence[int]) -> Subset:
        """A subset of terms with its sums of squares, at the tooth angle that suits it best."""
        columns = self.columns(places)
        best = Subset(tuple(places), math.inf, math.inf, 0)
        for at, found in enumerate(self.found):
            values = self.solve(at, columns)
            if len(self.found) > 1 and self.turning is not None:
                step = values[0, self.turning] / found.scale[self.turning]
                if places and abs(step) > REACH:
                    continue
            squares = _left(self.stacks[at][0], columns, values[0])
            held_out = squares
            if len(found.sums) > 1:
                held_out = sum(_left(one, columns, value) for one, value in zip(found.sums, values[1:], strict=True))
            if held_out < best.held_out:
                best = Subset(tuple(places), held_out, squares, at)
        return best

    def complexity(self, subset: Subset) -> float:
        """How much a reader of the formula has to take in."""
        return sum(self.terms[place].complexity for place in subset.places)

    def residual(self, subset: Subset) -> list[np.ndarray]:
        """Residuals of the records (values,), in units of the noise."""
        columns, found = self.columns(subset.places), self.found[subset.at]
        values = self.solve(subset.at, columns)[0] / found.scale[columns]
        return [block[:, -1] - block[:, columns] @ values for block in found.blocks]

    def whiteness(self, subset: Subset) -> float:
        """Independent values over values; records of a few values alone do not count."""
        found = sum(independent(autocorrelation(rest)) for rest in self.residual(subset) if len(rest) >= 16)
        return max(found, 10.0) / max(self.rows, 1)


def _best(chooser: Chooser, tried: Sequence[Subset], excess: float) -> Subset:
    """The simplest of the subsets that are all but as good as the best."""
    best = min(one.held_out for one in tried)
    near = [one for one in tried if one.held_out <= best + NEAR * excess]
    return min(near, key=lambda one: (round(chooser.complexity(one), 6), one.held_out))


@dataclass(frozen=True)
class Choice:
    """The chosen subset, those tried by size, and the excess of the model alone over what the fullest formula leaves."""

    chosen: Subset
    levels: tuple[tuple[Subset, ...], ...]
    excess: float

    def share(self, subset: Subset) -> float:
        """Share of the excess that a subset explains on held-out conditions."""
        return (self.levels[0][0].held_out - subset.held_out) / self.excess

    def against(self, base: Subset) -> Choice:
        """The same choice with the excess counted from another subset of no terms, found at other tooth angles."""
        floor = self.levels[0][0].held_out - self.excess
        return replace(self, levels=((base,), *self.levels[1:]), excess=max(base.held_out - floor, 1e-12))

    def alternatives(self) -> list[Subset]:
        """The best few subsets of one or two terms."""
        return sorted((one for level in self.levels[1:3] for one in level), key=_held_out)[:8]

    def rivals(self, chooser: Chooser) -> list[Subset]:
        """The next best subsets, no longer than the chosen one, that explain much as well and that an effect file can hold."""
        near = [one for level in self.levels[1 : 1 + len(self.chosen.places)] for one in level
                if one.places != self.chosen.places and self.share(one) > RIVAL * self.share(self.chosen)
                and all(chooser.terms[place].expression for place in one.places)]  # fmt: skip
        return sorted(near, key=_held_out)[:RIVALS]


def _held_out(subset: Subset) -> float:
    return subset.held_out


def choose(chooser: Chooser) -> Choice:
    """Which terms to believe, from ever larger subsets."""
    count = len(chooser.terms)
    levels = [[chooser.subset(())], [chooser.subset((place,)) for place in range(count)]]
    levels.append([chooser.subset(pair) for pair in itertools.combinations(range(count), 2)])
    while len(levels) <= MOST_TERMS:
        leaders = sorted(levels[-1], key=_held_out)[:BEAM]
        wider = {tuple(sorted((*one.places, place))) for one in leaders for place in range(count) if place not in one.places}
        levels.append([chooser.subset(places) for places in sorted(wider)])
    levels = [level for level in levels if level]
    floor = min(float(chooser.rows), min(one.held_out for level in levels for one in level))
    excess = max(levels[0][0].held_out - floor, 1e-12)
    chosen = levels[0][0]
    for level in levels[1:]:
        trial = _best(chooser, level, excess)
        if not math.isfinite(trial.held_out):  # no formula of this length keeps the tooth angle in reach
            continue
        size = max(10.0, chooser.rows * chooser.whiteness(trial))
        more = len(trial.places) - len(chosen.places)
        gain = size * math.log(max(chosen.squares, 1e-300) / max(trial.squares, 1e-300)) - more * math.log(size)
        worth = chosen.held_out - trial.held_out > more * WORTH * excess
        if gain > DELTA_BIC and worth:
            chosen = trial
    return Choice(chosen, tuple(map(tuple, levels)), excess)


def waveform(chooser: Chooser, chosen: Subset, excess: float) -> Subset:
    """The chosen subset, or a Fourier series in the tooth angle where that leaves clearly less."""
    names = [term.name for term in chooser.terms]
    best = chosen
    for side in ("t", "n"):
        series: list[int] = []
        for order in range(0, 7):
            wanted = [f"edge_{side}"] if order == 0 else [f"cos_{order}_{side}", f"sin_{order}_{side}"]
            if any(name not in names for name in wanted):
                break
            series += [names.index(name) for name in wanted]
            trial = chooser.subset(series)
            if best.held_out - trial.held_out > len(wanted) * WORTH * excess:
                best = trial
    return best


def coefficients(chooser: Chooser, subset: Subset) -> tuple[tuple[Coefficient, ...], dict[str, float]]:
    """(terms with values and intervals, changes of the model's own parameters) in SI."""
    columns, first = chooser.columns(subset.places), len(chooser.base)
    values = chooser.solve(subset.at, columns)[0]
    spread = np.linalg.pinv(chooser.stacks[subset.at][0][np.ix_(columns, columns)], hermitian=True)
    variance = max(1.0, subset.squares / max(chooser.rows, 1)) / min(1.0, chooser.whiteness(subset))
    scale = chooser.found[subset.at].scale[columns]
    half = Z_95 * np.sqrt(np.maximum(np.diag(spread), 0.0) * variance) / scale
    values = values / scale
    found = []
    for place, value, reach in zip(subset.places, values[first:], half[first:], strict=True):
        found.append(Coefficient(chooser.terms[place], float(value), float(value - reach), float(value + reach)))
    return tuple(found), dict(zip(chooser.found[0].nuisances, map(float, values[:first]), strict=True))
