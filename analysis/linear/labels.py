"""Labels of points in a picture: each at the side of its point where it hides least, with a halo of the ground's colour."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AWAY = ((1, 1), (1, -1), (-1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1))  # sides of a point, the first as good as any
GAP = 6.0  # points from a mark's middle to its label
HALO = 3.0  # points


def label(axes: Axes, names: Sequence[str], places: np.ndarray, lines: np.ndarray) -> None:
    """Write names beside the points at `places` (n, 2), clear of each other, of all points and, if it can be, of `lines`
    (m, 2), points along the lines drawn (data units all). Call it when all else is drawn. A name without room is left out.
    """
    from matplotlib.patheffects import withStroke

    figure: Any = axes.figure
    figure.draw_without_rendering()  # settles where the axes are
    scale = figure.dpi / 72.0
    marks, drawn = (axes.transData.transform(np.reshape(some, (-1, 2))) for some in (places, lines))
    inside, taken = axes.get_window_extent(), [np.concatenate([mark - GAP * scale, mark + GAP * scale]) for mark in marks]
    frame = np.array([inside.x0, inside.y0, inside.x1, inside.y1])
    for name, place, mark in zip(names, places, marks, strict=True):
        if not name:
            continue
        text = axes.annotate(name, place, textcoords="offset points", xytext=(0, 0), zorder=6, parse_math=False,
                             path_effects=[withStroke(linewidth=HALO, foreground="white")])
        size = np.array(text.get_window_extent().size)
        boxes = [_box(mark, np.array(side), size, GAP * scale) for side in AWAY]
        costs = [_cost(box, taken, drawn, frame) for box in boxes]
        best = int(np.argmin(costs))
        if not np.isfinite(costs[best]):
            text.remove()
        else:
            text.set_position(tuple((boxes[best][:2] - mark) / scale))
            taken.append(boxes[best])


def _box(mark: np.ndarray, side: np.ndarray, size: np.ndarray, gap: float) -> np.ndarray:
    """(left, low, right, high) of a label at one side of a mark, pixels."""
    low = mark + np.where(side > 0, gap, np.where(side < 0, -gap - size, -0.5 * size))
    return np.concatenate([low, low + size])


def _cost(box: np.ndarray, taken: Sequence[np.ndarray], drawn: np.ndarray, frame: np.ndarray) -> float:
    """How many points of lines a label hides; infinite where it would lie on a mark or a label, or leave the axes."""
    if np.any(box[:2] < frame[:2]) or np.any(box[2:] > frame[2:]):
        return np.inf
    if any(np.all(box[:2] < other[2:]) and np.all(other[:2] < box[2:]) for other in taken):
        return np.inf
    return float(np.count_nonzero(np.all((drawn > box[:2]) & (drawn < box[2:]), axis=1)))
