"""Which variable, or pair of variables, a force goes with, whatever the shape of the law: binned means, cross-validated.

The force is averaged in bins of equal counts of the variables; the averages of all operating conditions but one predict
that one. The share of the force's variance so explained is low by what the force's own uncertainty adds.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

BINS, PAIR_BINS = 30, 14
SCARCE = 5  # samples of other conditions below which a bin says nothing
_NOT_VARIABLES = ("force", "deviation", "condition")


@dataclass(frozen=True)
class Ranked:
    """Variables, and the share of the force's variance that their binned means explain on held-out conditions."""

    variables: tuple[str, ...]
    share: float


def _bins(values: np.ndarray, count: int) -> np.ndarray:
    """Bin of each sample; bins of equal counts, fewer where values repeat."""
    edges = np.unique(np.quantile(values, np.linspace(0, 1, count + 1)[1:-1]))
    return np.searchsorted(edges, values, side="right")


def explained(force: np.ndarray, weight: np.ndarray, condition: np.ndarray, place: np.ndarray) -> float:
    """Share of the weighted variance of `force` that the means of the bins `place` explain, conditions held out in turn."""
    _, group = np.unique(condition, return_inverse=True)
    groups, cells = int(group.max()) + 1, int(place.max()) + 1
    if groups == 1:  # nothing to hold out but every second stretch
        group, groups = (np.arange(len(force)) * 8 // len(force)) % 2, 2
    shape = (groups, cells)
    index = group * cells + place
    sums, counts, number = (
        np.bincount(index, values, groups * cells).reshape(shape) for values in (weight * force, weight, np.ones(len(force)))
    )
    others = counts.sum(axis=0) - counts
    enough = number.sum(axis=0) - number >= SCARCE
    overall = (sums.sum() - sums.sum(axis=1)) / np.maximum(counts.sum() - counts.sum(axis=1), 1e-300)
    means = np.where(enough, (sums.sum(axis=0) - sums) / np.maximum(others, 1e-300), overall[:, None])
    left = float(np.sum(weight * (force - means[group, place]) ** 2))
    total = float(np.sum(weight * (force - overall[group]) ** 2))
    return 1.0 - left / total if total > 0 else 0.0


def rank(samples: Mapping[str, np.ndarray], count: int = 8) -> tuple[Ranked, ...]:
    """Single variables and pairs, best first. samples: force, deviation, condition and the variables, all (samples,)."""
    if not samples or len(samples["force"]) < 200:
        return ()
    force = samples["force"]
    weight = 1.0 / np.maximum(samples["deviation"], 1e-12) ** 2
    weight = weight / weight.max()
    names = [name for name in samples if name not in _NOT_VARIABLES and np.isfinite(samples[name]).all()
             and float(np.ptp(samples[name])) > 0.0]  # fmt: skip
    found = [Ranked((name,), explained(force, weight, samples["condition"], _bins(samples[name], BINS))) for name in names]
    coarse = {name: _bins(samples[name], PAIR_BINS) for name in names}
    for one, other in itertools.combinations(names, 2):
        place = coarse[one] * (int(coarse[other].max()) + 1) + coarse[other]
        found.append(Ranked((one, other), explained(force, weight, samples["condition"], place)))
    return tuple(sorted(found, key=lambda entry: -entry.share)[:count] + [
        entry for entry in sorted(found, key=lambda entry: -entry.share)[count:] if len(entry.variables) == 1
    ])  # fmt: skip
