"""What a diagnosis is: the candidates tried, the verdict, a sentence a machinist understands, and the answer in JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from testbed.analysis.fit.held_out import RecordError, pooled_doubt
from testbed.analysis.search.candidate import ADEQUATE, Candidate, Tried
from testbed.analysis.search.next_test import NextTest
from testbed.machine import Model

FAINT_REST = 1.05  # error over noise floor up to which what no effect lowers is no claim that something is missing
SURE = 2.0  # standard errors of the noise floor by which that is widened: a floor from a short idle is a few per cent off
CERTAIN = 100.0  # gain in BIC from which an effect is there although the error is that of the noise: no chance gives that
COMPLETE = 1.15  # error over noise floor above which something is still missing
FORETOLD = 1.0 / 3.0  # share of what an effect explains in the fit that it must explain held out: its own doubt takes less
EXPLAINED = 0.99  # share of the excess that one effect must take away where more is left: else the law is unknown
MOSTLY = 0.9  # share of it that they must take away where more is left than noise may be: a known law does, if it is the one
MANY = 3  # effects from which they must leave no more than ADEQUATE: a law of no catalogue is soon made up of several known
NOTHING = 2.0  # error from which a prediction foretells nothing
SILENT = 0.95  # noise over what was measured from which records say nothing
PARTIAL = 0.5  # share of the excess from which effects are told although something of another kind remains


@dataclass(frozen=True)
class OtherForm:
    """The exponent of an effect's law, as the law has it and as the records do, with its 95 % interval and the gain in BIC.

    left: error over noise floor, in the fit. parameters: the effect's values, as a model file may say them. needless: effects
    named beside it that are not needed with that exponent. fitted: with that exponent.
    """

    effect: str
    stated: float
    value: float
    low: float
    high: float
    delta_bic: float
    left: float
    parameters: Mapping[str, float]
    needless: tuple[str, ...] = ()
    fitted: Candidate | None = field(default=None, repr=False, compare=False)

    @property
    def sentence(self) -> str:
        """In words."""
        doing = f" and makes {' and '.join(self.needless)} needless" if self.needless else ""
        return (f"The law itself is another: in {self.effect} an exponent of {self.value:.2f} ({self.low:.2f} to "
                f"{self.high:.2f}) explains the records better than its {self.stated:g} (gain in BIC {self.delta_bic:.0f}; "
                f"{self.left:.2f} times the noise floor is left){doing}. No effect of the catalogue has that law.")

    def as_json(self) -> dict[str, Any]:
        """As `testbed diagnose --json` tells it (contract)."""
        told = asdict(replace(self, fitted=None))
        del told["fitted"]
        return told


@dataclass(frozen=True)
class Diagnosis:
    """The verdict and the numbers behind it. form: another one of a named effect's law, where that explains more.

    misstated: a condition that was written down wrongly in all records, and the true one over that (of flutes, their number; 1
    where it is no factor). mode: one that the structure lacks, as a model file has it.
    """

    verdict: str
    effects: tuple[str, ...]
    sentence: str
    baseline: float
    with_effects: float
    noise_floor: float
    candidates: tuple[Tried, ...]
    base: Tried
    best: Tried
    steps: tuple[Tried, ...] = field(default_factory=tuple)
    next_test: NextTest | None = None
    separates: tuple[str, ...] = ()
    form: OtherForm | None = None
    misstated: tuple[str, float] | None = None
    mode: str | None = None

    @property
    def held_out(self) -> bool:
        """Whether the errors are on records left out of the fit: not where there is one operating condition only."""
        return self.base.held_out

    @property
    def best_fit(self) -> Candidate:
        """The best set, of a search that was made. RuntimeError where not even the believed model was fitted."""
        if not isinstance(self.best, Candidate):
            raise RuntimeError("no model was fitted")
        return self.best

    @property
    def fitted(self) -> list[Candidate]:
        """The sets that were fitted, in the order of `candidates`."""
        return [one for one in self.candidates if isinstance(one, Candidate)]

    @property
    def ruled_out(self) -> list[str]:
        """Names of the effects that a first step ruled out whenever they were tried, each once."""
        last = {one.effects[-1] for one in self.fitted if one.effects}
        names = dict.fromkeys(one.effects[-1] for one in self.candidates if one.effects)
        return [name for name in names if name not in last]


def judged_on(held_out: bool) -> str:
    """In words, what an error is measured on."""
    return "on records left out of the fit" if held_out else "in the fit (one condition only, nothing held out)"


def unaided(model: Model) -> str:
    """What the step before anything is added is called: the believed model, refitted."""
    return f"refitted, with {' + '.join(model.effects)}" if model.effects else "refitted, no effect"


def excess(error: float, noise: float) -> float:
    """Squared error beyond the noise's."""
    return max(error**2 - noise**2, 0.0)


def highest_floor(noise: float, errors: Sequence[RecordError]) -> float:
    """The noise floor as high as it may be, as well as the records' own samples tell it."""
    return noise * (1.0 + SURE * pooled_doubt(errors))


def beyond_chance(one: Tried, base: Tried) -> bool:
    """Whether a set is likelier than another beyond chance, and foretells no worse what was left out of the fit."""
    return one.delta_bic > CERTAIN and one.error_where_known < base.error_where_known


def certain(one: Candidate, base: Candidate) -> bool:
    """Whether a set is better beyond chance, and foretells as well as it explains: what is really there does."""
    foretold = base.error_where_known**2 - one.error_where_known**2
    return beyond_chance(one, base) and foretold > FORETOLD * (base.error_fit**2 - one.error_fit**2)


def verdict_of(
    base: Candidate,
    best: Candidate,
    steps: Sequence[Candidate],
    tries: tuple[Tried, ...],
    noise: float,
    tied: tuple[str, ...],
) -> Diagnosis:
    """The verdict on the best set of effects found, after all steps."""

    def answer(verdict: str, effects: tuple[str, ...], sentence: str) -> Diagnosis:
        return Diagnosis(
            verdict, effects, sentence, base.error_held_out, best.error_held_out, noise, tries, base, best, tuple(steps)
        )

    if not best.effects and (told := _of_the_base(base, noise)) is not None:
        return answer(told[0], (), told[1])
    ratio = base.error_where_known / noise
    share = 1.0 - excess(best.error_where_known, noise) / max(excess(base.error_held_out, noise), 1e-300)
    left = best.error_where_known / noise
    if tied and tied[0] in best.effects and (left <= COMPLETE or share >= EXPLAINED):
        beside = [name for name in best.effects if name not in tied]
        return answer(
            "undecided",
            tied,
            f"Something is missing, and {' and '.join(tied)} explain it equally well{_with(beside)}: these records cannot "
            "tell them apart.",
        )
    many = len(best.effects) >= MANY
    # of a little that is left, what takes a part of it is no name for it, unless the rest may be noise
    as_noise = certain(best, base) and best.error_where_known <= highest_floor(noise, base.errors)
    helps = left <= ADEQUATE or share >= PARTIAL or as_noise
    faint = FAINT_REST + SURE * pooled_doubt(base.errors)
    single = len(best.effects) == 1  # of several that leave much, a law of no catalogue may be made up
    complete = left <= COMPLETE and (left <= faint or share >= MOSTLY) or share >= EXPLAINED and single
    if best.effects and helps and (left <= ADEQUATE if many else complete):
        return answer(
            "missing_effect",
            best.effects,
            f"The model lacks {' and '.join(best.effects)}: the error {_fall(base, best)}.{_besides(base, best, noise, tied)}",
        )
    if ratio <= faint and not (best.effects and helps):
        return answer(
            "adequate",
            (),
            f"The error is {ratio:.3f} of the noise floor and no known effect lowers it: nothing "
            "is missing that these records could show.",
        )
    if best.effects and share >= PARTIAL:
        return answer(
            "unexplained",
            best.effects,
            f"{' and '.join(best.effects)}{_or(tied, best.effects)} would take away {_told_share(share)} of what is "
            f"unexplained, but the error is still {left:.3g} times the noise floor: something is missing that no effect of "
            "the catalogue explains.",
        )
    return answer(
        "unexplained",
        (),
        f"Something is missing (error {ratio:.3g} times the noise floor) that no effect of the catalogue explains.",
    )


def never_nothing(found: Diagnosis) -> Diagnosis:
    """The diagnosis, but "undecided" for "adequate" where an effect is certain although no gate let it pass."""
    names = [one.effects[0] for one in found.candidates if len(one.effects) == 1 and beyond_chance(one, found.base)]
    if found.verdict != "adequate" or not names:
        return found
    gain = max(one.delta_bic for one in found.candidates if one.effects == (names[0],))
    lower = f"{' and '.join(names)} {'lower' if len(names) > 1 else 'lowers'}"
    return replace(found, verdict="undecided", effects=tuple(names), sentence=(
        f"The error is {found.base.error_where_known / found.noise_floor:.3f} of the noise floor, and yet {lower} it beyond "
        f"chance (gain in BIC {gain:.0f}; chance gives less than 10). Most of what is beyond the noise stays: something small "
        "is missing, and these records cannot tell what."))


def told_of_base(found: Diagnosis) -> Diagnosis:
    """The diagnosis; where the model as it is is adequate, with that alone, not with a set of effects that is not named."""
    if found.verdict != "adequate" or not found.best.effects:
        return found
    return replace(found, with_effects=found.baseline, best=found.base, steps=found.steps[:1])


def _of_the_base(base: Candidate, noise: float) -> tuple[str, str] | None:
    """(verdict, sentence) where nothing is named and the base model's fit alone decides; None where it does not."""
    ratio = base.error_where_known / noise
    share = max(noise, noise_share(base))
    if share > SILENT:
        return "undecided", (f"Hardly anything but noise was measured ({share:.0%} of the signal): these records can tell "
                             "nothing of the model.")
    if ratio <= ADEQUATE:
        return "adequate", (f"The model explains the records down to their noise (error {ratio:.3f} of the "
                            "noise floor): nothing is missing that these records could show.")
    if not base.converged:
        return "not_converged", ("The fit of the believed model did not settle, so nothing can be said of what "
                                 "it lacks: check the conditions and the starting values.")
    return None


def noise_share(base: Tried) -> float:
    """Noise over what was measured, rms, all records together, without what offset and drift explain; 0 without a fit."""
    if not isinstance(base, Candidate):
        return 0.0
    records = base.fitter.records
    measured = sum(float(np.sum(one.project(one.data) ** 2)) for one in records)
    return math.sqrt(sum(one.count * float(np.sum((one.noise / one.scale) ** 2)) for one in records) / max(measured, 1e-300))


def _with(beside: Sequence[str]) -> str:
    """In words, beside which other effects."""
    return f", each beside {' and '.join(beside)}" if beside else ""


def _or(tied: Sequence[str], named: Sequence[str]) -> str:
    """In words, what explains as much as the first of the effects named."""
    others = [name for name in tied if name not in named]
    return f" (or {' or '.join(others)} in place of {tied[0]})" if others else ""


def _fall(base: Candidate, best: Candidate) -> str:
    """In words, from where the error falls to where: held out or, if one condition alone shows what is missing, in the fit."""
    held = best.error_held_out < base.error_held_out
    before, after = (base.error_held_out, best.error_held_out) if held else (base.error_fit, best.error_fit)
    return f"{judged_on(base.held_out) if held else 'in the fit'} falls from {_told(before)} to {after:.3g}"


def _told(error: float) -> str:
    """An error in words: a prediction that is worse than none at all may be so by any number."""
    return f"{error:.3g}" if error <= NOTHING else "more than the motion itself"


def _told_share(share: float) -> str:
    """A share in words: what leaves something is never told as all."""
    return f"{share:.0%}" if share < EXPLAINED else f"{min(share, 0.999):.1%}"


def _besides(base: Candidate, best: Candidate, noise: float, tied: tuple[str, ...]) -> str:
    """What is to be said beside the effects that are named, each sentence with a space before it."""
    left = best.error_where_known / noise
    if left > COMPLETE and not tied:
        return f" Something more remains: the error is still {left:.2f} times the noise floor."
    rest = f" A further effect is one of {', '.join(tied)}, which these records cannot tell apart." if tied else ""
    if base.error_where_known <= ADEQUATE * noise:
        rest += f" It is faint (a gain in BIC of {best.delta_bic:.0f} all the same: chance gives less than 10)."
    elif left <= COMPLETE and best.error_held_out > COMPLETE * noise:
        rest += " What one condition alone shows is explained in the fit; the others cannot foretell it."
    return rest
