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

from analysis.scale_hops import deeper, scales
from analysis.waveform import Fitter, WaveformFit
from testbed.effect import Effect

NEAR = 0.003  # of the logarithm of the scale, from place to place within a valley and to the one beside it,
STEP = 0.09  # and further away
FURTHEST = 10  # places on each side: 3 %, and a factor of 2.5
ITERATIONS = 6  # of the fit at a place, which starts where that of its neighbour ended
ALIKE = 4.0  # cost above the least, for residuals of variance 1, that counts as alike: 1.92 is 95 %, and places are not bottoms
SAME = 5e-4  # share of the cost that does: two engines at the same parameters differ by as much where friction sticks and slips
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
        walks = [list(_walk(held, path, math.exp(step), bounds, fit)) for step in (NEAR, -NEAR, STEP, -STEP)]
        best = min((one for walk in walks for one in walk), key=lambda one: one.cost, default=fit)
        if not deeper(best, fit):
            break
        fit = replace(fitter.fit(best.state, iterations=3 * ITERATIONS), alike=fit.alike)
    places = [one for walk in walks for one in walk if one.cost <= fit.cost + margin(fit)]
    places += [_edge(held, path, walk[0], fit) for walk in walks[:2] if walk and walk[0].cost > fit.cost + margin(fit)]
    return replace(fit, alike=(*fit.alike, *(one.state for one in places)))


def _edge(held: Fitter, path: str, beyond: WaveformFit, fit: WaveformFit) -> WaveformFit:
    """Where, on the way to the first place, the cost has risen by the margin, the valley being a parabola."""
    risen = max(beyond.cost - fit.cost, margin(fit))
    way = math.log(beyond.state.model.value(path) / fit.state.model.value(path)) * math.sqrt(margin(fit) / risen)
    value = fit.state.model.value(path) * math.exp(way)
    return held.fit(replace(fit.state, model=fit.state.model.with_values({path: value})), iterations=ITERATIONS)


def _walk(held: Fitter, path: str, factor: float, bounds: tuple[float, float], fit: WaveformFit) -> Iterator[WaveformFit]:
    """Fits with the scale held ever further away, until two in a row explain clearly less."""
    state, worse = fit.state, 0
    for _ in range(FURTHEST):
        value = factor * state.model.value(path)
        if not bounds[0] <= value <= bounds[1] or worse == 2:
            return
        found = held.fit(replace(state, model=state.model.with_values({path: value})), iterations=ITERATIONS)
        yield found
        state = found.state
        worse = worse + 1 if found.cost > fit.cost + 2.0 * margin(fit) else 0


def margin(fit: WaveformFit) -> float:
    """Cost above that of a fit up to which another state explains the records as well."""
    return max(ALIKE * max(1.0, fit.variance), SAME * fit.cost)
