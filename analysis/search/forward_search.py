"""Forward from a set of effects: the strongest candidate that passes both gates is added, then again, until nothing is left.

Every larger set must be worth its name on held-out conditions and by BIC; a smaller set that a larger one shows to have been
in a local minimum is fitted again, and what later effects made needless is taken out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbed.analysis.fit.budget import BudgetSpent
from testbed.analysis.fit.effect_start import ANCHOR, Origin, is_required, origins_of, state_without
from testbed.analysis.fit.evidence import effective_size
from testbed.analysis.fit.fine_steps import has_kinks
from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.force_jumps import at_its_jumps
from testbed.analysis.fit.fractional_passes import as_believed, with_parts_of_passes
from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.record_hypotheses import asked_again
from testbed.analysis.fit.starts import alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.candidate_round import by_noise, candidate_of, certain_candidates, try_candidates
from testbed.analysis.search.diagnosis import ADEQUATE, CERTAIN, COMPLETE, Candidate, OtherForm
from testbed.analysis.search.final_fit import fitted_anew, settled, without
from testbed.analysis.search.gates import against, below_a_guess, certain_ones, passing_gates, vanishes
from testbed.analysis.search.law_form import FormsAsked
from testbed.analysis.search.mains import hum_of
from testbed.analysis.search.prior_screening import PriorScreening
from testbed.analysis.search.refit_from_prior import refit_from_prior, switched_on_too
from testbed.analysis.search.swap import exchanged
from testbed.analysis.search.ties import tied_with, with_rivals
from testbed.effect import Effect
from testbed.machine import Model

HOPEFUL = 2.0  # error over noise floor above which the last effect that may be added is not: too much would still be missing
COARSE = 1.06  # error over noise floor up to which what a law with kinks leaves may be the error of the steps
SEARCHED = 10  # iterations from a set settled with finer steps to the same with those of the search
NEARLY = 100.0  # in BIC, by which a short fit without an effect may be worse, to be followed to its end
ROUGH = 8.0  # error over noise floor from which records are weighed by what is left of them,
STILL_ROUGH = 3.0  # and, once they were, from which they still are: else the quiet records take over half way


@dataclass(frozen=True)
class SelectionTrace:
    """A search from its first step to its last. tied: effects that the data cannot tell apart, where that ended it.

    hum: in words, the line of the mains that is all it found last. form: a law of no catalogue, where finding it ended it.
    """

    steps: tuple[Candidate, ...]
    seen: tuple[Candidate, ...]
    tied: tuple[str, ...]
    hum: str = ""
    form: OtherForm | None = None

    @property
    def end(self) -> Candidate:
        """The set of effects that the search ended with."""
        return self.steps[-1]


def _weighed(current: Candidate) -> Candidate:
    """The current set with records weighed by what it leaves of them, where that is far more than noise; else by the noise.

    A model that is rough everywhere would otherwise be fitted to the quietest record alone, and candidates with it.
    """
    assert current.fit is not None and current.fitter is not None
    records = current.fitter.records
    plain = all(record.weight is None for record in records)
    rough = current.error_held_out > (ROUGH if plain else STILL_ROUGH) * pooled(current.errors)[1]
    if not rough and plain:
        return current
    weighed = []
    for record, rest in zip(records, current.fit.residuals, strict=True):
        left = np.sqrt(np.mean((rest.reshape(len(record.channels), -1) * record.scale[:, None]) ** 2, axis=1))
        weighed.append(replace(record, weight=np.hypot(record.noise, left) if rough else None))
    fitter = current.fitter.on(weighed)
    fit = alternate_fit_and_passes(fitter, current.fit.state, rounds=2, iterations=20)
    if not rough:
        fit = with_parts_of_passes(fitter, fit)  # such weights hid what a cut that begins within an arc leaves
    return replace(candidate_of(fitter, fit, current.effects, None, 1.0), delta_bic=current.delta_bic)


def _at_its_jumps(one: Candidate) -> Candidate:
    """The set with the samples left out at the jumps of a force where its own fit, not that of a smaller set, places them."""
    assert one.fit is not None and one.fitter is not None
    return fitted_anew(one, *at_its_jumps(one.fitter, one.fit))


def _with_finer_steps(
    one: Candidate, noise: float, catalogue: Mapping[str, Effect], progress: Callable[[str], None]
) -> Candidate | None:
    """The set settled with finer steps, if what it leaves may be but the error of the search's own; else None."""
    if not ADEQUATE * noise < one.error_held_out < COARSE * noise or not has_kinks(one.effects, catalogue):
        return None
    progress("taking finer steps")
    return settled(by_noise(one), catalogue)


def _nesting_guard(current: Candidate, tried: Sequence[Candidate], catalogue: Mapping[str, Effect]) -> Candidate:
    """The current set refitted from where the best larger set ended: a local minimum must not pass for missing physics."""
    assert current.fit is not None and current.fitter is not None
    best = current
    for one in sorted((one for one in tried if one.fit is not None), key=lambda one: one.error_fit)[:2]:
        for fit in _nested(current.fitter, one, catalogue):
            assert best.fit is not None
            if fit.cost < best.fit.cost * (1.0 - 1e-4):
                best = candidate_of(current.fitter, fit, current.effects, best.fit, effective_size(fit))
    return best


def _nested(fitter: Fitter, larger: Candidate, catalogue: Mapping[str, Effect]) -> list[WaveformFit]:
    """Fits begun where a larger set ended, without its last effect.

    A gradual entry has places of first touch, too: they may be all that it was good for, in cuts that begin within an arc.
    """
    assert larger.fit is not None
    state, name = larger.fit.state, larger.effects[-1]
    found = [fitter.fit(state_without(state, name, catalogue), iterations=12)]
    if "engagement" in catalogue[name].hooks and not fitter.gradual:
        sudden = state.without_effect(name).with_sudden_entries(fitter.records)
        begun = fitter.fit(sudden, iterations=12)
        in_arc = any(own.ends_in_arc() for own in begun.state.nuisances)
        parts = as_believed(fitter, begun) if in_arc else begun
        found += [] if parts is None else [parts]
    return found


def _backward(current: Candidate, catalogue: Mapping[str, Effect], progress: Callable[[str], None]) -> Candidate:
    """The set without every effect that the later ones made needless: refitted without it, the BIC is no worse."""
    for name in current.effects[:-1]:
        if is_required(name, current.effects, catalogue):
            continue
        progress(f"is {name} still needed?")
        current = without(current, name, catalogue, NEARLY) or current
    return current


def _faint(steps: Sequence[Candidate], model: Model, catalogue: Mapping[str, Effect], noise: float,
           progress: Callable[[str], None]) -> SelectionTrace:  # fmt: skip
    """The search from a set that leaves but noise: an effect more that is certain and takes most of the rest, or none."""
    end = steps[-1]
    if end.effects and below_a_guess(end, noise):
        return SelectionTrace(tuple(steps), (), ())
    current = _with_search_steps(end, steps[0], noise)
    assert current.fit is not None and current.fitter is not None
    origins = origins_of(current.fitter.engine, model, current.fitter, current.fit, anchored=False)
    found = certain_candidates(current, catalogue, origins, progress)
    seen = tuple(map(_told, found))
    hum = next(filter(None, (hum_of(one, current, catalogue) for one in certain_ones(found, current, steps[0], noise))), "")
    found = [one for one in found if not hum_of(one, current, catalogue)] if hum else found
    refitted = _nesting_guard(current, certain_ones(found, current, steps[0], noise), catalogue)
    if refitted is not current:  # the set itself, begun where an effect more ended, explains as much without it
        refitted = replace(refitted, delta_bic=current.delta_bic)
        found = sorted((against(one, refitted) for one in found), key=lambda one: -one.delta_bic)
        end = refitted if current is end else settled(refitted, catalogue)
        current, steps = refitted, [*steps[:-1], end]
        seen = tuple(map(_told, found))
    passing = [one for one in certain_ones(found, current, steps[0], noise) if not vanishes(one, catalogue)]
    tied = tuple(one.effects[-1] for one in passing if tied_with(passing[0], one, current, noise))  # the first with itself
    if not passing or (len(tied) > 1 and current.effects):  # which of them it is, so faint, is not asked beside what is known
        return SelectionTrace(tuple(steps), seen, (), hum)
    best = settled(_asked_again(passing[0]), catalogue)
    if current is not end:  # it may have made up for the error of the steps
        best = against(best, end)
        if best.delta_bic <= CERTAIN or best.error_where_known >= end.error_where_known:
            return SelectionTrace(tuple(steps), seen, (), hum)
    return SelectionTrace((*steps, best), seen, tied if len(tied) > 1 else (), hum)


def _known(begun: Sequence[Candidate], model: Model, catalogue: Mapping[str, Effect], noise: float,
           progress: Callable[[str], None]) -> SelectionTrace | None:  # fmt: skip
    """The search from a model without effects that leaves but noise in the fit; None where it is to be gone on with.

    Where a wrong law shows only in a record that the others are to foretell, effects are looked for by that if none is certain.
    """
    base, current = begun[0], begun[-1]
    if min(current.error_where_known, current.error_fit) > ADEQUATE * noise:
        return None
    faint = _faint([base], model, catalogue, noise, progress)
    return faint if current.error_where_known <= ADEQUATE * noise or faint.end.effects else None


def _with_faint(path: SelectionTrace, model: Model, catalogue: Mapping[str, Effect], most: int, noise: float,
                progress: Callable[[str], None]) -> SelectionTrace:  # fmt: skip
    """The path and, where it leaves but noise, an effect more that is certain."""
    end = path.end
    if path.tied or not end.effects or len(end.effects) >= most or end.error_where_known > ADEQUATE * noise:
        return path
    faint = _faint(path.steps, model, catalogue, noise, progress)
    return replace(faint, seen=(*path.seen, *faint.seen))


def _with_search_steps(one: Candidate, base: Candidate, noise: float) -> Candidate:
    """A set that was settled with finer steps, fitted with those of the search again, where they too leave but noise."""
    assert one.fit is not None and one.fitter is not None and base.fitter is not None
    if one.fitter.engine is base.fitter.engine:
        return one
    fitter = Fitter(base.fitter.engine, one.fitter.records, one.fitter.unknowns)
    found = candidate_of(fitter, fitter.fit(one.fit.state, iterations=SEARCHED), one.effects, None, 1.0)
    return replace(found, delta_bic=one.delta_bic) if found.error_held_out <= ADEQUATE * noise else one


def _told(one: Candidate) -> Candidate:
    """A candidate as it is told: without the slopes of its fit, which fill much memory and serve its round alone."""
    return one if one.fit is None else replace(one, fit=replace(one.fit, parts=()))


def _origins(current: Candidate, model: Model, noise: float) -> list[Origin]:
    """Where the candidates of a round start; from the small-amplitude structure, too, where the base model is bad."""
    assert current.fit is not None and current.fitter is not None
    anchored = not current.effects and current.error_held_out > ANCHOR * noise
    return origins_of(current.fitter.engine, model, current.fitter, current.fit, anchored)


def _switched(current: Candidate, model: Model, catalogue: Mapping[str, Effect], noise: float, most: int,
              progress: Callable[[str], None]) -> Candidate | None:  # fmt: skip
    """The set completed by an effect that is there or is not (loss of contact); None where nothing is left, or still is."""
    if len(current.effects) >= most or current.error_where_known <= ADEQUATE * noise:
        return None
    more = switched_on_too(current, model, catalogue, noise, progress)
    return None if more is None else against(more, by_noise(current))


def _round(current: Candidate, model: Model, catalogue: Mapping[str, Effect], noise: float, progress: Callable[[str], None],
           final: bool, look: PriorScreening | None, forms: FormsAsked) -> tuple[Candidate, list[Candidate]]:  # fmt: skip
    """The current set, refitted where a larger one shows a deeper valley of it, and the candidates that extend it by one."""
    alone = look.alone if look is not None and not current.effects else tuple

    def of_other_law(one: Candidate) -> bool:
        return not current.effects and forms.steeper([by_noise(one)], []) is not None

    last = try_candidates(current, catalogue, _origins(current, model, noise), progress, final, alone, of_other_law)
    refitted = _nesting_guard(current, last, catalogue)
    return refitted, last if refitted is current else [against(one, refitted) for one in last]


def _named(first: Candidate, model: Model, catalogue: Mapping[str, Effect], noise: float, progress: Callable[[str], None],
           look: PriorScreening | None) -> Candidate:  # fmt: skip
    """The candidate that is named, as the next round finds it: begun anew, unless it is from the believed machine already."""
    if look is None or not look.gave(first.effects):
        first = refit_from_prior(first, model, catalogue, noise, progress)
    return _weighed(_with_parts(_asked_again(_at_its_jumps(_backward(first, catalogue, progress))), noise))


def _first_form(asked: Sequence[Candidate], tried: Sequence[Candidate], before: Candidate, noise: float, forms: FormsAsked
                ) -> OtherForm | None:  # fmt: skip
    """After the first round, another form of the law of an effect, where that explains what none of those tried does."""
    if before.effects or any(one.error_where_known <= ADEQUATE * noise for one in tried):
        return None
    sets = [by_noise(one) for one in tried if one.fit is not None]
    return forms.steeper(sets if asked is tried else [by_noise(one) for one in asked], sets)


def _asked_again(one: Candidate) -> Candidate:
    """The set with what of the records explains more, with these effects, otherwise than taken; see `record_hypotheses`."""
    assert one.fit is not None and one.fitter is not None
    return fitted_anew(one, *asked_again(one.fitter, one.fit))


def _with_parts(one: Candidate, noise: float) -> Candidate:
    """The set, where it leaves more than noise, with cuts that begin or end within an arc looked for again."""
    assert one.fit is not None and one.fitter is not None
    if one.error_held_out <= ADEQUATE * noise:
        return one
    return fitted_anew(one, one.fitter, with_parts_of_passes(one.fitter, one.fit))


def forward(begun: Sequence[Candidate], model: Model, catalogue: Mapping[str, Effect], most: int,
            progress: Callable[[str], None], look: PriorScreening | None = None) -> SelectionTrace:  # fmt: skip
    """Rounds of candidates from the last of the steps `begun` (the first: the base model), until there are `most` effects.

    look: at the believed machine, for the first round. BudgetSpent carries what was found until then.
    """
    steps, seen = list(begun), list[Candidate]()
    try:
        return _forward(steps, seen, model, catalogue, most, progress, look)
    except BudgetSpent as spent:
        spent.steps, spent.seen = tuple(steps), tuple(seen)
        raise


def _forward(steps: list[Candidate], seen: list[Candidate], model: Model, catalogue: Mapping[str, Effect], most: int,
             progress: Callable[[str], None], look: PriorScreening | None) -> SelectionTrace:  # fmt: skip
    """The same from the steps, which grow, as do the candidates `seen`."""
    base, current = steps[0], steps[-1]
    noise = pooled(base.errors)[1]
    if not current.effects and (known := _known(steps, model, catalogue, noise, progress)) is not None:
        return known
    tied: tuple[str, ...] = ()
    rivals: list[Candidate] = []
    fine: tuple[Candidate, Candidate] | None = None  # a set, and the same with finer steps
    forms, form = FormsAsked(catalogue, progress), None
    believed = base  # as it was fitted to the noise, or by the nesting guard: with this the fall of the error is told
    current = steps[-1] = _weighed(current)
    base = base if current.effects else current
    while len(current.effects) < most and current.error_where_known > ADEQUATE * noise:
        final = most > 1 and len(current.effects) == most - 1
        refitted, last = _round(current, model, catalogue, noise, progress, final, look if most > 1 else None, forms)
        if refitted is not current:
            current = steps[-1] = refitted
            if not refitted.effects:
                base = believed = refitted
            if current.error_where_known <= ADEQUATE * noise:
                break
        seen += map(_told, last)
        passing = passing_gates(last, current, base, noise, catalogue)
        form = _first_form(last, last, current, noise, forms)
        if form is not None or not passing:
            break
        first = passing[0]
        if final and first.error_where_known > HOPEFUL * noise:
            break
        equal = [one for one in passing[1:] if tied_with(first, one, current, noise)]
        if equal and (current.effects or first.error_where_known <= COMPLETE * noise):
            tied = (first.effects[-1], *(one.effects[-1] for one in equal))
            if not current.effects:
                current = first
                steps.append(first)
            break
        if equal and not rivals:  # what else is missing may tell them apart
            rivals = [first, *equal]
        current = _named(first, model, catalogue, noise, progress, look)
        steps.append(current)
        if current is not first:  # begun anew, its law is asked once more
            seen[:] = [*(one for one in seen if one.effects != current.effects), _told(current)]
            if (form := _first_form([current], last, steps[-2], noise, forms)) is not None:
                break
        finer = _with_finer_steps(current, noise, catalogue, progress)
        fine = None if finer is None else (current, finer)
        if finer is not None and finer.error_held_out <= ADEQUATE * noise:
            break
        completed = _switched(current, model, catalogue, noise, most, progress)
        if completed is not None:
            current = completed
            steps.append(current)
            seen.append(_told(current))
    if form is not None or not current.effects:
        return SelectionTrace((by_noise(believed), *map(by_noise, steps[1:])), tuple(seen), (), form=form)
    current = _weighed(current)
    if not tied:
        instead, tied = exchanged(current, base, model, catalogue, noise, progress)
        if instead is not current:
            current = steps[-1] = instead
            seen.append(_told(instead))
    end = fine[1] if fine is not None and fine[0] is current else settled(by_noise(current), catalogue)
    path = _ended([believed, *steps[1:-1], end], seen, tied, rivals, noise, catalogue, progress)
    return _with_faint(path, model, catalogue, most, noise, progress)


def _ended(
    steps: Sequence[Candidate], seen: Sequence[Candidate], tied: tuple[str, ...], rivals: Sequence[Candidate], noise: float,
    catalogue: Mapping[str, Effect], progress: Callable[[str], None],
) -> SelectionTrace:  # fmt: skip
    """The path of these steps as it is told: fits in units of the noise, and rivals of the first effect tried in the last set.

    A last set of which settling has left nothing is the base model.
    """
    end = steps[-1]
    told = [*map(by_noise, steps[:-1]), end] if end.effects else [by_noise(steps[0])]
    if end.effects and rivals and not tied:
        end, tied = with_rivals(end, rivals, told[0], noise, catalogue, progress)
        told[-1] = end
    return SelectionTrace(tuple(told), tuple(_told(end) if one.effects == end.effects else one for one in seen), tied)
