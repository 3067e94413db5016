"""The borders of a stability chart, finer than its cells.

A lobe of period doubling may be narrower than a cell, and so may the stable gap beside it: on the chart's own cells such a
border is a staircase with islands. For a picture the cells along borders are divided and their inner points computed; away
from the borders, where the modulus is smooth, it is interpolated.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from testbed.analysis.linear.stability import StabilityChart

FINE_SPEEDS, FINE_DEPTHS = 1600, 400  # points of a picture, which no eye asks to be more
MOST_PARTS = 16  # into which a cell is divided along either axis
ROUNDS = 12  # in which a border is followed into cells whose corners do not show it

Fill = Callable[[np.ndarray, np.ndarray], StabilityChart]


def refined(chart: StabilityChart, fill: Fill, most: int = MOST_PARTS) -> StabilityChart:
    """The chart at more speeds and depths. fill: the chart at any speeds (rad/s) and depths (m), as the cells were computed.
    most: parts of a cell along either axis.

    Points that are interpolated have the direction in the complex plane of a cell beside them.
    """
    depths, speeds = chart.axial_depths, chart.spindle_speeds
    down, across = _parts(depths.size, FINE_DEPTHS, most), _parts(speeds.size, FINE_SPEEDS, most)
    if min(depths.size, speeds.size) < 2 or max(down, across) < 2:
        return chart
    rows, columns = (np.arange((size - 1) * parts + 1) / parts for size, parts in ((depths.size, down), (speeds.size, across)))
    fine_depths, fine_speeds = (np.interp(place, np.arange(axis.size), axis)
                                for place, axis in ((rows, depths), (columns, speeds)))
    fine = StabilityChart(fine_speeds, fine_depths, *_interpolated(chart, rows, columns))
    done = np.zeros((depths.size - 1, speeds.size - 1), dtype=bool)
    for _ in range(ROUNDS):
        wanted = _mixed(fine.classes, down, across) & ~done
        if not wanted.any():
            break
        _compute(fine, fill, wanted, down, across)
        done |= wanted
    return fine


def _parts(size: int, wanted: int, most: int) -> int:
    return min(max(-(-wanted // size), 1), most)


def _interpolated(chart: StabilityChart, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(largest, classes) at fractional cells: the modulus bilinear, class and direction of the nearest cell."""
    radius = chart.spectral_radius
    across = np.array([np.interp(columns, np.arange(radius.shape[1]), row) for row in radius])
    modulus = np.array([np.interp(rows, np.arange(radius.shape[0]), column) for column in across.T]).T
    near = np.ix_(np.rint(rows).astype(int), np.rint(columns).astype(int))
    return modulus * np.exp(1j * np.angle(chart.largest[near])), chart.classes[near].copy()


def _mixed(classes: np.ndarray, down: int, across: int) -> np.ndarray:
    """Cells (B - 1, S - 1) of which the points, borders included, are of more than one class and none is blank."""
    height, width = classes.shape
    corners = [classes[row:height - down + row:down, column:width - across + column:across]
               for row in range(down + 1) for column in range(across + 1)]
    least = np.minimum.reduce(corners)
    return (least != np.maximum.reduce(corners)) & (least >= 0)


def _compute(fine: StabilityChart, fill: Fill, cells: np.ndarray, down: int, across: int) -> None:
    """Fill the points of some cells in place, a row of cells at a time."""
    for row in np.flatnonzero(cells.any(axis=1)):
        some = np.unique(np.flatnonzero(cells[row])[:, None] * across + np.arange(across + 1))
        band = np.arange(row * down, (row + 1) * down + 1)
        found = fill(fine.spindle_speeds[some], fine.axial_depths[band])
        place = np.ix_(band, some)
        fine.largest[place], fine.classes[place] = found.largest, found.classes
