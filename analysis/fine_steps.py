"""Finer steps for laws with kinks, at which the engine is of second order only: for the last fit, not for the search.

With dry friction the steps that suffice for a search are some parts in ten thousand of the motion wrong, which is far below
the noise of any sample and yet, over all of them, tens of standard errors of the natural frequency. And where a motion ends
stuck, the phase it goes on vibrating with turns fast with every parameter: the cost has many valleys close to each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from analysis.entry_passes import entries_together
from analysis.observed import Plant
from analysis.scale_hops import hopped, over_the_grid
from analysis.scale_profile import along_scales
from analysis.waveform import Fitter, State, WaveformFit
from testbed.effect import Effect

TIMES = 4  # as many steps: the error of second order falls to a sixteenth
SETTLE = 10  # iterations of the last fit
DISTANCES = (-16.0, -8.0, -4.0, 4.0, 8.0, 16.0)  # standard errors from a fit at which a deeper valley is looked for
LOWEST = 3  # of these states that are fitted
UNKNOWN = 10.0  # standard error, in natural steps, from which an unknown is none to look around in
ROUNDS = 4  # times that is done at the most


def fine(plant: Plant) -> Plant:
    """A plant whose engine takes `TIMES` as many steps as it would choose."""
    finer: Any = SimpleNamespace(
        predict_cuts=partial(plant.predict_cuts, refinement=TIMES),
        predict_driven=partial(plant.predict_driven, refinement=TIMES),
    )
    return finer


def has_kinks(names: Sequence[str], catalogue: Mapping[str, Effect]) -> bool:
    """Whether any of these laws has a kink."""
    return any(not catalogue[name].smooth for name in names if name in catalogue)


def finely(fitter: Fitter, fit: WaveformFit, catalogue: Mapping[str, Effect]) -> tuple[Fitter, WaveformFit]:
    """The fit settled with finer steps in the deepest valley close by, and the fitter that did it."""
    finer = Fitter(fine(fitter.plant), fitter.records, fitter.unknowns)
    fit = entries_together(finer, finer.fit(fit.state, iterations=SETTLE))
    laws = [catalogue[name] for name in fit.state.model.effects if name in catalogue]
    fit = over_the_grid(finer, laws, hopped(finer, laws, fit))
    for _ in range(ROUNDS):
        states = sorted(_around(finer, fit), key=finer.cost)[:LOWEST]
        best = min((finer.fit(state, iterations=SETTLE) for state in states), key=lambda one: one.cost)
        if not best.cost < fit.cost - 1.0:
            break
        fit = best
    return finer, along_scales(finer, laws, fit)


def _around(fitter: Fitter, fit: WaveformFit) -> list[State]:
    """States some standard errors of each shared unknown away, all others following as the slopes say."""
    covariance = fit.covariance / np.outer(fitter.steps, fitter.steps)
    errors = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    found = []
    for place, error in enumerate(errors):
        if error > UNKNOWN:
            continue
        for distance in DISTANCES:
            move = distance * covariance[:, place] / error
            own = [-np.linalg.lstsq(part.own, part.shared @ move, rcond=1e-12)[0] for part in fit.parts]
            found.append(fitter.with_own(fitter.moved(fit.state, move), own))
    return found
