"""Weak effects: what of a model that leaves hardly more than noise many samples make certain all the same."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from testbed.analysis.fit.effect_start import origins_of
from testbed.analysis.fit.moves import HYPOTHESES
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.backward import nesting_guard
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.analysis.search.candidate_round import candidate_of, certain_candidates
from testbed.analysis.search.diagnosis import CERTAIN
from testbed.analysis.search.final_fit import settled, solved_on
from testbed.analysis.search.gates import against, below_a_guess, certain_ones, vanishes
from testbed.analysis.search.mains import hum_of
from testbed.analysis.search.selection_trace import SelectionTrace, without_slopes
from testbed.analysis.search.ties import tied_with
from testbed.effect import Effect
from testbed.machine import Model

SEARCHED = 10  # iterations from a set settled with finer steps to the same with those of the search


def _weak_effect(steps: Sequence[Candidate], model: Model, catalogue: Mapping[str, Effect], noise: float,
           progress: Callable[[str], None]) -> SelectionTrace:  # fmt: skip
    """The search from a set that leaves but noise: an effect more that is certain and takes most of the rest, or none."""
    end = steps[-1]
    if end.effects and below_a_guess(end, noise):
        return SelectionTrace(tuple(steps), (), ())
    current = _with_search_steps(end, steps[0], noise)
    origins = origins_of(current.fitter.engine, model, current.fitter, current.fit, anchored=False)
    found = certain_candidates(current, catalogue, origins, progress)
    seen = tuple(map(without_slopes, found))
    hum = next(filter(None, (hum_of(one, current, catalogue) for one in certain_ones(found, current, steps[0], noise))), "")
    found = [one for one in found if not hum_of(one, current, catalogue)] if hum else found
    refitted = nesting_guard(current, certain_ones(found, current, steps[0], noise), catalogue)
    if refitted is not current:  # the set itself, begun where an effect more ended, explains as much without it
        refitted = replace(refitted, delta_bic=current.delta_bic)
        found = sorted((against(one, refitted) for one in found), key=lambda one: -one.delta_bic)
        end = refitted if current is end else settled(refitted, catalogue)
        current, steps = refitted, [*steps[:-1], end]
        seen = tuple(map(without_slopes, found))
    passing = [one for one in certain_ones(found, current, steps[0], noise) if not vanishes(one, catalogue)]
    tied = tuple(one.effects[-1] for one in passing if tied_with(passing[0], one, current, noise))  # the first with itself
    if not passing or (len(tied) > 1 and current.effects):  # which of them it is, so faint, is not asked beside what is known
        return SelectionTrace(tuple(steps), seen, (), hum)
    best = settled(solved_on(passing[0], HYPOTHESES), catalogue)
    if current is not end:  # it may have made up for the error of the steps
        best = against(best, end)
        if best.delta_bic <= CERTAIN or best.error_where_known >= end.error_where_known:
            return SelectionTrace(tuple(steps), seen, (), hum)
    return SelectionTrace((*steps, best), seen, tied if len(tied) > 1 else (), hum)


def of_a_base_that_fits(begun: Sequence[Candidate], model: Model, catalogue: Mapping[str, Effect], noise: float,
           progress: Callable[[str], None]) -> SelectionTrace | None:  # fmt: skip
    """The search from a model without effects that leaves but noise in the fit; None where it is to be gone on with.

    Where a wrong law shows only in a record that the others are to foretell, effects are looked for by that if none is certain.
    """
    base, current = begun[0], begun[-1]
    if min(current.error_where_known, current.error_fit) > ADEQUATE * noise:
        return None
    faint = _weak_effect([base], model, catalogue, noise, progress)
    return faint if current.error_where_known <= ADEQUATE * noise or faint.end.effects else None


def with_weak_effect(path: SelectionTrace, model: Model, catalogue: Mapping[str, Effect], most: int, noise: float,
                progress: Callable[[str], None]) -> SelectionTrace:  # fmt: skip
    """The path and, where it leaves but noise, an effect more that is certain."""
    end = path.end
    if path.tied or not end.effects or len(end.effects) >= most or end.error_where_known > ADEQUATE * noise:
        return path
    faint = _weak_effect(path.steps, model, catalogue, noise, progress)
    return replace(faint, seen=(*path.seen, *faint.seen))


def _with_search_steps(one: Candidate, base: Candidate, noise: float) -> Candidate:
    """A set that was settled with finer steps, fitted with those of the search again, where they too leave but noise."""
    if one.fitter.engine is base.fitter.engine:
        return one
    fitter = Fitter(base.fitter.engine, one.fitter.records, one.fitter.unknowns)
    found = candidate_of(fitter, fitter.fit(one.fit.state, iterations=SEARCHED), one.effects, None, 1.0)
    return replace(found, delta_bic=one.delta_bic) if found.error_held_out <= ADEQUATE * noise else one
