"""What a diagnosis may not say: a verdict by values that no machine has, below the noise, or of a search that was cut short."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.budget import Budgeted, BudgetSpent
from testbed.analysis.fit.free_parameters import at_a_bound
from testbed.analysis.fit.held_out import pooled, pooled_doubt
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.plausible import BELOW, against_adequacy, said_against, unlike_a_machine
from testbed.analysis.search.candidate import Candidate, Tried
from testbed.analysis.search.candidate_round import by_noise
from testbed.analysis.search.diagnosis import Diagnosis, told_of_base, verdict_of
from testbed.effect import Effect
from testbed.machine import Model

POOR, HOPELESS = 0.3, 0.75  # errors in the fit of a model that foretells little of the records, and next to nothing


def of_a_machine(found: Diagnosis, believed: Model, catalogue: Mapping[str, Effect]) -> Diagnosis:
    """The diagnosis; where it is that nothing, or an effect, is missing, but by a machine that cannot be, that instead."""
    if found.verdict not in ("adequate", "missing_effect"):
        return found
    best = by_noise(found.best_fit)
    ratio, doubt = best.error_where_known / found.noise_floor, pooled_doubt(best.errors)
    reasons = against_adequacy(best.fitter, best.fit, believed, catalogue, ratio, doubt)
    if not reasons:
        return found
    below = ratio < BELOW - 2.0 * doubt
    named = f", with {' and '.join(found.effects)}" if found.effects else ""
    sentence = (f"The error is {ratio:.3g} of the noise floor{named}, but that says nothing for the model: "
                f"{said_against(reasons)}")
    told = replace(found, verdict="undecided" if below else "unexplained", effects=(), sentence=sentence, next_test=None,
                   separates=())  # fmt: skip
    return told if found.effects else told_of_base(told)


def foretells_little(base: Candidate) -> bool:
    """Whether hardly a search is worth it: the base fit leaves most of the motion, or much by a machine that cannot be."""
    if base.error_fit > HOPELESS:
        return True
    machine = base.fit.state.model
    cannot_be = not base.fit.converged or at_a_bound(base.fitter.free, machine) or bool(unlike_a_machine(machine))
    return cannot_be and base.error_fit > POOR


def as_far_as(spent: BudgetSpent, engine: Budgeted, records: Sequence[Observed], progress: Callable[[str], None]) -> Diagnosis:
    """What is known when the budget is spent: the base fit, and the sets of effects that were tried in full by then."""
    progress("the budget is spent")
    base: Candidate | None = engine.known
    allowed = f"The budget ({engine.budget:,.0f} simulations of every record) was spent before"
    if base is None:
        return _without_a_fit(records, f"{allowed} the fit of the believed model ended: nothing can be said of what it lacks. "
                                       "Check the conditions and the starting values.")
    noise = pooled(base.errors)[1]
    seen = sorted((one for one in spent.seen if isinstance(one, Candidate)), key=lambda one: one.error_held_out)
    left = f"the believed model leaves {base.error_where_known / noise:.3g} times the noise floor"
    if foretells_little(base):
        left += (f", {base.error_fit:.0%} of the motion itself: it foretells little of these records, which may be of other "
                 "conditions, or of no cut at all")
    best = f"; of what was tried, {' + '.join(seen[0].effects)} leaves least, {seen[0].error_held_out / noise:.3g} times" \
        if seen else ""
    told = verdict_of(base, base, [base], tuple(spent.seen), noise, ())
    return replace(told, verdict="undecided", effects=(),
                   sentence=f"{allowed} the search ended: {left}{best}. A larger --budget goes on.")


def too_slow(base: Candidate) -> str:
    """In words, which records of a motion were sampled too slowly for the structure's vibration to be told; empty if none.

    Of several modes the slowest decides: faster ones may hardly move.
    """
    rings, _ = base.fit.state.model.structure.frequency_range
    slow = [one.name for one in base.fitter.records if one.rate < 2.0 * rings and not one.forces_only]
    return (f"{', '.join(slow)}: sampled less than twice in a period of the natural frequency, {rings:.4g} Hz; such records "
            "can tell nothing of what the model lacks.") if slow else ""


def _without_a_fit(records: Sequence[Observed], sentence: str) -> Diagnosis:
    """The diagnosis where not even the believed model was fitted."""
    measured = sum(float(np.sum((one.data - one.data.mean(axis=1, keepdims=True)) ** 2)) for one in records)
    noise = math.sqrt(sum(float(np.sum(one.noise**2)) * one.samples for one in records) / max(measured, 1e-300))
    none = Tried((), {}, math.nan, math.nan, 0.0, False)
    return Diagnosis("not_converged", (), sentence, math.nan, math.nan, noise, (), none, none, (none,))
