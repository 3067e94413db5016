"""An effect of a found set exchanged for one of its kind, where that explains more beside the others.

A search is greedy: what was named first was named while the others were missing, and a law of its kind (a swing of the speed
for a droop, wear for an exponent of the chip) may have made up for them better than the true one, which no later round asks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from testbed.analysis.fit.effect_start import Origin, applicable, is_required, origins_of, refitted_without
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.candidate_round import begun_and_fitted, candidate_of
from testbed.analysis.search.score_test import BEHIND
from testbed.analysis.search.steady_speed import no_swing
from testbed.analysis.search.ties import clearly_better, tied_with
from testbed.effect import Effect
from testbed.machine import Model

NEAR = 1.02  # times the cost of the set to which one with another effect must come


def exchanged(
    found: Candidate, base: Candidate, model: Model, catalogue: Mapping[str, Effect], noise: float,
    progress: Callable[[str], None],
) -> tuple[Candidate, tuple[str, ...]]:  # fmt: skip
    """The set, or a better one with another effect of the same kind in it; and what is tied, if anything.

    The last effect is not asked about: the round that named it has tried all others. base: the base model.
    """
    for name in found.effects[:-1]:
        kin = _kin(name, found, catalogue)
        if not kin:
            continue
        progress(f"would another of its kind do in place of {name}?")
        reduced = _without(found, name, catalogue)
        origins = origins_of(reduced.fitter.engine, model, reduced.fitter, reduced.fit, anchored=False)
        for other in kin:
            instead = _instead(found, reduced, name, other, origins, catalogue, progress)
            if instead is None:
                continue
            if tied_with(found, instead, base, noise):
                return found, (name, other)
            if clearly_better(instead, found, noise):
                return instead, ()
    return found, ()


def _kin(name: str, found: Candidate, catalogue: Mapping[str, Effect]) -> list[str]:
    """Effects that act at the same places of the loop, by which one could be exchanged."""
    present, kind = found.fit.state.model.effects, _places(catalogue[name])
    if is_required(name, present, catalogue):
        return []
    others = {other: one for other, one in catalogue.items() if other not in present and one.parameters}
    beside = [one for one in present if one != name]
    return [other for other, one in others.items()
            if _places(one) & kind and applicable(one, found.fitter.records, beside)]


def _places(effect: Effect) -> set[str]:
    """Where on the loop an effect acts; all forces on a tooth are one place."""
    tooth = {"force_factor", "tangential_force", "normal_force"}
    return {"tooth" if hook in tooth else hook for hook in effect.hooks} - {"highest_frequency"}


def _without(found: Candidate, name: str, catalogue: Mapping[str, Effect]) -> Candidate:
    """The set without one of its effects, refitted."""
    fitter, fit = refitted_without(found.fitter, found.fit.state, name, catalogue)
    return candidate_of(fitter, fit, tuple(one for one in found.effects if one != name), None, 1.0)


def _instead(found: Candidate, reduced: Candidate, name: str, other: str, origins: Sequence[Origin],
             catalogue: Mapping[str, Effect], progress: Callable[[str], None]) -> Candidate | None:  # fmt: skip
    """The set with `other` in the place of `name`; None where that comes to nothing."""
    tried = begun_and_fitted(reduced, catalogue[other], catalogue, origins, progress,
                             hopeful=BEHIND * found.fit.cost, cost_limit=NEAR * found.fit.cost)
    if tried is None or tried.fit.cost > NEAR * found.fit.cost or no_swing(tried, catalogue):
        return None
    effects = tuple(other if one == name else one for one in found.effects)
    return replace(tried, effects=effects, delta_bic=found.delta_bic)
