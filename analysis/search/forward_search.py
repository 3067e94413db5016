"""Forward from a set of effects: the strongest candidate that passes both gates is added, then again, until nothing is left.

Every larger set must be worth its name on held-out conditions and by BIC; a smaller set that a larger one shows to have been
in a local minimum is fitted again, and what later effects made needless is taken out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from testbed.analysis.fit.budget import Budgeted, BudgetSpent
from testbed.analysis.fit.effect_start import ANCHOR, Origin, origins_of
from testbed.analysis.fit.fine_steps import has_kinks
from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.moves import NAMED, PARTS
from testbed.analysis.search.backward import backward, nesting_guard
from testbed.analysis.search.candidate import ADEQUATE, Candidate, Tried
from testbed.analysis.search.candidate_round import by_noise, try_candidates
from testbed.analysis.search.diagnosis import COMPLETE, OtherForm
from testbed.analysis.search.final_fit import settled, solved_on
from testbed.analysis.search.gates import against, passing_gates
from testbed.analysis.search.judged import foretells_little
from testbed.analysis.search.law_form import FormsAsked
from testbed.analysis.search.prior_screening import PriorScreening
from testbed.analysis.search.refit_from_prior import refit_from_prior, switched_on_too
from testbed.analysis.search.reweight import reweighted
from testbed.analysis.search.selection_trace import SelectionTrace, without_slopes
from testbed.analysis.search.swap import exchanged
from testbed.analysis.search.ties import tied_with, with_rivals
from testbed.analysis.search.weak_effects import of_a_base_that_fits, with_weak_effect
from testbed.effect import Effect
from testbed.machine import Model

HOPEFUL = 2.0  # error over noise floor above which the last effect that may be added is not: too much would still be missing
COARSE = 1.06  # error over noise floor up to which what a law with kinks leaves may be the error of the steps


def _with_finer_steps(
    one: Candidate, noise: float, catalogue: Mapping[str, Effect], progress: Callable[[str], None]
) -> Candidate | None:
    """The set settled with finer steps, if what it leaves may be but the error of the search's own; else None."""
    if not ADEQUATE * noise < one.error_held_out < COARSE * noise or not has_kinks(one.effects, catalogue):
        return None
    progress("taking finer steps")
    return settled(by_noise(one), catalogue)


def _origins(current: Candidate, model: Model, noise: float) -> list[Origin]:
    """Where the candidates of a round start; from the small-amplitude structure, too, where the base model is bad."""
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
           final: bool, look: PriorScreening | None, forms: FormsAsked) -> tuple[Candidate, list[Tried]]:  # fmt: skip
    """The current set, refitted where a larger one shows a deeper valley of it, and the candidates that extend it by one."""
    alone = look.alone if look is not None and not current.effects else tuple

    def of_other_law(one: Candidate) -> bool:
        return not current.effects and forms.steeper([by_noise(one)], []) is not None

    last = try_candidates(current, catalogue, _origins(current, model, noise), progress, final, alone, of_other_law)
    refitted = nesting_guard(current, last, catalogue)
    return refitted, last if refitted is current else [against(one, refitted) for one in last]


def _named(first: Candidate, model: Model, catalogue: Mapping[str, Effect], noise: float, progress: Callable[[str], None],
           look: PriorScreening | None) -> Candidate:  # fmt: skip
    """The candidate that is named, as the next round finds it: begun anew, unless it is from the believed machine already."""
    if look is None or not look.gave(first.effects):
        first = refit_from_prior(first, model, catalogue, noise, progress)
    found = solved_on(backward(first, catalogue, progress), NAMED)
    return reweighted(found if found.error_held_out <= ADEQUATE * noise else solved_on(found, PARTS))


def _first_form(asked: Sequence[Tried], tried: Sequence[Tried], before: Candidate, noise: float, forms: FormsAsked
                ) -> OtherForm | None:  # fmt: skip
    """After the first round, another form of the law of an effect, where that explains what none of those tried does."""
    if before.effects or any(one.error_where_known <= ADEQUATE * noise for one in tried):
        return None
    sets = [by_noise(one) for one in tried if isinstance(one, Candidate)]
    return forms.steeper(sets if asked is tried else [by_noise(one) for one in asked if isinstance(one, Candidate)], sets)


def forward(begun: Sequence[Candidate], model: Model, catalogue: Mapping[str, Effect], most: int,
            progress: Callable[[str], None], look: PriorScreening | None = None) -> SelectionTrace:  # fmt: skip
    """Rounds of candidates from the last of the steps `begun` (the first: the base model), until there are `most` effects.

    look: at the believed machine, for the first round. BudgetSpent carries what was found until then.
    """
    steps, seen = list(begun), list[Tried]()
    try:
        return _forward(steps, seen, model, catalogue, most, progress, look)
    except BudgetSpent as spent:
        spent.steps, spent.seen = tuple(steps), tuple(seen)
        raise


def _forward(steps: list[Candidate], seen: list[Tried], model: Model, catalogue: Mapping[str, Effect], most: int,
             progress: Callable[[str], None], look: PriorScreening | None) -> SelectionTrace:  # fmt: skip
    """The same from the steps, which grow, as do the candidates `seen`."""
    base, current = steps[0], steps[-1]
    noise = pooled(base.errors)[1]
    if not current.effects and (known := of_a_base_that_fits(steps, model, catalogue, noise, progress)) is not None:
        return known
    tied: tuple[str, ...] = ()
    rivals: list[Candidate] = []
    fine: tuple[Candidate, Candidate] | None = None  # a set, and the same with finer steps
    forms, form = FormsAsked(catalogue, progress), None
    believed = base  # as it was fitted to the noise, or by the nesting guard: with this the fall of the error is told
    current = steps[-1] = reweighted(current)
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
        seen += map(without_slopes, last)
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
        if not foretells_little(current) and isinstance(engine := current.fitter.engine, Budgeted):
            engine.allow_all()  # a search that began with a model of little worth has found what makes it one of some
        if current is not first:  # begun anew, its law is asked once more
            seen[:] = [*(one for one in seen if one.effects != current.effects), without_slopes(current)]
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
            seen.append(without_slopes(current))
    if form is not None or not current.effects:
        return SelectionTrace((by_noise(believed), *map(by_noise, steps[1:])), tuple(seen), (), form=form)
    current = reweighted(current)
    if not tied:
        instead, tied = exchanged(current, base, model, catalogue, noise, progress)
        if instead is not current:
            current = steps[-1] = instead
            seen.append(without_slopes(instead))
    end = fine[1] if fine is not None and fine[0] is current else settled(by_noise(current), catalogue)
    path = _ended([believed, *steps[1:-1], end], seen, tied, rivals, noise, catalogue, progress)
    return with_weak_effect(path, model, catalogue, most, noise, progress)


def _ended(
    steps: Sequence[Candidate], seen: Sequence[Tried], tied: tuple[str, ...], rivals: Sequence[Candidate], noise: float,
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
    return SelectionTrace(tuple(told), tuple(without_slopes(end) if one.effects == end.effects else one for one in seen), tied)
