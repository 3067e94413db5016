"""Effects that the data cannot tell apart: a tie of two candidates, and whether what was found later has broken it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from testbed.analysis.fit.effect_start import extended, is_required, state_without
from testbed.analysis.fit.evidence import DELTA_BIC, bic, effective_size
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.search.candidate import ADEQUATE, Candidate, Tried
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.diagnosis import Diagnosis, excess
from testbed.effect import Effect

ALIKE = 0.02  # share of what the better one gains that the other may lack
NEAR = 3.0  # times DELTA_BIC that such a one may lie apart
CLOSE = 0.5  # share of the excess that a runner-up may leave and still be worth a test of its own


def tied_with(first: Tried, other: Tried, current: Tried, noise: float) -> bool:
    """Whether the data cannot tell two candidates, both better than `current`, apart."""
    if not isinstance(other, Candidate) or not isinstance(first, Candidate):
        return False
    size = effective_size(first.fit)
    apart = abs(bic(other.fit, size) - bic(first.fit, size))
    best = excess(first.error_beside(noise), noise)
    gained = excess(current.error_held_out, noise) - best
    lost = excess(other.error_beside(noise), noise) - best
    return apart < DELTA_BIC or (lost < ALIKE * gained and apart < NEAR * DELTA_BIC)


def with_rivals(
    found: Candidate, rivals: Sequence[Candidate], base: Candidate, noise: float, catalogue: Mapping[str, Effect],
    progress: Callable[[str], None],
) -> tuple[Candidate, tuple[str, ...]]:  # fmt: skip
    """The set of effects that a search found, or a better one with a rival in it; and what is tied, if anything.

    rivals: candidates that, alone, explained as much as the first of them did when that was chosen. base: the base model.
    """
    first, tied = rivals[0].effects[-1], []
    for rival in rivals[1:]:
        name = rival.effects[-1]
        if first not in found.effects or name in found.effects or is_required(first, (*found.effects, name), catalogue):
            continue  # a third mode in place of the second is that one by another name
        other = rival
        if len(found.effects) > 1:
            progress(f"would {name} do in place of {first}?")
            other = _in_place(found, first, rival, catalogue)
        if tied_with(found, other, base, noise):
            tied.append(name)
        elif clearly_better(other, found, noise):
            found, first, tied = other, name, []
    return found, (first, *tied) if tied else ()


def clearly_better(other: Candidate, found: Candidate, noise: float) -> bool:
    """Whether a set of effects explains more than the one found by BIC, and held out too, unless it leaves but noise."""
    size = effective_size(found.fit)
    foretold = other.error_where_known <= ADEQUATE * noise or other.error_held_out < found.error_held_out
    return foretold and bic(other.fit, size) < bic(found.fit, size) - DELTA_BIC


def _in_place(found: Candidate, first: str, rival: Candidate, catalogue: Mapping[str, Effect]) -> Candidate:
    """The set found with another effect in the place of its first one, fitted from where both were."""
    effect = catalogue[rival.effects[-1]]
    fitter = extended(found.fitter.without(first), effect)
    state = state_without(found.fit.state, first, catalogue)
    state = replace(state, model=state.model.with_effect(effect.name, **rival.fit.state.model.effects[effect.name]))
    fit = alternate_fit_and_passes(fitter, state, rounds=2, iterations=20)
    effects = (effect.name, *(one for one in found.effects if one != first))
    return replace(candidate_of(fitter, fit, effects, None, 1.0), delta_bic=found.delta_bic)


def rivals_of(result: Diagnosis) -> list[Candidate]:
    """What the records leave open: the fits with each of the tied effects, or with the named one and with what came close, the
    best first; all with as many effects. Empty where there is no such answer."""
    rivals = [one for one in result.fitted if len(one.effects) == len(result.best.effects)]
    if result.verdict not in ("undecided", "missing_effect") or not result.effects or not rivals:
        return []
    rivals.sort(key=lambda one: one.error_held_out)
    if result.verdict == "undecided":
        rivals = [one for one in rivals if one.effects[-1] in result.effects] or rivals
    most = CLOSE * excess(result.baseline, result.noise_floor)
    return [rivals[0], *(one for one in rivals[1:] if excess(one.error_held_out, result.noise_floor) <= most)]
