"""What else the scale of a law with kinks may be: the cost along it, with everything else fitted at every place.

Where friction breaks away, every value a little off turns the phase with which a stuck motion goes on vibrating, which makes
the valley round any value narrow; and yet another value, with another frequency and force, may explain the records as well.
Slopes at the bottom of one valley know nothing of the others. So the scale is held at places further and further away, on
both sides, as long as the rest can make up for it: an interval from a likelihood ratio instead of one from slopes.

Source: D. M. Bates and D. G. Watts (1988), Nonlinear Regression Analysis and Its Applications, Wiley, chapter 6 (profiles).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import Descent, Jacobian, WaveformFit
from testbed.analysis.fit.moves.basin_hopping import scales
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect

NEAR = 0.003  # of the logarithm of the scale: to the first place on each side, within a valley or in the one beside it;
GROWTH = 2.0  # times as far to every next place,
FURTHEST = 9  # places on each side: up to a factor of 4.6
ITERATIONS = 6  # of the fit at a place, which starts where that of its neighbour ended,
TOLERANCE = 1e-4  # and share of the cost below which a step of it is the last: what two engines differ by is five times as much
ALIKE = 4.0  # cost above the least, for residuals of variance 1, that counts as alike: 1.92 is 95 %, and places are not bottoms
SAME = 5e-4  # share of the cost that does: two engines at the same parameters differ by as much where friction sticks and slips
BESIDE = 1.1  # times that for a place looked for at the edge of what is alike
FAR = 6.0  # times that from which a walk has left every valley that could matter
ROUNDS = 3  # times a deeper valley is followed


def along_scales(fitter: Fitter, effects: Sequence[Effect], fit: WaveformFit) -> WaveformFit:
    """The fit in the deepest valley along the scales of laws with kinks; `alike` holds the states that explain as much."""
    for path, bounds in kinked_scales(effects):
        fit = _along(fitter, path, bounds, fit)
    return fit


def kinked_scales(effects: Sequence[Effect]) -> list[tuple[str, tuple[float, float]]]:
    """(path, bounds) of every scale of those laws that have a kink."""
    return list(scales([effect for effect in effects if not effect.smooth]))


def _along(fitter: Fitter, path: str, bounds: tuple[float, float], fit: WaveformFit) -> WaveformFit:
    held = fitter.without(path)
    for _ in range(ROUNDS):
        walks = [list(_walk(held, path, side * NEAR, bounds, fit)) for side in (1.0, -1.0)]
        best = min((one for walk in walks for one in walk), key=lambda one: one.cost, default=None)
        if best is None or not best.cost < fit.cost - margin(fit):
            break
        fit = replace(fitter.fit(best.state, iterations=3 * ITERATIONS), alike=fit.alike)
    places = [one for walk in walks for one in walk if one.cost <= fit.cost + margin(fit)]
    places += [one for walk in walks for one in _edge(held, path, walk, fit)]
    return replace(fit, alike=(*fit.alike, *(one.state for one in places)))


def _edge(held: Fitter, path: str, walk: Sequence[Descent], fit: WaveformFit) -> Iterator[Descent]:
    """Where a walk left what is alike for good: between two places, where the cost has risen by the margin, as a parabola."""
    inside = max((place for place, one in enumerate(walk) if one.cost <= fit.cost + margin(fit)), default=-1)
    if inside + 1 >= len(walk):
        return
    last: Descent = walk[inside] if inside >= 0 else fit
    begin, end = (max(one.cost - fit.cost, 0.0) ** 0.5 for one in (last, walk[inside + 1]))
    way = math.log(walk[inside + 1].state.model.value(path) / last.state.model.value(path))
    value = last.state.model.value(path) * math.exp(way * (margin(fit) ** 0.5 - begin) / (end - begin))
    found = held.descend(last.state.with_value(path, value), iterations=ITERATIONS, tolerance=TOLERANCE)
    if found.cost <= fit.cost + BESIDE * margin(fit):
        yield found


def _walk(held: Fitter, path: str, step: float, bounds: tuple[float, float], fit: WaveformFit) -> Iterator[Descent]:
    """Descents with the scale held ever further away, each from the last, until one explains far less, or two in a row less."""
    found: Descent = replace(fit, parts=_without(fit, path))
    worse = 0
    for place in range(FURTHEST):
        value = math.exp(step * GROWTH**place) * found.state.model.value(path)
        if not bounds[0] <= value <= bounds[1] or worse == 2:
            return
        moved = found.state.with_value(path, value)
        found = held.descend(moved, iterations=ITERATIONS, tolerance=TOLERANCE, near=found)
        yield replace(found, parts=())  # they fill much memory, and serve the next place alone
        over = (found.cost - fit.cost) / margin(fit)
        worse = 2 if over > FAR else worse + 1 if over > 2.0 else 0


def _without(fit: WaveformFit, path: str) -> tuple[Jacobian, ...]:
    """The slopes of a fit, but for those by one unknown."""
    place = fit.names.index(path)
    return tuple(replace(part, shared=np.delete(part.shared, place, axis=1)) for part in fit.parts)


def margin(fit: WaveformFit) -> float:
    """Cost above that of a fit up to which another state explains the records as well."""
    return max(ALIKE * max(1.0, fit.variance), SAME * fit.cost)
