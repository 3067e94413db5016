"""The gates of a search: which candidates are worth a name beside what is named already, and which of them is the first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from testbed.analysis.fit.evidence import DELTA_BIC, bic, effective_size
from testbed.analysis.search.candidate import ADEQUATE, Candidate, Tried
from testbed.analysis.search.candidate_round import GAIN
from testbed.analysis.search.diagnosis import CERTAIN, COMPLETE, MANY, PARTIAL, certain, excess, highest_floor
from testbed.effect import Effect

Each = TypeVar("Each", bound=Tried)
MATERIAL = 0.02  # share of the base model's excess from which a further effect is worth a name
FAINT = 5e-3  # share of it below which what the found effects leave may be the form of their laws, not another effect,
TAKEN = 0.6  # unless that takes away this share of what is left
OWN_FORM = 2e-3  # share of the named effects' gain in BIC, and of what they explain: a law is good to some per cent of itself
FINAL = 1.05  # error over noise floor up to which a model counts as complete
GUESSED = 0.9  # error over noise floor below which a floor that no idling shows was none
AS_LITTLE = 1.01  # times the error in the fit of another set, up to which a set explains as much


def against(one: Each, reference: Tried) -> Each:
    """A candidate's gain counted from a better reference."""
    if not isinstance(one, Candidate) or not isinstance(reference, Candidate):
        return one
    size = effective_size(one.fit)
    return replace(one, delta_bic=bic(reference.fit, size) - bic(one.fit, size))


def passing_gates(tried: Sequence[Tried], current: Candidate, base: Candidate, noise: float,
                  catalogue: Mapping[str, Effect]) -> list[Candidate]:  # fmt: skip
    """Those of a round's candidates that are worth naming, the likeliest first, the others as they foretell."""
    worth = [one for one in tried if isinstance(one, Candidate) and worth_naming(one, current, base, noise)
             and not vanishes(one, catalogue)]
    first = likeliest(worth, noise) if worth else None
    return sorted(worth, key=lambda one: one is not first)


def worth_naming(candidate: Tried, current: Tried, base: Tried, noise: float) -> bool:
    """Whether an effect is worth naming: by BIC, by what it takes of the present excess, and by its share of the whole one.

    The last, so that where something unknown remains, no effect is named for nibbling at it; what completes the model passes,
    and what takes most of a rest that is itself less than such a share.
    Of the faint rest of a strong effect it must take away most, and where that is little above the noise all: no law is the
    machine's own to the last per cent. Of the little that two effects leave, a third must take half, or it would make a good
    answer doubtful.
    """
    before, after = excess(current.error_held_out, noise), excess(candidate.error_beside(noise), noise)
    gained = before - after
    whole = excess(min(base.error_held_out, base.error_fit), noise)  # extrapolated, a wrong law may look worse than it is
    material = gained > min(MATERIAL * whole, TAKEN * before) or candidate.error_beside(noise) <= FINAL * noise
    share = GAIN
    if current.effects and before < FAINT * whole:
        share = TAKEN
        if before <= excess(COMPLETE * noise, noise) and candidate.error_beside(noise) > ADEQUATE * noise:
            return False
    elif len(current.effects) >= MANY - 1 and before <= excess(FINAL * noise, noise):
        share = PARTIAL
    return candidate.delta_bic > DELTA_BIC and gained > max(share * before, 1e-3 * noise**2) and material


def likeliest(passing: Sequence[Candidate], noise: float) -> Candidate:
    """The one of these candidates that foretells best; of those that leave as little as it, the one that explains most.

    Between held-out errors of hardly more than noise chance decides, and a record that no other foretells.
    """
    first = passing[0]
    rivals = [one for one in passing if _leaves_as_little(one, first, noise)]
    if first not in rivals:
        return first
    size = effective_size(first.fit)
    best = min(rivals, key=lambda one: bic(one.fit, size))
    return best if bic(best.fit, size) < bic(first.fit, size) - DELTA_BIC else first


def _leaves_as_little(one: Candidate, first: Candidate, noise: float) -> bool:
    """Whether a candidate leaves but noise where it is known, or in the fit hardly more, and as much as the first."""
    return one.error_where_known <= ADEQUATE * noise or one.error_fit <= min(COMPLETE * noise, AS_LITTLE * first.error_fit)


def vanishes(one: Candidate, catalogue: Mapping[str, Effect]) -> bool:
    """Whether the last effect of a set ended where it does nothing: what it gained was a better place without it."""
    name = one.effects[-1]
    values = one.fit.state.model.effects.get(name, {})
    strengths = [each for each in catalogue[name].parameters if each.vanishes and each.name in values]
    return bool(strengths) and all(values[each.name] == each.neutral for each in strengths)


def certain_ones(found: Sequence[Candidate], current: Candidate, base: Candidate, noise: float) -> list[Candidate]:
    """Those that many samples make certain and that take away most of what the current set leaves, known or held out.

    What is left of a model without effects may be noise as far as the floor's own doubt goes. Beside effects that are named
    already, what is small against their gain in BIC may be the form of their laws.
    """
    least, floor = CERTAIN, highest_floor(noise, current.errors)
    if current.effects:
        least, floor = max(CERTAIN, OWN_FORM * against(current, base).delta_bic), noise
    return [one for one in found if certain(one, current) and one.delta_bic > least and _takes_most(one, current, floor)]


def _takes_most(one: Candidate, current: Candidate, noise: float) -> bool:
    """Whether most of what is left goes where it is known or, of a record that the current set does not foretell, held out."""
    left = (1.0 - TAKEN) * excess(current.error_where_known, noise)
    foretold = (1.0 - TAKEN) * excess(current.error_held_out, noise)
    return excess(one.error_where_known, noise) <= left or (
        current.error_held_out > ADEQUATE * noise and excess(one.error_held_out, noise) <= foretold)


def below_a_guess(one: Candidate, noise: float) -> bool:
    """Whether a set leaves clearly less than the noise was taken for, in records that never idle.

    What is left may then be noise or the last per cent of a law, and no gain in BIC tells which.
    """
    return one.error_where_known < GUESSED * noise and all(record.noise_basis != "idle" for record in one.fitter.records)
