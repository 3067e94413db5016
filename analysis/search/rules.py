"""The rules by which a verdict follows from its numbers, each with its limit and what these records gave."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from testbed.analysis.fit.evidence import DELTA_BIC
from testbed.analysis.fit.held_out import pooled_doubt
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.analysis.search.candidate_round import GAIN
from testbed.analysis.search.diagnosis import (
    CERTAIN,
    COMPLETE,
    EXPLAINED,
    FAINT_REST,
    MANY,
    MOSTLY,
    SILENT,
    SURE,
    Diagnosis,
    beyond_chance,
    excess,
    noise_share,
)
from testbed.analysis.search.gates import FINAL, MATERIAL, TAKEN


@dataclass(frozen=True)
class Rule:
    """One rule: what it asks of which set of effects, the number it looks at, its limit, and whether it is met."""

    rule: str
    effects: tuple[str, ...]
    value: float
    limit: float
    met: bool


def rules_of(found: Diagnosis) -> tuple[Rule, ...]:
    """All rules that a verdict of a search rests on, in the order in which they are asked; none where no fit was made."""
    if not isinstance(found.base, Candidate):
        return ()
    singles = [one for one in found.fitted if len(one.effects) == 1]
    each = [rule for one in singles for rule in _of_one(one, found.base, found.noise_floor)]
    return (*_of_the_base(found.base, found.noise_floor), *each, *_of_the_best(found))


def _of_the_base(base: Candidate, noise: float) -> Iterator[Rule]:
    share, ratio = max(noise, noise_share(base)), base.error_where_known / noise
    doubt = FAINT_REST + SURE * pooled_doubt(base.errors)
    yield Rule("more than noise was measured: noise over signal is at most", (), share, SILENT, share <= SILENT)
    yield Rule("the model is adequate as it is: error over noise floor is at most", (), ratio, ADEQUATE, ratio <= ADEQUATE)
    yield Rule("it is adequate if no effect helps: error over noise floor is at most", (), ratio, doubt, ratio <= doubt)


def _of_one(one: Candidate, base: Candidate, noise: float) -> Iterator[Rule]:
    before, after = excess(base.error_held_out, noise), excess(one.error_beside(noise), noise)
    whole = excess(min(base.error_held_out, base.error_fit), noise)
    share = 1.0 - after / before if before > 0.0 else 0.0
    least = GAIN  # of what completes the model; of what does not, enough of the whole
    if before > 0.0 and one.error_beside(noise) > FINAL * noise:
        least = max(GAIN, min(MATERIAL * whole / before, TAKEN))
    yield Rule("its gain in BIC is above", one.effects, one.delta_bic, DELTA_BIC, one.delta_bic > DELTA_BIC)
    yield Rule("it takes away more than this share of what is unexplained, held out", one.effects, share, least, share > least)
    yield Rule("it is certain, so that the verdict is not 'adequate': gain in BIC above", one.effects, one.delta_bic, CERTAIN,
               beyond_chance(one, base))


def _of_the_best(found: Diagnosis) -> Iterator[Rule]:
    best, noise = found.best, found.noise_floor
    if not best.effects:
        return
    left, many = best.error_where_known / noise, len(best.effects) >= MANY
    share = 1.0 - excess(best.error_where_known, noise) / max(excess(found.base.error_held_out, noise), 1e-300)
    limit = ADEQUATE if many else COMPLETE
    yield Rule("these leave hardly more than noise: error over noise floor is at most", best.effects, left, limit,
               left <= limit)
    if not many:
        wanted = EXPLAINED if left > COMPLETE else MOSTLY
        yield Rule("where more than noise is left, they take away at least this share", best.effects, share, wanted,
                   share >= wanted)
