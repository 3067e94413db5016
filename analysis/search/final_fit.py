"""The last fit of a set of effects: followed to its end, with finer steps where a law has a kink, and nothing kept that only
made up for coarse ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.effect_start import is_required, refitted_without
from testbed.analysis.fit.evidence import DELTA_BIC, bic, effective_size
from testbed.analysis.fit.fine_steps import finely, has_kinks
from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.moves import Scheme
from testbed.analysis.fit.solve import alternate_fit_and_passes, solve, to_its_end
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.candidate_round import candidate_of
from testbed.effect import Effect

CHANCE = 3.0  # standard errors that an effect may differ from none by chance
WORSE = 1.02  # times the held-out error that the last fit with finer steps may have: beyond, it went astray


def settled(one: Candidate, catalogue: Mapping[str, Effect]) -> Candidate:
    """The last set of effects, followed to its end and with finer steps where a law has a kink: its parameters are told.

    An effect that no longer differs from none is not kept beside others.
    """
    return _without_needless(_followed(one, catalogue), catalogue)


def _followed(one: Candidate, catalogue: Mapping[str, Effect]) -> Candidate:
    if not has_kinks(list(one.fit.state.model.effects), catalogue):
        return fitted_anew(one, one.fitter, to_its_end(one.fitter, one.fit))  # a short one of a round may have ended anywhere
    fitter, fit = finely(one.fitter, one.fit, catalogue)
    idle = [name for name in one.effects if _does_nothing(fitter, fit, name)]  # it made up for the error of the steps
    if idle:
        state = fit.state
        for name in idle:
            state, fitter = state.without_effect(name), fitter.without(name)
        fit = fitter.fit(state, iterations=12)
    effects = tuple(name for name in one.effects if name not in idle)
    found = candidate_of(fitter, fit, effects, None, 1.0)
    return replace(found, delta_bic=one.delta_bic) if found.error_held_out <= WORSE * one.error_held_out else one


def _without_needless(one: Candidate, catalogue: Mapping[str, Effect]) -> Candidate:
    """The set without those of its effects that end where they may as well be none, if the BIC is then no worse.

    Found before the one that is missing, an effect may have stood for it, and for ends of cuts that were found after it.
    """
    for name in one.effects:
        if len(one.effects) > 1 and not is_required(name, one.effects, catalogue) and _may_be_none(one.fit, catalogue[name]):
            one = without(one, name, catalogue) or one
    return one


def without(one: Candidate, name: str, catalogue: Mapping[str, Effect], near: float = 0.0) -> Candidate | None:
    """The set refitted without one of its effects, its gain as it was; None where the BIC is then worse.

    near: in BIC, by which a short fit may be too bad, to be followed to its end.
    """
    fitter, fit = refitted_without(one.fitter, one.fit.state, name, catalogue)
    size = effective_size(one.fit)
    most = bic(one.fit, size) + DELTA_BIC
    if 0.0 < bic(fit, size) - most < near:
        fit = alternate_fit_and_passes(fitter, fit.state)  # it may creep on
    if bic(fit, size) > most:
        return None
    effects = tuple(other for other in one.effects if other != name)
    return replace(candidate_of(fitter, fit, effects, None, 1.0), delta_bic=one.delta_bic)


def _may_be_none(fit: WaveformFit, effect: Effect) -> bool:
    """Whether all that an effect's strength is told by is as near to nothing as noise may bring it."""
    errors = dict(zip(fit.names, np.sqrt(np.maximum(np.diag(fit.covariance), 0.0)), strict=True))
    none = {f"{effect.name}.{one.name}": one.neutral for one in effect.parameters if one.vanishes}
    strengths = [path for path in none if path in errors]
    return bool(strengths) and all(abs(fit.state.model.value(path) - none[path]) < CHANCE * errors[path] for path in strengths)


def fitted_anew(one: Candidate, fitter: Fitter, fit: WaveformFit) -> Candidate:
    """The set as it was fitted otherwise, its gain as it was; itself where that is its own fit."""
    return one if fit is one.fit else replace(candidate_of(fitter, fit, one.effects, None, 1.0), delta_bic=one.delta_bic)


def solved_on(one: Candidate, scheme: Scheme) -> Candidate:
    """The set after the moves of a scheme."""
    return fitted_anew(one, *solve(one.fitter, one.fit, scheme))


def _does_nothing(fitter: Fitter, fit: WaveformFit, name: str) -> bool:
    """Whether an effect can be taken out as it stands, nothing refitted, and is not missed."""
    return fitter.without(name).cost(fit.state.without_effect(name)) <= fit.cost + 0.5 * DELTA_BIC * fit.variance
