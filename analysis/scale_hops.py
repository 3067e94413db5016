"""Out of a valley beside the deepest: the scales at which a law bends, looked for far and near.

A scale (where friction breaks away, how fast a speed falls) has valleys of its own beside the true one, and what else the
model lacked when it was first fitted has often led into one of them. Where the motion ends stuck, the valleys lie a few per
cent apart: there the cost is looked at over a fine grid, all else following linearly, and fitted from its lowest places.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.waveform import Fitter, WaveformFit
from testbed.effect import Effect, Parameter

CORNER = 8  # iterations of a fit that only has to find its valley
HOPS = (0.4, 2.5, 0.8, 1.25)  # factors by which a scale is moved, far and near
GRID = np.exp(np.linspace(-0.2, 0.2, 81))  # factors of the fine grid, 0.5 % apart
LOWEST = 3  # valleys of the fine grid that are fitted,
CLOSE = 30.0  # where they cost no more than this above the fit: half a squared standard error of a place beside the bottom
BATCH = 9  # variants simulated at once
CHEAPER = 1e-5  # share of the cost, and one unit more, that another valley must save


def hopped(fitter: Fitter, effects: Sequence[Effect], fit: WaveformFit) -> WaveformFit:
    """The fit, started again with every scale of these laws some way off, as long as that leads to a deeper valley."""
    for effect in effects:
        for parameter in effect.parameters:
            if not is_scale(parameter):
                continue
            path = f"{effect.name}.{parameter.name}"
            for factor in HOPS:
                fit = _along(fitter, path, factor, parameter.bounds, fit)
    return fit


def over_the_grid(fitter: Fitter, effects: Sequence[Effect], fit: WaveformFit) -> WaveformFit:
    """The fit from the lowest of the close valleys that the scales of laws with kinks have, in a model that is complete."""
    for effect in effects:
        for parameter in effect.parameters:
            if not effect.smooth and is_scale(parameter):
                fit = _over_the_grid(fitter, f"{effect.name}.{parameter.name}", parameter.bounds, fit)
    return fit


def is_scale(parameter: Parameter) -> bool:
    """Whether a parameter says where or how fast a law bends, rather than how strong, at what frequency or angle it is."""
    return not (parameter.vanishes or parameter.each_record or parameter.unit in ("Hz", "rad")) and parameter.bounds[0] > 0.0


def _along(fitter: Fitter, path: str, factor: float, bounds: tuple[float, float], fit: WaveformFit) -> WaveformFit:
    """The fit with one scale multiplied by a factor again and again, and all else fitted, while that costs less."""
    while bounds[0] <= factor * fit.state.model.value(path) <= bounds[1]:
        trial = _fitted_at(fitter, path, factor * fit.state.model.value(path), fit, CORNER)
        if not deeper(trial, fit):
            return fit
        fit = trial if trial.converged else fitter.fit(trial.state, iterations=4 * CORNER)
    return fit


def _over_the_grid(fitter: Fitter, path: str, bounds: tuple[float, float], fit: WaveformFit) -> WaveformFit:
    """The fit from the lowest valleys of a fine grid of one scale, as long as one of them is deeper."""
    while True:
        here = fit.state.model.value(path)
        values = here * GRID[(here * GRID >= bounds[0]) & (here * GRID <= bounds[1])]
        costs = profile(fitter, path, values, fit)
        padded = np.concatenate([[np.inf], costs, [np.inf]])
        valleys = np.flatnonzero((costs <= padded[:-2]) & (costs <= padded[2:]))
        valleys = valleys[np.argsort(costs[valleys])][:LOWEST]
        valleys = valleys[costs[valleys] < fit.cost + CLOSE]
        trials = [_fitted_at(fitter, path, float(values[place]), fit, CORNER) for place in valleys]
        best = min(trials, key=lambda one: one.cost, default=fit)
        if not deeper(best, fit):
            return fit
        fit = best if best.converged else fitter.fit(best.state, iterations=4 * CORNER)


def _fitted_at(fitter: Fitter, path: str, value: float, fit: WaveformFit, iterations: int) -> WaveformFit:
    moved = fit.state.model.with_values({path: value})
    return fitter.fit(replace(fit.state, model=moved), iterations=iterations)


def deeper(trial: WaveformFit, fit: WaveformFit) -> bool:
    """Whether a valley is deeper by more than what a fit that has converged may still gain."""
    return trial.cost < fit.cost * (1.0 - CHEAPER) - 1.0


def profile(fitter: Fitter, path: str, values: np.ndarray, fit: WaveformFit) -> np.ndarray:
    """Cost (values,) with one shared unknown held at each of the values and all others following by the fit's slopes."""
    others = [place for place, name in enumerate(fit.names) if name != path]
    squares, pulls = np.zeros(len(values)), np.zeros((len(values), len(others)))
    normal = np.zeros((len(others), len(others)))
    models = [fit.state.model.with_values({path: float(value)}) for value in values]
    for index, (part, own) in enumerate(zip(fit.parts, fit.state.nuisances, strict=True)):
        slopes = part.without_own(part.shared[:, others].T).T
        normal += slopes.T @ slopes
        for first in range(0, len(values), BATCH):
            variants = [(model, fit.state.angle, own) for model in models[first : first + BATCH]]
            rests = part.without_own(fitter.residuals_of(index, variants))
            squares[first : first + BATCH] += np.einsum("ij,ij->i", rests, rests)
            pulls[first : first + BATCH] += rests @ slopes
    solved = np.linalg.lstsq(normal, pulls.T, rcond=1e-12)[0].T
    return 0.5 * (squares - np.einsum("ij,ij->i", pulls, solved))
