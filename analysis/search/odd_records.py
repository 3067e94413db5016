"""An unexplained campaign: do all records agree but a few, or each of them alone?"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from testbed.analysis.fit.prediction import Engine
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.candidate_round import by_noise
from testbed.analysis.search.diagnosis import Diagnosis, verdict_of
from testbed.analysis.search.homogeneity_check import each_alone, said_apart
from testbed.analysis.search.outlier_records import agreed
from testbed.effect import Effect
from testbed.machine import Model

MOST_LOOKED_AT = 5  # sets of effects that are fitted without the records that stand out


def with_odd_records(result: Diagnosis, engine: Engine, model: Model, catalogue: Mapping[str, Effect],
                      progress: Callable[[str], None]) -> Diagnosis:  # fmt: skip
    """An unexplained campaign's diagnosis with what all records but a few agree on, or what each has as its own."""
    if result.verdict not in ("unexplained", "not_converged") or not result.candidates or result.form is not None \
            or result.misstated is not None:
        return result  # nothing was searched, because what is wrong with the campaign is told; or a law explains all records
    told = _with_strange_records(result, progress) if result.verdict == "unexplained" else result
    return told if told is not result else _with_each_alone(result, engine, model, catalogue, progress)


def _with_each_alone(result: Diagnosis, engine: Engine, model: Model, catalogue: Mapping[str, Effect],
                     progress: Callable[[str], None]) -> Diagnosis:  # fmt: skip
    """The diagnosis that nothing is missing but one machine for all records, if each alone agrees with the model."""
    if not isinstance(result.base, Candidate):
        return result
    base = by_noise(result.base)
    progress("fitting each record alone")
    records = base.fitter.records
    apart = each_alone(engine, records, model, catalogue, base.fit.worst(len(records)))
    if not apart:
        return result
    alone = verdict_of(base, base, [base], result.candidates, result.noise_floor, ())
    left = base.error_where_known / result.noise_floor
    sentence = f"No one machine explains all records (error {left:.3g} times the noise floor). {said_apart(apart)}"
    return replace(alone, verdict="unexplained", sentence=sentence)


def _with_strange_records(result: Diagnosis, progress: Callable[[str], None]) -> Diagnosis:
    """The diagnosis with what all records but a few agree on, if there is such a thing."""
    progress("looking for records that stand alone")
    fitted = [one for one in (result.base, *result.candidates) if isinstance(one, Candidate)]
    best: dict[tuple[str, ...], Candidate] = {}
    for one in sorted(fitted, key=lambda one: (len(one.effects), one.error_fit)):
        best.setdefault(one.effects, one)
    for one in map(by_noise, [*best.values()][:MOST_LOOKED_AT]):
        fitter, _ = agreed(one.fitter, one.fit)
        strange = [record.name for record in fitter.records if not record.in_fit]
        if strange:
            return replace(result, sentence=f"{result.sentence} {_but(strange, one.effects)}")
    return result


def _but(strange: Sequence[str], effects: Sequence[str]) -> str:
    """In words, that all records but the strange ones agree with a model of these effects."""
    them = "them" if len(strange) > 1 else "it"
    model = f"a model with {' and '.join(effects)}" if effects else "the model as it is"
    return (f"All records but {', '.join(strange)} agree with {model} down to their noise: look at {them} first "
            f"(chaotic, disturbed, or alone in showing what is missing), or leave {them} out.")
