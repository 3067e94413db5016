"""Operating points that crowd about the border of stability: cells of a grid are halved where it runs through them."""

from __future__ import annotations

from collections.abc import Callable

from testbed.cut import Cut
from testbed.machine import Model
from testbed.scenario.design import OperatingPoint

PASSES = 160        # of a trial cut; the growth is that of its last third against the third before
BORDER = 0.995      # growth over a third, to which a steady cycle (a saturated chatter) comes close
_AT_REST = 1e-9     # m; a motion from pass to pass below it has died out


def refined(speeds: tuple[float, ...], depths: tuple[float, ...], levels: int,
            stable: Callable[[list[tuple[float, float]]], list[bool]]) -> tuple[OperatingPoint, ...]:
    """The grid's points, and `levels` times the points that halve each cell whose corners do not agree.

    stable: tells for many (spindle speed, depth of cut) at once which cut is stable. Points are in order of speed, then
    depth; none is there twice.
    """
    fine = 2**levels
    columns, rows = _divided(speeds, fine), _divided(depths, fine)
    known: dict[tuple[int, int], bool] = {}

    def ask(places: set[tuple[int, int]]) -> None:
        new = sorted(places - known.keys())
        known.update(zip(new, stable([(columns[i], rows[j]) for i, j in new]), strict=True))

    cells = [(i, j) for i in range(0, len(columns) - 1, fine) for j in range(0, len(rows) - 1, fine)]
    ask({(i, j) for i in range(0, len(columns), fine) for j in range(0, len(rows), fine)})
    for level in range(levels):
        size = fine >> level
        half = size // 2
        mixed = [(i, j) for i, j in cells if len({known[i + a, j + b] for a in (0, size) for b in (0, size)}) == 2]
        # The neighbours too: a border may bulge into a cell between its corners.
        near = {(i + a, j + b) for i, j in mixed for a in (-size, 0, size) for b in (-size, 0, size)} & set(cells)
        ask({(i + a, j + b) for i, j in near for a in (0, half, size) for b in (0, half, size)})
        cells = [(i + a, j + b) for i, j in sorted(near) for a in (0, half) for b in (0, half)]
    return tuple(OperatingPoint(columns[i], rows[j]) for i, j in sorted(known))


def _divided(values: tuple[float, ...], parts: int) -> list[float]:
    """The values with `parts` - 1 equally spaced ones between each two."""
    found = [low + (high - low) * k / parts for low, high in zip(values, values[1:], strict=False) for k in range(parts)]
    return [*found, values[-1]]


def stable_cuts(model: Model, feed: float, catalogue: object = None) -> Callable[[list[tuple[float, float]]], list[bool]]:
    """A judge of operating points: a short trial cut in the fast engine, whose motion from pass to pass dies out or not."""
    import numpy as np

    from testbed.engines.fast import simulate_batch

    def judge(points: list[tuple[float, float]]) -> list[bool]:
        if not points:
            return []
        cuts = [Cut(speed, depth, feed, passes=PASSES) for speed, depth in points]
        result = simulate_batch([model] * len(cuts), cuts, None, catalogue=catalogue)  # type: ignore[arg-type]
        third = PASSES // 3
        steps = np.abs(np.diff(result.pass_states[:, :, 0], axis=1))
        late = np.sqrt((steps[:, -third:] ** 2).mean(axis=1))
        before = np.sqrt((steps[:, -2 * third:-third] ** 2).mean(axis=1))
        return [bool(outcome == 0 and (after < _AT_REST or after < BORDER * earlier))
                for outcome, after, earlier in zip(result.outcome, late, before, strict=True)]

    return judge
