"""Which physical effect does the believed model lack: none, one, several, or something that is not in the catalogue.

The base model is refitted to everything with every nuisance. If that leaves more than noise, every candidate is tried: a
first Gauss-Newton step ranks them (a score test with a look at the true cost), the leaders are refitted in full, scored on
held-out conditions and by BIC on the effective sample size, and the strongest that passes both gates is added; then again.
Where no first step leads to much, the believed machine is asked, which no base fit has bent. Where much is left in the end,
the search is repeated from the effect that alone explains most from there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from testbed.analysis.fit.budget import BUDGET, Budgeted, BudgetSpent
from testbed.analysis.fit.free_vibration_start import marks_show
from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.identifiable import Identifiable
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.spindle_speed import at_modelled_speed, rules_the_speed, speed_swing
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.candidate_round import by_noise, candidate_of
from testbed.analysis.search.chaos_check import followed, irregular
from testbed.analysis.search.common_factor import PLAINLY, explained_otherwise, instead_of, written_wrongly
from testbed.analysis.search.diagnosis import COMPLETE, Diagnosis, never_nothing, told_of_base, verdict_of
from testbed.analysis.search.forward_search import forward
from testbed.analysis.search.gates import against
from testbed.analysis.search.judged import as_far_as, foretells_little, of_a_machine, too_slow
from testbed.analysis.search.law_form import with_form_asked, with_other_form
from testbed.analysis.search.missing_mode import explains_more, missing_mode, with_mode
from testbed.analysis.search.misstated import contradicted
from testbed.analysis.search.modes_told import with_modes_told
from testbed.analysis.search.next_test import next_test
from testbed.analysis.search.odd_records import with_odd_records
from testbed.analysis.search.prior_screening import PriorScreening
from testbed.analysis.search.refit_from_prior import from_believed
from testbed.analysis.search.restart import restarted
from testbed.analysis.search.reweight import ROUGH
from testbed.analysis.search.sign_check import other_way
from testbed.analysis.search.ties import rivals_of
from testbed.effect import Effect
from testbed.machine import Model

LONG = 16384  # samples of an excited record that are searched
MOST_EFFECTS = 3
FEWEST = 3  # cuts whose entries are seen, from which the others may be left out
FEW_STEPS = 1_400  # of fits, that a search is worth which begins with a model that foretells little, or is not needed
OWN = 7  # simulations of a record that a step takes beside one for each unknown of the machine: for what it has for itself


def diagnose(
    engine: Engine,
    records: Sequence[Observed],
    model: Model,
    catalogue: Mapping[str, Effect],
    *,
    most: int = MOST_EFFECTS,
    progress: Callable[[str], None] = lambda text: None,
    budget: float = BUDGET,
    told: Identifiable | None = None,
) -> Diagnosis:
    """Name what the model lacks, `most` effects at the most. Deterministic: no random numbers are drawn.

    budget: simulations of every record, after which the search ends with what is known; none of time, so that it always ends
    at the same place. No verdict stands on values that no machine has. told: what the records tell of the model's parameters,
    if that is at hand.
    Long excited records are searched in their loudest part; the errors that are told are those of the whole records.
    Where marks show that the speed varies, that is an effect which a model at a constant speed lacks, if the catalogue has it;
    else what the marks show is no fault of the model's, and it is searched at the speed measured.
    """
    records = at_modelled_speed(records, model.effects, catalogue)
    counted = Budgeted(engine, records, budget, progress, told)
    try:
        found = of_a_machine(_at_its_speed(counted, records, model, catalogue, most, progress), model, catalogue)
        return with_modes_told(found, model, catalogue)
    except BudgetSpent as spent:
        return as_far_as(spent, counted, records, progress)


def _at_its_speed(engine: Budgeted, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect], most: int,
                  progress: Callable[[str], None]) -> Diagnosis:  # fmt: skip
    """The diagnosis at a constant speed, at the one that the marks show, or with an effect that rules it; see `diagnose`."""
    swing = speed_swing(records)
    if not swing:
        return _diagnosed(engine, records, model, catalogue, most, progress)
    steady = [record.at_constant_speed() for record in records]
    rulers = {name: one for name, one in catalogue.items() if rules_the_speed([name], catalogue)}
    others = {name: one for name, one in catalogue.items() if name not in rulers}
    as_measured = f"The speed, which varies by {swing:.2%}, is the tachometer's."
    progress("at the speed that the tachometer shows")
    base = _as_believed(engine, records, model, catalogue, progress)
    engine.known = base
    measured, at_constant = base.error_where_known, None
    if measured <= COMPLETE * pooled(base.errors)[1]:
        progress("at a constant speed")
        at_constant = _as_believed(engine, steady, model, catalogue, progress)
        if not _complete(_search(at_constant, engine, model, rulers, 1, progress)):
            found = _diagnosed(engine, records, model, others, most, progress, base)
            return replace(found, sentence=f"{found.sentence} {as_measured}")
    constant = _diagnosed(engine, steady, model, catalogue, most, progress, at_constant)
    named = constant.verdict == "missing_effect" and rules_the_speed(constant.effects, catalogue)
    if named and (_complete(constant) or constant.best.error_where_known <= measured):
        return replace(constant, sentence=f"{constant.sentence} The tachometer, too, shows a speed that varies by {swing:.2%}.")
    progress("once more, at the speed that the tachometer shows")
    found = _diagnosed(engine, records, model, others, most, progress, base)
    return replace(found, sentence=f"{found.sentence} {as_measured}")


def _complete(found: Diagnosis) -> bool:
    """Whether effects are named that leave hardly more than noise."""
    return found.verdict == "missing_effect" and found.best.error_where_known <= COMPLETE * found.noise_floor


def _diagnosed(engine: Budgeted, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect], most: int,
               progress: Callable[[str], None], base: Candidate | None = None) -> Diagnosis:  # fmt: skip
    """The diagnosis of records as they are. base: the believed model fitted to them, where that is at hand."""
    parts = [record.loudest(LONG) for record in records]
    if all(part is record for part, record in zip(parts, records, strict=True)):
        base = base or _as_believed(engine, records, model, catalogue, progress)
        engine.known = engine.known or base
        noise = pooled(base.errors)[1]
        plain, clear = (base.error_where_known > times * noise for times in (PLAINLY, COMPLETE))
        added = missing_mode(base, model, progress)
        if added is not None and clear:  # it rings where nothing cuts, at a frequency of its own: no effect is like that
            return with_mode(verdict_of(base, base, [base], (), noise, ()), base, added, list(model.effects))
        restated = None if added is not None else explained_otherwise(base, model, catalogue, progress)
        if restated is not None and (plain or clear and restated[0].of_kind):
            return written_wrongly(verdict_of(base, base, [base], (), noise, ()), restated[0])
        if foretells_little(base) or restated is not None:  # little is to be found, or nothing need be
            engine.allow(FEW_STEPS * (OWN + len(base.fitter.free)))
        try:
            found, first = _without_irregular(base, engine, model, catalogue, most, progress)
            if found is None:
                found = _search(base, engine, model, catalogue, most, progress, first)
                found = _without_late(found, base, engine, model, catalogue, most, progress)
        except BudgetSpent as spent:
            if restated is None:
                raise
            found = as_far_as(spent, engine, records, progress)
        found = instead_of(found, restated)
        if added is not None and explains_more(added, found):
            found = with_mode(found, base, added, list(model.effects))
        found = _with_next_test(found, engine, records, progress)
        return told_of_base(with_odd_records(found, engine, model, catalogue, progress))
    found = _search(_as_believed(engine, parts, model, catalogue, progress), engine, model, catalogue, most, progress)
    progress("fitting the whole records")
    steps = [_on_whole(step, records) for step in found.steps if isinstance(step, Candidate)]
    noise = pooled(steps[0].errors)[1]
    tied = found.effects if found.verdict == "undecided" else ()
    told = verdict_of(steps[0], steps[-1], steps, found.candidates, noise, tied)
    return told_of_base(with_other_form(told, found.form))


def _without_irregular(base: Candidate, engine: Budgeted, model: Model, catalogue: Mapping[str, Effect], most: int,
                       progress: Callable[[str], None]) -> tuple[Diagnosis | None, Candidate | None]:  # fmt: skip
    """(the diagnosis of the records whose motion repeats, a set of effects with which a search on all begins), where the others
    make the base fit a rough one; None for what there is not.

    The diagnosis stands where by what it found, too, motions part in those others that it does not foretell, and where that is
    a law of no catalogue; the set is had where it foretells them all.
    """
    records = base.fitter.records
    places = irregular(records) if base.error_held_out > ROUGH * pooled(base.errors)[1] else []
    if not places:
        return None, None
    names = [records[place].name for place in places]
    progress(f"without {', '.join(names)}: no revolution is like the one before")
    kept = [record for place, record in enumerate(records) if place not in places]
    found = _search(_as_believed(engine, kept, model, catalogue, progress), engine, model, catalogue, most, progress)
    if not _complete(found) and found.form is None:
        return None, None
    best = by_noise(found.best_fit) if found.form is None or found.form.fitted is None else found.form.fitted
    progress(f"holding what was found against {', '.join(names)}")
    seen = followed(best.fitter, best.fit.state, records, places)
    strange = [records[place].name for place in seen.strange]
    if strange and seen.parting == seen.strange:
        return replace(found, sentence=f"{found.sentence} {_left_out(strange)}"), None
    if found.form is not None:
        return replace(found, sentence=f"{found.sentence} {_held_against(names, strange)}"), None
    return None, None if strange else against(candidate_of(seen.fitter, seen.fitted(), best.effects, None, 1.0), base)


def _without_late(found: Diagnosis, base: Candidate, engine: Budgeted, model: Model, catalogue: Mapping[str, Effect], most: int,
                  progress: Callable[[str], None]) -> Diagnosis:  # fmt: skip
    """The diagnosis begun with what those records say whose cutter's entry is seen, where the search on all leaves more.

    With which pass, and with what swing, the others began is unknown: a model that lacks much cannot tell, and is bent by them.
    """
    records = base.fitter.records
    late = [place for place, record in enumerate(records) if record.starts_in_cut and not record.forces_only]
    kept = [record for place, record in enumerate(records) if place not in late]
    searched = found.verdict in ("missing_effect", "unexplained") and bool(found.candidates) and found.form is None
    if not searched or _complete(found) or not late or sum(record.cut is not None for record in kept) < FEWEST:
        return found
    names = ", ".join(records[place].name for place in late)
    progress(f"without {names}: entered before its first sample")
    seen = _search(_as_believed(engine, kept, model, catalogue, progress), engine, model, catalogue, most, progress)
    if not (_complete(seen) or seen.verdict == "adequate"):
        return found
    best = by_noise(seen.best_fit)
    progress(f"holding what was found against {names}")
    whole = followed(best.fitter, best.fit.state, records, late)
    if whole.strange:
        return found
    begun = candidate_of(whole.fitter, whole.fitted(), best.effects, None, 1.0)
    if not best.effects:
        return _search(begun, engine, model, catalogue, most, progress)
    return _search(base, engine, model, catalogue, most, progress, against(begun, base))


def _held_against(names: Sequence[str], strange: Sequence[str]) -> str:
    """In words, what a law that was found on the other records says of these."""
    if strange:
        return f"Left out: {', '.join(strange)}. No revolution there is like the one before, and that law does not explain it."
    return f"Found without {', '.join(names)}, where no revolution is like the one before, it explains that, too."


def _left_out(names: Sequence[str]) -> str:
    """In words, that records were left out that no model foretells."""
    which, they = ("these records", "they are") if len(names) > 1 else ("this record", "it is")
    return (f"Left out: {', '.join(names)}. No revolution of {which} is like the one before, and by the model found, too, "
            f"motions that begin almost at one place part there: {they} chaotic, or close to it, and a fit may not follow.")


def _on_whole(step: Candidate, records: Sequence[Observed]) -> Candidate:
    """A step of the search on parts of the records, fitted to the whole ones."""
    kept = [whole.samples == seen.samples for whole, seen in zip(records, step.fitter.records, strict=True)]
    wider = [seen if as_it_was else whole for whole, seen, as_it_was in zip(records, step.fitter.records, kept, strict=True)]
    fitter = step.fitter.on(wider)
    own = tuple(seen if as_it_was else Nuisances() for seen, as_it_was in zip(step.fit.state.nuisances, kept, strict=True))
    fit = fitter.fit(replace(step.fit.state, nuisances=own), iterations=10)
    return replace(candidate_of(fitter, fit, step.effects, None, 1.0), delta_bic=step.delta_bic)


def _as_believed(engine: Budgeted, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect],
                 progress: Callable[[str], None]) -> Candidate:  # fmt: skip
    """The believed model fitted to records."""
    progress("fitting the believed model")
    return from_believed(engine, records, model, (), catalogue, told=engine.told)


def _search(
    base: Candidate,
    engine: Engine,
    model: Model,
    catalogue: Mapping[str, Effect],
    most: int,
    progress: Callable[[str], None],
    first: Candidate | None = None,
) -> Diagnosis:
    """The rounds of candidates from the base fit and, where much is left, from another beginning. first: a set found before."""
    noise = pooled(base.errors)[1]
    if slow := too_slow(base):
        return replace(verdict_of(base, base, [base], (), noise, ()), verdict="undecided", sentence=slow)
    if (told := contradicted(base, noise, progress)) is not None:
        return told
    if turned := other_way(base, model, catalogue):
        return replace(verdict_of(base, base, [base], (), noise, ()), verdict="unexplained", sentence=turned)
    begun = [base, *([first] if first is not None else _swung(base, engine, model, catalogue, progress))]
    look = PriorScreening(base, model, catalogue, progress)
    path = restarted(forward(begun, model, catalogue, most, progress, look), look, noise, most)
    seen = sorted(path.seen, key=lambda one: (not isinstance(one, Candidate), one.error_held_out, len(one.effects)))
    found = verdict_of(path.steps[0], path.end, path.steps, tuple(seen), noise, path.tied)
    found = with_other_form(found, path.form) if path.form is not None else with_form_asked(found, catalogue, progress)
    return replace(found, sentence=f"{found.sentence} {path.hum}") if path.hum else never_nothing(found)


def _swung(base: Candidate, engine: Engine, model: Model, catalogue: Mapping[str, Effect],
           progress: Callable[[str], None]) -> list[Candidate]:  # fmt: skip
    """The effect by which the speed swings as the marks show, if they show a swing, as the first step of the search."""
    records = base.fitter.records
    shown = [name for name, one in catalogue.items() if name not in model.effects and marks_show(one, records)]
    if not shown:
        return []
    progress(f"fitting with {shown[0]}, as the tachometer shows it")
    alone = against(from_believed(engine, records, model, shown[:1], catalogue), base)
    return [alone] if alone.error_held_out < base.error_held_out else []


def _with_next_test(
    result: Diagnosis, engine: Engine, records: Sequence[Observed], progress: Callable[[str], None]
) -> Diagnosis:
    """The diagnosis with the cut that separates the tied effects, or the named one from a runner-up that came close."""
    rivals = rivals_of(result)[:2]
    if len(rivals) < 2:
        return result
    first, other = rivals
    progress("looking for the cut that would tell more")
    found = next_test(engine, records, first.fit.state.model, other.fit.state.model)
    return replace(result, next_test=found, separates=(first.effects[-1], other.effects[-1]) if found else ())
