"""Backward: a smaller set fitted again from where a larger one ended, and effects that later ones made needless taken out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from testbed.analysis.fit.effect_start import is_required, state_without
from testbed.analysis.fit.evidence import effective_size
from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.moves.parts_of_passes import as_believed
from testbed.analysis.fit.solve import least_gain
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.candidate import Candidate, Tried
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.final_fit import without
from testbed.effect import Effect

NEARLY = 100.0  # in BIC, by which a short fit without an effect may be worse, to be followed to its end


def nesting_guard(current: Candidate, tried: Sequence[Tried], catalogue: Mapping[str, Effect]) -> Candidate:
    """The current set refitted from where the best larger set ended: a local minimum must not pass for missing physics."""
    best = current
    for one in sorted((one for one in tried if isinstance(one, Candidate)), key=lambda one: one.error_fit)[:2]:
        for fit in _nested(current.fitter, one, catalogue):
            if fit.cost < best.fit.cost - least_gain(best.fit):
                best = candidate_of(current.fitter, fit, current.effects, best.fit, effective_size(fit))
    return best


def _nested(fitter: Fitter, larger: Candidate, catalogue: Mapping[str, Effect]) -> list[WaveformFit]:
    """Fits begun where a larger set ended, without its last effect.

    A gradual entry has places of first touch, too: they may be all that it was good for, in cuts that begin within an arc.
    """
    state, name = larger.fit.state, larger.effects[-1]
    found = [fitter.fit(state_without(state, name, catalogue), iterations=12)]
    if "engagement" in catalogue[name].hooks and not fitter.gradual:
        sudden = state.without_effect(name).with_sudden_entries(fitter.records)
        begun = fitter.fit(sudden, iterations=12)
        in_arc = any(own.ends_in_arc() for own in begun.state.nuisances)
        parts = as_believed(fitter, begun) if in_arc else begun
        found += [] if parts is None else [parts]
    return found


def backward(current: Candidate, catalogue: Mapping[str, Effect], progress: Callable[[str], None]) -> Candidate:
    """The set without every effect that the later ones made needless: refitted without it, the BIC is no worse."""
    for name in current.effects[:-1]:
        if is_required(name, current.effects, catalogue):
            continue
        progress(f"is {name} still needed?")
        current = without(current, name, catalogue, NEARLY) or current
    return current
