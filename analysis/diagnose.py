"""Which physical effect does the believed model lack: none, one, several, or something that is not in the catalogue.

The base model is refitted to everything with every nuisance. If that leaves more than noise, every candidate is tried: a
first Gauss-Newton step ranks them (a score test with a look at the true cost), the leaders are refitted in full, scored on
held-out conditions and by BIC on the effective sample size, and the strongest that passes both gates is added; then again.
Where much is left in the end, the search is repeated from the effect that alone explains most from the believed machine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from analysis.begun_anew import from_believed
from analysis.candidate_round import candidate_of
from analysis.diagnosis import COMPLETE, Candidate, Diagnosis, excess, verdict_of
from analysis.forward_search import against, by_noise, forward
from analysis.held_out import pooled
from analysis.model_fit import model_fit
from analysis.next_test import next_test
from analysis.nuisances import Nuisances
from analysis.observed import Observed
from analysis.prediction import Plant
from analysis.second_look import looked_again
from analysis.spindle_speed import at_modelled_speed, rules_the_speed, speed_swing
from analysis.swing_start import marks_show
from analysis.unheard import agreed
from analysis.waveform import Fitter
from testbed.effect import Effect
from testbed.machine import Model

LONG = 16384  # samples of an excited record that are searched
MOST_EFFECTS = 3
MOST_LOOKED_AT = 5  # sets of effects that are fitted without the records that stand out
CLOSE = 0.5  # share of the excess that a runner-up may leave and still be worth a test of its own


def diagnose(
    plant: Plant,
    records: Sequence[Observed],
    model: Model,
    catalogue: Mapping[str, Effect],
    *,
    most: int = MOST_EFFECTS,
    say: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """Name what the model lacks, `most` effects at the most. Deterministic: no random numbers are drawn.

    Long excited records are searched in their loudest part; the errors that are told are those of the whole records.
    Where marks show that the speed varies, that is an effect which a model at a constant speed lacks, if the catalogue has it;
    else what the marks show is no fault of the model's, and it is searched at the speed measured.
    """
    records = at_modelled_speed(records, model.effects, catalogue)
    swing = speed_swing(records)
    if not swing:
        return _diagnosed(plant, records, model, catalogue, most, say)
    constant = _diagnosed(plant, [record.at_constant_speed() for record in records], model, catalogue, most, say)
    named = constant.verdict == "missing_effect" and rules_the_speed(constant.effects, catalogue)
    said = replace(constant, sentence=f"{constant.sentence} The tachometer, too, shows a speed that varies by {swing:.2%}.")
    left = constant.best.error_where_known
    if named and left <= COMPLETE * constant.noise_floor:
        return said
    say("once more, at the speed that the tachometer shows")
    if named and left <= candidate_of(*model_fit(plant, records, model, catalogue), (), None, 1.0).error_where_known:
        return said
    others = {name: one for name, one in catalogue.items() if not rules_the_speed([name], catalogue)}
    found = _diagnosed(plant, records, model, others, most, say)
    return replace(found, sentence=f"{found.sentence} The speed, which varies by {swing:.2%}, is the tachometer's.")


def _diagnosed(plant: Plant, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect], most: int,
               say: Callable[[str], None]) -> Diagnosis:  # fmt: skip
    """The diagnosis of records as they are."""
    parts = [record.loudest(LONG) for record in records]
    if all(part is record for part, record in zip(parts, records, strict=True)):
        found = _search(plant, records, model, catalogue, most, say)
        return _with_strange_records(_with_next_test(found, plant, records, say), say)
    found = _search(plant, parts, model, catalogue, most, say)
    say("fitting the whole records")
    steps = [_on_whole(step, records) for step in found.steps]
    noise = pooled(steps[0].errors)[1]
    tied = found.effects if found.verdict == "undecided" else ()
    return verdict_of(steps[0], steps[-1], steps, found.candidates, noise, tied)


def _with_strange_records(result: Diagnosis, say: Callable[[str], None]) -> Diagnosis:
    """An unexplained campaign's diagnosis with what all records but a few agree on, if there is such a thing."""
    if result.verdict != "unexplained":
        return result
    say("looking for records that stand alone")
    fitted = [one for one in (result.base, *result.candidates) if one.fit is not None]
    best: dict[tuple[str, ...], Candidate] = {}
    for one in sorted(fitted, key=lambda one: (len(one.effects), one.error_fit)):
        best.setdefault(one.effects, one)
    for one in map(by_noise, [*best.values()][:MOST_LOOKED_AT]):
        assert one.fit is not None and one.fitter is not None
        fitter, _ = agreed(one.fitter, one.fit)
        strange = [record.name for record in fitter.records if not record.heard]
        if strange:
            return replace(result, sentence=f"{result.sentence} {_but(strange, one.effects)}")
    return result


def _but(strange: Sequence[str], effects: Sequence[str]) -> str:
    """In words, that all records but the strange ones agree with a model of these effects."""
    them = "them" if len(strange) > 1 else "it"
    model = f"a model with {' and '.join(effects)}" if effects else "the model as it is"
    return (f"All records but {', '.join(strange)} agree with {model} down to their noise: look at {them} first "
            f"(chaotic, disturbed, or alone in showing what is missing), or leave {them} out.")


def _on_whole(step: Candidate, records: Sequence[Observed]) -> Candidate:
    """A step of the search on parts of the records, fitted to the whole ones."""
    assert step.fitter is not None and step.fit is not None
    short = [whole.samples != part.samples for whole, part in zip(records, step.fitter.records, strict=True)]
    known = [whole if cut else part for whole, part, cut in zip(records, step.fitter.records, short, strict=True)]
    fitter = Fitter(step.fitter.plant, known, step.fitter.unknowns)
    own = tuple(Nuisances() if cut else seen for cut, seen in zip(short, step.fit.state.nuisances, strict=True))
    fit = fitter.fit(replace(step.fit.state, nuisances=own), iterations=10)
    return replace(candidate_of(fitter, fit, step.effects, None, 1.0), delta_bic=step.delta_bic)


def _search(
    plant: Plant,
    records: Sequence[Observed],
    model: Model,
    catalogue: Mapping[str, Effect],
    most: int,
    say: Callable[[str], None],
) -> Diagnosis:
    """The base fit, the rounds of candidates from it and, where much is left, from another beginning."""
    say("fitting the believed model")
    fitter, fit = model_fit(plant, records, model, catalogue)
    base = candidate_of(fitter, fit, (), None, 1.0)
    noise = pooled(base.errors)[1]
    begun = [base, *_swung(base, plant, model, catalogue, say)]
    path = looked_again(forward(begun, model, catalogue, most, say), model, catalogue, noise, most, say)
    seen = sorted(path.seen, key=lambda one: (one.fit is None, one.error_held_out, len(one.effects)))
    return verdict_of(path.steps[0], path.end, path.steps, tuple(seen), noise, path.tied)


def _swung(base: Candidate, plant: Plant, model: Model, catalogue: Mapping[str, Effect],
           say: Callable[[str], None]) -> list[Candidate]:  # fmt: skip
    """The effect by which the speed swings as the marks show, if they show a swing, as the first step of the search."""
    assert base.fitter is not None
    records = base.fitter.records
    shown = [name for name, one in catalogue.items() if name not in model.effects and marks_show(one, records)]
    if not shown:
        return []
    say(f"fitting with {shown[0]}, as the tachometer shows it")
    alone = against(from_believed(plant, records, model, shown[:1], catalogue), base)
    return [alone] if alone.error_held_out < base.error_held_out else []


def _with_next_test(
    result: Diagnosis, plant: Plant, records: Sequence[Observed], say: Callable[[str], None]
) -> Diagnosis:
    """The diagnosis with the cut that separates the tied effects, or the named one from a runner-up that came close."""
    rivals = [one for one in result.candidates if one.fit is not None and len(one.effects) == len(result.best.effects)]
    if result.verdict not in ("undecided", "missing_effect") or len(rivals) < 2:
        return result
    rivals.sort(key=lambda one: one.error_held_out)
    if result.verdict == "undecided":
        rivals = [one for one in rivals if one.effects[-1] in result.effects] or rivals
    before = excess(result.baseline, result.noise_floor)
    first, other = rivals[0], rivals[min(1, len(rivals) - 1)]
    if first is other or excess(other.error_held_out, result.noise_floor) > CLOSE * before:
        return result
    assert first.fit is not None and other.fit is not None
    say("looking for the cut that would tell more")
    found = next_test(plant, records, first.fit.state.model, other.fit.state.model)
    return replace(result, next_test=found, separates=(first.effects[-1], other.effects[-1]) if found else ())
