"""One round of a diagnosis: every effect that could be missing tried, the leaders fitted in full.

A first Gauss-Newton step ranks them (a score test with a look at the true cost). The leader is refitted; where it does not
explain everything and no first step led to much, the believed machine is asked, and all are tried once more from far outside
where that does not tell; so is that machine where the leader leaves twice the noise. Then the other leaders follow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from testbed.analysis.fit.effect_start import Origin
from testbed.analysis.fit.evidence import bic, effective_size, excess, noise_cost
from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.free_parameters import at_a_bound
from testbed.analysis.fit.held_out import errors_in_fit, held_out_errors, pooled
from testbed.analysis.fit.moves import QUICK, WORTH_HOPPING, WORTH_PARTS
from testbed.analysis.fit.solve import Goal, alternate_fit_and_passes, solve
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.candidate import ADEQUATE, Candidate, Tried
from testbed.analysis.search.diagnosis import CERTAIN, COMPLETE
from testbed.analysis.search.score_test import (
    BEHIND,
    FAINT,
    ScreenedCandidate,
    begun,
    best_cost,
    first_steps,
    from_far,
    not_sudden,
    nothing_hidden,
    shifts_in_time,
    try_from_far,
)
from testbed.analysis.search.steady_speed import no_swing
from testbed.effect import Effect

LEADERS = 4  # candidates refitted in full
HOPE = 0.2  # share of the gain the gate asks for that the first step of a candidate must bring to be refitted at all
GAIN = 0.01  # share of the held-out excess over the noise that an effect must take away
CREEP = 15  # iterations of a law with a kink before its scales are looked for in other valleys
RIVAL = 1.5  # times the cost of the best of its round above which a candidate is given up where that explains everything,
CLOSE = 0.3  # or above it by this share of what that takes away: so much no rival of it leaves
MUCH = 0.3  # share of the excess that the best first step may leave for the others not to be tried from far,
LITTLE = 0.03  # or its fit: most of what no first step showed would then have to be hidden behind it
ROUGH = 2.0  # error over noise floor from which a leader may have taken over what another does: the believed machine is asked


def candidate_of(
    fitter: Fitter, fit: WaveformFit, effects: tuple[str, ...], reference: WaveformFit | None, size: float
) -> Candidate:
    """A set of effects as it was fitted: errors held out and in sample, parameters, and its gain in BIC over a reference."""
    errors = held_out_errors(fitter, fit)
    parameters = {path: fit.state.model.value(path) for path in fit.names if path.partition(".")[0] in fit.state.model.effects}
    if fitter.shifting:  # every record has its own: the first one's is told
        first = fit.state.nuisances[0].shifted(fit.state.model)
        parameters |= {one.path: first.value(one.path) for one in fitter.shifting}
    gain = 0.0 if reference is None else bic(reference, size) - bic(fit, size)
    return Candidate(
        effects=effects, parameters=parameters, error_fit=pooled(errors_in_fit(fitter, fit))[0],
        error_held_out=pooled(errors)[0], delta_bic=gain, converged=fit.converged, errors=tuple(errors), fit=fit, fitter=fitter,
    )


def by_noise(one: Candidate) -> Candidate:
    """A set of effects as it was fitted, with residuals and covariance in units of the noise again."""
    if all(record.weight is None for record in one.fitter.records):
        return one
    records = [replace(record, weight=None) for record in one.fitter.records]
    fitter = one.fitter.on(records)
    return replace(one, fitter=fitter, fit=replace(fitter.fit(one.fit.state, iterations=0), converged=one.fit.converged))


def try_candidates(
    current: Candidate,
    catalogue: Mapping[str, Effect],
    origins: Sequence[Origin],
    progress: Callable[[str], None],
    last: bool = False,
    alone: Callable[[], Sequence[Candidate]] = tuple,
    of_other_law: Callable[[Candidate], bool] | None = None,
) -> list[Tried]:
    """Candidates that extend the current set by one effect, the one that foretells best first.

    last: no further round follows, so that only one which leaves hardly more than noise is of interest.
    alone: gives effects that leave hardly more than noise from the believed machine; asked where no first step led to much, or
    the fit of the leader to no less than twice the noise. of_other_law: whether a law of no catalogue is what a set lacks;
    asked before that, and with it the round ends.
    """
    noise = pooled(current.errors)[1]
    near = nothing_hidden(current, noise)
    entries = first_steps(current, catalogue, origins, progress, growing=not near)
    floor, over = noise_cost(current.fitter), excess(current.fitter, current.fit.cost)
    hopeful = current.fit.cost - HOPE * GAIN * over
    wanted = COMPLETE**2 * floor if last else math.inf
    ruled_out: list[Tried] = []
    while entries and entries[0].cost <= hopeful:
        entries[0].fitted = _refitted(current, entries[0], catalogue, progress, cost_limit=wanted, of_other_law=of_other_law)
        if not no_swing(entries[0].fitted, catalogue):
            break
        ruled_out.append(_not_fitted(current, entries.pop(0).name))
    if entries and entries[0].cost <= hopeful:
        leader = entries[0]
        assert leader.fitted is not None
        incomplete = leader.fitted.error_where_known > ADEQUATE * noise
        little = leader.cost - floor <= MUCH * over or leader.fitted.fit.cost - floor <= LITTLE * over
        far = (incomplete and not little) or at_a_bound(leader.fitter.free, leader.fitted.fit.state.model)
        if far or leader.fitted.error_where_known > ROUGH * noise:
            if of_other_law is not None and of_other_law(leader.fitted):
                return [leader.fitted, *ruled_out, *(_not_fitted(current, one.name) for one in entries[1:])]
            if not _put(current, entries, alone()) and far:
                try_from_far(current, entries, catalogue, origins, progress, BEHIND * best_cost(entries))
        elif not incomplete and current.error_held_out < FAINT * noise and not near:
            stuck = [one for one in entries if one.fitted is None and one.cost > hopeful]
            cost_limit = _rivalling(current.fit.cost, best_cost(entries))
            try_from_far(current, not_sudden(stuck, catalogue), catalogue, origins, progress, cost_limit, nearer=True)
            entries.sort(key=lambda entry: entry.reached)
        elif incomplete and "engagement" in catalogue[leader.name].hooks:  # its passes may be wrong in all records alike
            from_far(current, leader, catalogue[leader.name], origins)
    elif entries and not near and not _put(current, entries, alone()):
        try_from_far(current, entries, catalogue, origins, progress, math.inf)
    found: list[Tried] = ruled_out
    complete = 0  # once a candidate explains everything, only a rival close to it can still matter
    for place, entry in enumerate(entries):
        if entry.fitted is None and (place >= LEADERS or complete > 1 or entry.cost > hopeful):
            found.append(_not_fitted(current, entry.name))
            continue
        best = best_cost(entries)
        iterations, cost_limit = (10, _rivalling(current.fit.cost, best)) if complete else (40, BEHIND * best)
        cost_limit = min(wanted, cost_limit)
        fitted = entry.fitted = entry.fitted or _refitted(current, entry, catalogue, progress, iterations, cost_limit)
        if no_swing(fitted, catalogue):
            found.append(_not_fitted(current, entry.name))
            continue
        found.append(fitted)
        complete += int(complete > 0 or fitted.error_where_known <= ADEQUATE * noise)
    if not complete:
        others = _others_in_time(current, entries, catalogue, progress, hopeful, wanted)
        known = {one.effects for one in others}
        found = [*(one for one in found if one.effects not in known), *others]
    return sorted(found, key=lambda candidate: candidate.error_beside(noise))


def _others_in_time(current: Candidate, entries: Sequence[ScreenedCandidate], catalogue: Mapping[str, Effect],
                    progress: Callable[[str], None], hopeful: float, wanted: float) -> list[Candidate]:  # fmt: skip
    """Where what shifts the record in time explains most, and not all, the others that do, fitted in full.

    Their first steps tell too little for a place among the leaders: own speeds and angles have made up for them.
    """
    fitted = [entry for entry in entries if entry.fitted is not None]
    if not fitted or not shifts_in_time(catalogue[min(fitted, key=lambda entry: entry.reached).name]):
        return []
    found = []
    for entry in entries:
        if entry.fitted is None and entry.cost <= hopeful and shifts_in_time(catalogue[entry.name]):
            entry.fitted = _refitted(current, entry, catalogue, progress, cost_limit=min(wanted, BEHIND * best_cost(entries)))
            found += [] if no_swing(entry.fitted, catalogue) else [entry.fitted]
    return found


def _put(current: Candidate, entries: list[ScreenedCandidate], found: Sequence[Candidate]) -> bool:
    """Put effects where they were found, in the round's own units; whether one of them leaves nothing to be looked for."""
    weights = [record.weight for record in current.fitter.records]
    known = {entry.name: entry for entry in entries}
    found = [one for one in found if one.effects[-1] in known]
    for one in found:
        entry = known[one.effects[-1]]
        records = [replace(record, weight=weight) for record, weight in zip(one.fitter.records, weights, strict=True)]
        entry.state, entry.fitter, entry.fitted = one.fit.state, one.fitter.on(records), None
        entry.cost = entry.fitter.cost(entry.state)
        if all(weight is None for weight in weights):
            entry.fitted = _candidate(current, one.fitter, one.fit, one.effects)
    entries.sort(key=lambda entry: entry.reached)
    return any(one.error_where_known <= ADEQUATE * pooled(current.errors)[1] for one in found)


def _not_fitted(current: Candidate, name: str) -> Tried:
    """A candidate that is ruled out."""
    return Tried((*current.effects, name), {}, current.error_fit, current.error_held_out, 0.0, False)


def _rivalling(before: float, best: float) -> float:
    """The cost from which a candidate may rival the best one, which explains everything that `before` leaves."""
    return min(RIVAL * best, best + CLOSE * max(before - best, 0.0))


def certain_candidates(
    current: Candidate,
    catalogue: Mapping[str, Effect],
    origins: Sequence[Origin],
    progress: Callable[[str], None],
) -> list[Candidate]:
    """Candidates for a model that leaves but noise: those that many samples make certain all the same, most gain first."""
    hopeful = current.fit.cost * math.exp(-HOPE * CERTAIN / effective_size(current.fit))
    entries = first_steps(current, catalogue, origins, progress, growing=False)
    if not nothing_hidden(current, pooled(current.errors)[1]) and entries and entries[0].cost <= hopeful:
        behind = [one for place, one in enumerate(entries) if place >= LEADERS or one.cost > hopeful]  # no first step tells
        try_from_far(current, not_sudden(behind, catalogue), catalogue, origins, progress, math.inf, nearer=True)
    leaders = sorted((one for one in entries if one.cost <= hopeful), key=lambda one: one.cost)[:LEADERS]
    found = [_refitted(current, one, catalogue, progress) for one in leaders]
    believable = (one for one in found if one.delta_bic > CERTAIN and not no_swing(one, catalogue))
    return sorted(believable, key=lambda one: -one.delta_bic)


def with_effect(
    current: Candidate,
    name: str,
    catalogue: Mapping[str, Effect],
    origins: Sequence[Origin],
    progress: Callable[[str], None],
) -> Candidate:
    """The current set and one effect more, fitted from every start that a round of a diagnosis knows."""
    effect = catalogue[name]
    entry = begun(current, effect, origins)
    if name not in entry.state.model.effects:
        return current
    found = entry.fitted = _refitted(current, entry, catalogue, progress)
    if not shifts_in_time(effect) and found.error_held_out > ADEQUATE * pooled(current.errors)[1]:
        progress(f"trying {name} from far")
        from_far(current, entry, effect, origins)
        found = entry.fitted or _refitted(current, entry, catalogue, progress)
    return found


def begun_and_fitted(
    current: Candidate, effect: Effect, catalogue: Mapping[str, Effect], origins: Sequence[Origin],
    progress: Callable[[str], None], *, hopeful: float, cost_limit: float,
) -> Candidate | None:  # fmt: skip
    """The current set and one effect more, as far as showed that it does not come to a cost of `cost_limit`.

    None where its first step leaves more than the cost `hopeful`.
    """
    entry = begun(current, effect, origins)
    if effect.name not in entry.state.model.effects or entry.cost > hopeful:
        return None
    return _refitted(current, entry, catalogue, progress, cost_limit=cost_limit)


def _refitted(
    current: Candidate, entry: ScreenedCandidate, catalogue: Mapping[str, Effect], progress: Callable[[str], None],
    iterations: int = 40, cost_limit: float = math.inf, of_other_law: Callable[[Candidate], bool] | None = None,
) -> Candidate:  # fmt: skip
    """The entry fitted in full, or as far as showed that it will not come down to `cost_limit`, or lacks another law."""
    progress(f"refitting with {entry.name}")
    if not catalogue[entry.name].smooth:  # its valleys are narrow and bent: crept along after another scale is looked for
        iterations = min(iterations, CREEP)
    effects = (*current.effects, entry.name)
    goal = Goal(tuple(catalogue[name] for name in effects), cost_limit=cost_limit, before=current.fit.cost, rounds=3,
                iterations=iterations)
    fit = alternate_fit_and_passes(entry.fitter, entry.state, rounds=3, iterations=iterations, cost_limit=cost_limit)
    entry.fitter, fit = solve(entry.fitter, fit, QUICK, goal)
    if fit.cost > cost_limit:
        return _candidate(current, entry.fitter, fit, effects)
    if of_other_law is not None and _rough(entry.fitter, fit):
        found = _candidate(current, entry.fitter, fit, effects)
        if of_other_law(found):
            return found
    entry.fitter, fit = solve(entry.fitter, fit, WORTH_PARTS, goal)
    found = _candidate(current, entry.fitter, fit, effects)
    fitter, deeper = solve(entry.fitter, fit, WORTH_HOPPING, goal)
    other = found if deeper is fit else _candidate(current, fitter, deeper, effects)
    return min(other, found, key=lambda one: one.error_held_out)  # a deeper valley that foretells less is of this sample alone


def _rough(fitter: Fitter, fit: WaveformFit) -> bool:
    """Whether a fit leaves twice the noise."""
    error, noise = pooled(errors_in_fit(fitter, fit))
    return error > ROUGH * noise


def _candidate(current: Candidate, fitter: Fitter, fit: WaveformFit, effects: tuple[str, ...]) -> Candidate:
    size = effective_size(fit if fit.cost < 0.5 * current.fit.cost else current.fit)
    return candidate_of(fitter, fit, effects, current.fit, size)
