"""Out of a valley beside the deepest: the scales at which a law bends, looked for far and near.

A scale (where friction breaks away, how fast a speed falls) has valleys of its own beside the true one, and what else the
model lacked when it was first fitted has often led into one of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.pass_search import place_exits
from testbed.analysis.fit.solve import Goal, Move, Trial, alternate_fit_and_passes, least_gain
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect, Parameter

CORNER = 8  # iterations of a fit that only has to find its valley
SETTLE = 20  # iterations of the fit that follows
HOPS = (0.4, 2.5, 0.8, 1.25)  # factors by which a scale is moved, far and near
MUCH = 1e-3  # share of the cost that another valley must save for there to be a deeper one further along


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit, started again with every scale of its laws some way off, as long as that leads to a deeper valley.

    There the exits are looked for anew: the valley that was left may have held them many passes early or late. From the prior,
    a law without a kink has no other valley: only what the model lacked when it was fitted leads into one.
    """
    first = fit
    for path, bounds in scales([law for law in goal.laws if goal.before < math.inf or not law.smooth]):
        for factor in HOPS:
            fit = _along(fitter, path, factor, bounds, fit)
    if fit is not first:
        yield Trial(fitter, alternate_fit_and_passes(fitter, place_exits(fitter, fit.state), rounds=3, iterations=SETTLE))


MOVE = Move(propose)


def scales(effects: Sequence[Effect]) -> Iterator[tuple[str, tuple[float, float]]]:
    """(path, bounds) of every scale of these laws."""
    for effect in effects:
        for parameter in effect.parameters:
            if _is_scale(parameter):
                yield f"{effect.name}.{parameter.name}", parameter.bounds


def _is_scale(parameter: Parameter) -> bool:
    """Whether a parameter says where or how fast a law bends, rather than how strong, at what frequency or angle it is."""
    return not (parameter.vanishes or parameter.each_record or parameter.unit in ("Hz", "rad")) and parameter.bounds[0] > 0.0


def _along(fitter: Fitter, path: str, factor: float, bounds: tuple[float, float], fit: WaveformFit) -> WaveformFit:
    """The fit with one scale multiplied by a factor again and again, and all else fitted, while that costs less."""
    while bounds[0] <= factor * fit.state.model.value(path) <= bounds[1]:
        moved = fit.state.with_value(path, factor * fit.state.model.value(path))
        trial = fitter.fit(moved, iterations=CORNER, cost_limit=fit.cost)
        if not trial.cost < fit.cost - least_gain(fit):
            return fit
        before, fit = fit.cost, trial if trial.converged else fitter.fit(trial.state, iterations=4 * CORNER, near=trial)
        if fit.cost > (1.0 - MUCH) * before:  # the same valley, which is flat along the scale
            return fit
    return fit
