"""The chance that a cut is stable, at every speed and depth: the share of the machines that may be ours in which it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from testbed.analysis.linear.stability import LimitLies, StabilityChart, classes_of
from testbed.analysis.probable.draws import Known
from testbed.machine import Model

QUANTILES = (0.05, 0.5, 0.95)
KNOWN = 0.9  # of the machines drawn that must have multipliers in a cell, for a chance to be given there
NODE = math.sqrt(3.0)  # standard deviations along an axis at which a surface is held: a cubic through them keeps the variance
NEAR = 0.1  # standard deviations to a bound, below which the surface is held on the other side alone
_SMALL = 1e-12  # modulus that stands for none

Fill = Callable[[Model, np.ndarray, np.ndarray], StabilityChart]
Show = Callable[[int, int], None]


@dataclass(frozen=True)
class Recommended:
    """A cut: spindle_speed (rad/s), axial_depth_of_cut (m), and the chance that it is stable."""

    spindle_speed: float
    axial_depth_of_cut: float
    stable_probability: float


@dataclass(frozen=True)
class Chance:
    """Chances over a grid of speeds (S,) rad/s and depths (B,) m.

    probability (B, S): share of the machines with multipliers there in which the cut is stable; NaN where fewer than KNOWN
    have them. unknown (B, S): share without. limits (3, S): depth (m) of the limit of stability that so many of the machines
    (QUANTILES) do not reach; NaN where it lies outside of the depths, which `lies` tells. draws: number of machines.
    """

    spindle_speeds: np.ndarray
    axial_depths: np.ndarray
    probability: np.ndarray
    unknown: np.ndarray
    limits: np.ndarray
    lies: tuple[tuple[LimitLies | None, ...], ...]
    draws: int

    def recommended(self, risk: float) -> Recommended | None:
        """The cut of the largest speed times depth (with flutes, feed and radial depth as they are: removal rate) that is
        unstable with a probability of at most `risk`; None where there is none.

        """
        enough = safe(self.probability, self.draws, risk)
        rate = np.where(enough, self.axial_depths[:, None] * self.spindle_speeds, 0.0)
        if not rate.max(initial=0.0) > 0.0:
            return None
        row, column = np.unravel_index(int(np.argmax(rate)), rate.shape)
        return Recommended(float(self.spindle_speeds[column]), float(self.axial_depths[row]),
                           float(self.probability[row, column]))


def safe(probability: np.ndarray, draws: int, risk: float) -> np.ndarray:
    """Where a cut is unstable with a probability of at most `risk`; not where its chance is NaN.

    Of n machines the chance that one more is stable is taken as stable ones / (n + 1), so that few draws promise little.
    """
    return np.nan_to_num(probability) * draws / (draws + 1.0) >= 1.0 - risk


def chance_of(charts: Iterable[StabilityChart]) -> Chance:
    """The chances that the charts of machines drawn, all on one grid, make. ValueError without a chart."""
    stable = known = np.zeros(0)
    limits: list[np.ndarray] = []
    for chart in charts:
        stable = (np.zeros(chart.classes.shape) if not limits else stable) + (chart.classes == 0)
        known = (np.zeros(chart.classes.shape) if not limits else known) + (chart.classes >= 0)
        ends = np.array([{"below": 0.0, "above": math.inf}.get(one or "", math.nan) for one in chart.limit_lies()])
        limits.append(np.where(np.isnan(ends), chart.stability_limit(), ends))
    if not limits:
        raise ValueError("no chart to take a chance from")
    count = len(limits)
    probability = np.where(known >= KNOWN * count, stable / np.maximum(known, 1.0), math.nan)
    at = _quantiles(np.array(limits))
    said = tuple(tuple(_lies(value) for value in row) for row in at.tolist())
    at = np.where(np.isfinite(at) & (at > 0.0), at, math.nan)
    return Chance(chart.spindle_speeds, chart.axial_depths, probability, 1.0 - known / count, at, said, count)


def _quantiles(limits: np.ndarray) -> np.ndarray:
    """QUANTILES (3, S) of limits (draws, S), in which 0 is below and infinity above all depths; NaN where too few are known.

    Each is one of the values, so that the infinite need no arithmetic.
    """
    found = np.full((len(QUANTILES), limits.shape[1]), math.nan)
    for column, values in enumerate(limits.T):
        values = np.sort(values[~np.isnan(values)])
        if len(values) >= KNOWN * len(limits):
            found[:, column] = [values[min(max(math.ceil(share * len(values)) - 1, 0), len(values) - 1)] for share in QUANTILES]
    return found


def _lies(limit: float) -> LimitLies | None:
    return None if math.isnan(limit) else "above" if math.isinf(limit) else "below" if limit == 0.0 else "within"


def each_drawn(fill: Fill, known: Known, speeds: np.ndarray, depths: np.ndarray, draws: int, seed: int,
               show: Show = lambda done, total: None) -> Iterator[StabilityChart]:  # fmt: skip
    """The chart of every machine drawn."""
    for number, values in enumerate(known.drawn(draws, seed)):
        yield fill(known.at(values), speeds, depths)
        show(number + 1, draws)


def charts_on_surface(known: Known) -> int:
    """How many charts a surface takes."""
    return 1 + sum(len(_nodes(known, axis)) for axis in known.axes())


def by_surface(fill: Fill, known: Known, speeds: np.ndarray, depths: np.ndarray, draws: int, seed: int,
               show: Show = lambda done, total: None) -> Iterator[StabilityChart]:  # fmt: skip
    """The same for machines of which a chart costs much: the logarithm of the modulus is computed along the principal axes of
    what is known, and of a machine drawn is the sum of a parabola along each.

    Where another multiplier takes over within the spread, or two parameters act only together, that is an approximation. A cell
    without multipliers at one of the nodes has none at all.
    """
    axes, done = known.axes(), 0
    total = charts_on_surface(known)

    def height(model: Model) -> np.ndarray:
        nonlocal done
        found = np.log(np.maximum(fill(model, speeds, depths).spectral_radius, _SMALL))
        show(done := done + 1, total)
        return found

    middle = height(known.model)
    fitted = []
    for axis in axes:
        nodes = _nodes(known, axis)
        rises = np.array([height(known.at(known.middle + node * axis)) - middle for node in nodes])
        powers = np.array(nodes)[:, None] ** np.arange(1, len(nodes) + 1)
        fitted.append(np.linalg.solve(powers, rises.reshape(len(nodes), -1)).reshape(rises.shape))
    amounts = np.linalg.lstsq(axes.T, (known.drawn(draws, seed) - known.middle).T, rcond=None)[0].T
    for row in amounts:
        log = middle + sum(coefficient * amount ** (power + 1) for amount, part in zip(row, fitted, strict=True)
                           for power, coefficient in enumerate(part))
        largest = np.exp(log) + 0j
        yield StabilityChart(speeds, depths, largest, classes_of(largest))


def _nodes(known: Known, axis: np.ndarray) -> list[float]:
    """Places (standard deviations) along an axis at which a machine can be: one on either side, nearer where a bound is."""
    found = []
    for side in (-NODE, NODE):
        reach = next((side * share for share in (1.0, 0.5, 0.25, 0.1)
                      if known.possible((known.middle + side * share * axis)[None])[0]), 0.0)
        if abs(reach) > NEAR:
            found.append(reach)
    if not found:
        raise ValueError(f"no machine lies beside the middle in {', '.join(known.paths)}")
    return found
