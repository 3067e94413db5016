"""Finer steps for laws with kinks, at which the engine's steps are of second order only: for the last fit, not for the search.

With dry friction the steps that suffice for a search are some parts in ten thousand of the motion wrong, which is far below
the noise of any sample and yet, over all of them, tens of standard errors of the natural frequency. And where a motion ends
stuck, the phase it goes on vibrating with turns fast with every parameter: the cost has many valleys close to each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.pass_search import begun_otherwise
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.scale_profile import along_scales, kinked_scales, margin
from testbed.analysis.fit.solve import solve
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect

TIMES = 4  # as many steps: the error of second order falls to a sixteenth,
FLOWN = 2  # where free flights go from kink to kink exactly and it is a fifth of what it would be to begin with
MEETING = ("structure_force", "speed")  # hooks of a law beside a slider with which flights may be stepped
SETTLE = 10  # iterations of the last fit
DISTANCES = (4.0, 8.0, 16.0)  # standard errors from a fit at which a deeper valley is looked for
LOWEST = 6  # of these states from which a fit begins, for
BEGUN = 3  # iterations, and
KEPT = 3  # that are followed to the end
UNKNOWN = 10.0  # standard error, in natural steps, from which an unknown is none to look around in
ROUNDS = 3  # times that is done at the most


def fine(engine: Engine, times: int = TIMES) -> Engine:
    """A plant whose engine takes `times` as many steps as it would choose."""
    finer: Any = SimpleNamespace(
        predict_cuts=partial(engine.predict_cuts, refinement=times),
        predict_driven=partial(engine.predict_driven, refinement=times),
    )
    return finer


def times_finer(names: Iterable[str], catalogue: Mapping[str, Effect]) -> int:
    """How many times as many steps the last fit of these laws takes."""
    laws = [catalogue[name] for name in names if name in catalogue]
    others = [law for law in laws if law.slider is None]
    flown = len(others) == len(laws) - 1 and all(law.smooth for law in others)
    return FLOWN if flown and not any(hook in law.hooks for law in others for hook in MEETING) else TIMES


def kinked(names: Iterable[str], catalogue: Mapping[str, Effect]) -> list[Effect]:
    """Those of these laws that have a kink."""
    return [catalogue[name] for name in names if name in catalogue and not catalogue[name].smooth]


def has_kinks(names: Iterable[str], catalogue: Mapping[str, Effect]) -> bool:
    """Whether any of these laws has a kink."""
    return bool(kinked(names, catalogue))


def finely(fitter: Fitter, fit: WaveformFit, catalogue: Mapping[str, Effect]) -> tuple[Fitter, WaveformFit]:
    """The fit settled with finer steps in the deepest valley close by, and the fitter that did it."""
    times = times_finer(fit.state.model.effects, catalogue)
    finer = Fitter(fine(fitter.engine, times), fitter.records, fitter.unknowns)
    _, fit = solve(finer, finer.fit(begun_otherwise(finer, fit.state)[0], iterations=SETTLE), ("entries_together",))
    laws = kinked(fit.state.model.effects, catalogue)
    if not kinked_scales(laws):
        return finer, fit
    tried: list[WaveformFit] = []
    for _ in range(ROUNDS):
        around = (finer.descend(state, iterations=BEGUN, near=fit) for state in _around(finer, fit))
        begun = sorted(around, key=lambda one: one.cost)
        cost_limit = fit.cost + margin(fit)
        tried = [finer.fit(one.state, iterations=SETTLE, near=one, cost_limit=cost_limit) for one in begun[:KEPT]]
        best = min(tried, key=lambda one: one.cost, default=fit)
        before, fit = fit, min(fit, best, key=lambda one: one.cost)
        if not fit.cost < before.cost - margin(before):
            break
    alike = tuple(one.state for one in tried if one.cost <= fit.cost + margin(fit))
    return finer, along_scales(finer, laws, replace(fit, alike=alike))


def _around(fitter: Fitter, fit: WaveformFit) -> list[State]:
    """The best states some standard errors of a shared unknown away on either side, all others following as the slopes say."""
    covariance = fit.covariance / np.outer(fitter.steps, fitter.steps)
    errors = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    found = []
    for place, error in enumerate(errors):
        if error > UNKNOWN:
            continue
        for side in (-1.0, 1.0):
            states = []
            for distance in DISTANCES:
                move = side * distance * covariance[:, place] / error
                own = [-np.linalg.lstsq(part.own, part.shared @ move, rcond=1e-12)[0] for part in fit.parts]
                states.append(fitter.with_own(fitter.moved(fit.state, move), own))
            found.append(min(((fitter.cost(state), state) for state in states), key=lambda pair: pair[0]))
    return [state for _, state in sorted(found, key=lambda pair: pair[0])[:LOWEST]]
