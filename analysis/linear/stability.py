"""Stability of a cut: the class of its largest multiplier, and charts over spindle speed and depth of cut.

|mu| < 1 is stable. Crossing the unit circle as a complex pair is a Neimark-Sacker bifurcation (chatter), at -1 a flip
(period doubling), at +1 a saddle node. A chart builds every map by spectral elements in compiled code, at two orders; where
their largest multipliers differ the order is raised, and a cell that does not settle stays blank.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from testbed.analysis.linear.cells import largest_multipliers
from testbed.machine import Model

LimitLies = Literal["within", "below", "above"]
StabilityClass = Literal["stable", "neimark_sacker", "flip", "saddle_node"]
CLASSES: tuple[StabilityClass, ...] = ("stable", "neimark_sacker", "flip", "saddle_node")
_SAID = {"neimark_sacker": "Neimark-Sacker", "saddle_node": "saddle-node"}
FEED_ONLY = "the machine is taken to be flexible along the feed only: what moves across it is not in the chart"
ALONG_FEED = 1e-9  # of a unit vector: a mode that moves less across the feed moves along it
_STEPS, _CLOSE = 60, 1e-7  # towards a stability limit, and the share of it that ends them


def feed_note(model: Model) -> str:
    """FEED_ONLY where the machine has motion along the feed alone; else nothing."""
    return FEED_ONLY if all(abs(mode.shape[1]) < ALONG_FEED for mode in model.structure.modes) else ""


def said_class(name: str) -> str:
    """A class, or another outcome of a cut, as it is written for people."""
    return _SAID.get(name, name.replace("_", " "))


def classify(multipliers: np.ndarray) -> StabilityClass:
    """The class named by the multiplier of largest modulus; `multipliers` in any order. ValueError if there is none."""
    values = np.asarray(multipliers, dtype=complex).ravel()
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise ValueError("multipliers must be finite, at least one")
    largest = values[np.argmax(np.abs(values))]
    if abs(largest) < 1.0:
        return "stable"
    if abs(largest.imag) > 1e-9 * abs(largest):
        return "neimark_sacker"
    return "flip" if largest.real < 0.0 else "saddle_node"


@dataclass(frozen=True)
class StabilityChart:
    """Largest multipliers over a grid.

    spindle_speeds (S,) rad/s, axial_depths (B,) m; largest (B, S) complex: the multiplier of largest modulus, of a
    pair the upper; classes (B, S): indices into CLASSES, -1 where a cell is blank; error (B, S): estimate of the error of the
    modulus, by the change from another order, of a blank cell too; NaN where nothing is known.
    """

    spindle_speeds: np.ndarray
    axial_depths: np.ndarray
    largest: np.ndarray
    classes: np.ndarray
    error: np.ndarray | None = None

    @property
    def spectral_radius(self) -> np.ndarray:
        """|mu| of the largest multiplier, (B, S)."""
        return np.abs(self.largest)

    def stability_limit(self) -> np.ndarray:
        """Depth (m) at which |mu| first reaches 1 at each speed, (S,), between two cells; NaN where the chart holds none."""
        radius, depths = self.spectral_radius, self.axial_depths
        limit = np.full(self.spindle_speeds.size, np.nan)
        for column, lies in enumerate(self.limit_lies()):
            if lies == "within":
                k = int(np.argmax(radius[:, column] >= 1.0))
                limit[column] = np.interp(1.0, radius[k - 1:k + 1, column], depths[k - 1:k + 1])
        return limit

    def limit_lies(self) -> list[LimitLies | None]:
        """Where the limit lies at each speed: within the chart's depths, below or above them; None where cells are blank."""
        found: list[LimitLies | None] = []
        for radius in self.spectral_radius.T:
            unstable = np.flatnonzero(radius >= 1.0)
            below = radius[unstable[0] - 1] if unstable.size else radius[-1]  # of the cell under the limit
            if unstable.size and unstable[0] == 0:
                found.append("below")
            else:
                found.append(None if np.isnan(below) else "within" if unstable.size else "above")
        return found


def classes_of(largest: np.ndarray) -> np.ndarray:
    """Indices into CLASSES by largest multipliers, of a pair the upper; -1 where there is none."""
    modulus = np.abs(largest)
    unstable = np.where(largest.imag > 1e-9 * modulus, 1, np.where(largest.real < 0.0, 2, 3))
    return np.where(np.isnan(modulus), -1, np.where(modulus < 1.0, 0, unstable)).astype(np.int8)


def stability_chart(model: Model, spindle_speeds: np.ndarray, axial_depths: np.ndarray, *,
                    added_damping: np.ndarray | None = None, full_eigenvalues: bool = False) -> StabilityChart:
    """Largest multipliers of `model` over spindle speeds (S,) rad/s and axial depths of cut (B,) m.

    added_damping: further damping over the modal mass (1/s) in the cut, broadcastable to (B, S). full_eigenvalues: no short
    cut in any cell.
    """
    speeds, depths = np.atleast_1d(np.asarray(spindle_speeds, float)), np.atleast_1d(np.asarray(axial_depths, float))
    shape = depths.size, speeds.size
    added = np.broadcast_to(0.0 if added_damping is None else np.asarray(added_damping, float), shape)
    largest, error = largest_multipliers(model, np.tile(speeds, depths.size), np.repeat(depths, speeds.size), added.ravel(),
                                         full_eigenvalues=full_eigenvalues)
    largest = largest.reshape(shape)
    return StabilityChart(speeds, depths, largest, classes_of(largest), error.reshape(shape))


def sharpened_limit(chart: StabilityChart, model: Model) -> np.ndarray:
    """The chart's stability limit (m), (S,), computed between the two cells that hold it and not interpolated."""
    limit = chart.stability_limit()
    columns = np.flatnonzero(np.isfinite(limit))
    if not columns.size:
        return limit
    excess, depths = chart.spectral_radius[:, columns] - 1.0, chart.axial_depths
    first = np.argmax(excess >= 0.0, axis=0)
    low, high = depths[first - 1], depths[first]
    under, over = excess[first - 1, np.arange(columns.size)], excess[first, np.arange(columns.size)]
    speeds, place = chart.spindle_speeds[columns], limit[columns]
    for step in range(_STEPS):
        open_ = np.flatnonzero(high - low > _CLOSE * high)
        if not open_.size:
            break
        found = np.abs(largest_multipliers(model, speeds[open_], place[open_])[0]) - 1.0
        stable = found < 0.0  # a blank cell counts as unstable
        low[open_[stable]], under[open_[stable]] = place[open_[stable]], found[stable]
        high[open_[~stable]], over[open_[~stable]] = place[open_[~stable]], np.nan_to_num(found[~stable], nan=1.0)
        share = np.clip(under / (under - over), 0.0, 1.0)
        # by turns a secant's step with a little beyond it, so that the limit lies in a narrow bracket, and the middle
        beyond = np.where(step % 2, _CLOSE, -_CLOSE) * 0.4
        place = np.where(step % 3 == 2, 0.5 * (low + high), low + (high - low) * share) * (1.0 + beyond)
        place = np.clip(place, low, high)
    limit[columns] = np.where(high - low > _CLOSE * high, place, 0.5 * (low + high))
    return limit
