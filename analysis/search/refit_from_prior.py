"""A named effect fitted anew from the believed machine, where a search that began at the base fit may have gone astray.

What the base model made up for (an immersion far off by the tooth's angle, an exponent by turning the force) can lead every
start from it into a valley from which no descent returns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import replace

from testbed.analysis.fit.effect_start import ANCHOR, CORNER
from testbed.analysis.fit.evidence import DELTA_BIC
from testbed.analysis.fit.fine_steps import has_kinks
from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.identifiable import Identifiable
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.starts import fitter_of_openings, scan_starts, with_exits
from testbed.analysis.fit.switched import switchable
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.analysis.search.candidate_round import CREEP, by_noise, candidate_of
from testbed.effect import Effect
from testbed.machine import Model

CLEAN = 1.01  # error over noise floor up to which nothing is left that another valley could explain
FAR_OFF = 2.0  # times the cost of the noise above which a fit is given up that is of use only if it leaves but that
WITHOUT_PARTS = 20.0  # the same of one that takes for whole the passes that are not
MUCH_CHEAPER = 0.7  # times the cost that the new fit must have where it, too, leaves more than noise


def from_believed(
    engine: Engine, records: Sequence[Observed], model: Model, names: Sequence[str], catalogue: Mapping[str, Effect],
    cost_limit: float = math.inf, turned: Container[str] = (), told: Identifiable | None = None,
) -> Candidate:  # fmt: skip
    """The effects of these names, each from its example, fitted from the believed `model`; its gain in BIC counts as none.

    cost_limit: the cost above which the fit is of no use, and is given up. turned: see `with_examples`. told: what
    the records tell of the believed model with them, if that is at hand.
    """
    believed = with_examples(model, names, catalogue, turned)
    found = model_fit(engine, records, believed, catalogue, cost_limit=cost_limit, told=told)
    return candidate_of(*found, tuple(names), None, 1.0)


def explaining(records: Sequence[Observed], state: State) -> float:
    """The cost from which a fit is given up that is of use only if it leaves but noise.

    state: of a fit at hand. Where it has cuts that begin or end within an arc, a fit from the beginning finds those last.
    """
    in_arc = any(own.ends_in_arc() for own in state.nuisances)
    return (WITHOUT_PARTS if in_arc else FAR_OFF) * 0.5 * sum(record.size for record in records)


def with_examples(model: Model, names: Sequence[str], catalogue: Mapping[str, Effect], turned: Container[str] = ()) -> Model:
    """The model with the effects of these names as strong as their examples; those `turned` on the other side of neutral."""
    for name in names:
        other = catalogue[name].other_side() if name in turned else None
        model = model.with_effect(name, **(other or catalogue[name].example()))
    return model


def refit_from_prior(
    first: Candidate, model: Model, catalogue: Mapping[str, Effect], noise: float, progress: Callable[[str], None]
) -> Candidate:
    """The set of effects, or, where it leaves more than noise, its fit from the believed `model`, if that explains more.

    noise: the noise floor, as the errors. The effect that was found last starts at its example, the others as found. With
    laws that have kinks, what is left may be the error of the engine's steps; then only much calls for another fit of all.
    No cost gives that fit up: passes, parts of them and what the first teeth meet, found last, may be most of what is left.
    What changes the arc of engagement is fitted by the noise.
    """
    if first.error_held_out <= CLEAN * noise:
        return first
    if has_kinks(first.effects, catalogue) and first.error_held_out <= ANCHOR * noise:
        return _cut_anew(first, model, progress)
    progress(f"fitting {first.effects[-1]} anew from the believed machine")
    believed = _believed_but_last(first, model, catalogue)
    now = by_noise(first) if "immersion" in catalogue[first.effects[-1]].hooks else first
    engine, records, free = now.fitter.engine, now.fitter.records, now.fitter.unknowns
    fitter, fit = model_fit(engine, records, believed, catalogue, free, known=now.fit.cost)
    found = replace(candidate_of(fitter, fit, first.effects, None, 1.0), delta_bic=first.delta_bic)
    return found if _better(found, now.fit, fit, noise) and found.error_held_out < first.error_held_out else first


def _cut_anew(first: Candidate, model: Model, progress: Callable[[str], None]) -> Candidate:
    """The set with cutting coefficients and mark angle looked for again from what is believed of them, if that is better.

    Structure and effects begin as found: with a law that has kinks they know their valley by now, and all else is dear.
    """
    fitter, cutting = first.fitter, model.cutting
    if cutting is None or all(record.cut is None for record in fitter.records):
        return first
    progress(f"fitting {first.effects[-1]} anew with the cutting coefficients as believed")
    believed = first.fit.state.model.with_values(
        {path: getattr(cutting, path) for path in ("tangential_coefficient", "normal_coefficient")})  # fmt: skip
    opening = fitter_of_openings(fitter.engine, fitter.records, fitter.unknowns)
    start = scan_starts(fitter.engine, opening.records, believed, 1)[0]
    begun = alternate_fit_and_passes(opening, start, rounds=2, iterations=CORNER)
    begun_state = with_exits(fitter, begun.state)
    fit = alternate_fit_and_passes(fitter, begun_state, rounds=3, iterations=CREEP, cost_limit=first.fit.cost)
    if not fit.cost < first.fit.cost - 0.5 * DELTA_BIC * fit.variance:
        return first
    found = replace(candidate_of(fitter, fit, first.effects, None, 1.0), delta_bic=first.delta_bic)
    return found if found.error_held_out < first.error_held_out else first


def _believed_but_last(one: Candidate, model: Model, catalogue: Mapping[str, Effect]) -> Model:
    """The believed `model` with the set's effects as they were found, but for the last, which starts at its example.

    On the side of neutral on which it was found.
    """
    *others, last = one.effects
    for name in others:
        model = model.with_effect(name, **one.fit.state.model.effects[name])
    switch = next((each for each in catalogue[last].parameters if each.vanishes), None)
    found = 0.0 if switch is None else one.fit.state.model.effects[last][switch.name] - switch.neutral
    turned = [last] if switch is not None and found * (switch.example - switch.neutral) < 0.0 else []
    return with_examples(model, [last], catalogue, turned)


def switched_on_too(
    current: Candidate, model: Model, catalogue: Mapping[str, Effect], noise: float, progress: Callable[[str], None]
) -> Candidate | None:
    """The set with an effect more that has no parameter (loss of contact), fitted from the believed `model`.

    None where that, too, leaves more than noise. Such an effect is there or is not: where the last one found was fitted without
    it, it has bent so far to make up for it that no descent comes back.
    """
    fit, fitter = current.fit, current.fitter
    records = [replace(record, weight=None) for record in fitter.records]
    cost_limit = explaining(records, fit.state)
    for name, _ in switchable(fitter, fit.state, catalogue):
        progress(f"fitting {current.effects[-1]} with {name} from the believed machine")
        believed = _believed_but_last(current, model, catalogue).with_effect(name)
        wider, complete = model_fit(fitter.engine, records, believed, catalogue, cost_limit=cost_limit)
        if complete.cost > cost_limit:
            continue
        found = candidate_of(wider, complete, (*current.effects, name), None, 1.0)
        if found.error_where_known <= ADEQUATE * noise:
            return found
    return None


def _better(found: Candidate, before: WaveformFit, after: WaveformFit, noise: float) -> bool:
    """Whether the new fit is to be believed: of models that leave much, the deeper valley need not be the truer one."""
    if found.error_held_out <= ADEQUATE * noise:
        return after.cost < before.cost - 0.5 * DELTA_BIC * after.variance
    return after.cost <= MUCH_CHEAPER * before.cost
