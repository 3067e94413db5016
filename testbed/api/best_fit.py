"""What is to be said of the fit of the best set of effects that a diagnosis found."""

from __future__ import annotations

from typing import Any

from testbed.api.fitting import engine_of

_EXPLAINS = ("adequate", "missing_effect")  # verdicts by which the best model leaves no physics out


def of_the_best_fit(found: Any, records: Any, model: Any, catalogue: Any
                     ) -> tuple[tuple[str, ...], tuple[str, ...], list[str], list[dict[str, Any]]]:  # fmt: skip
    """(parameters at a bound, those not determined, notes, rows beside the tap) of the fit of the best set of effects."""
    from testbed.analysis.comparison.tapped import beside_the_tap, said_of_the_tap
    from testbed.analysis.fit.estimates import (
        at_bound,
        clock_note,
        estimates,
        not_determined,
        said_at_bound,
        said_not_determined,
    )
    from testbed.analysis.fit.plausible import remarks_on
    from testbed.analysis.fit.record_hypotheses import taken_notes
    from testbed.analysis.search.candidate import ADEQUATE, Candidate
    from testbed.analysis.search.mark_delay import delay_note

    if not isinstance(found.best, Candidate):
        return (), (), [], []
    fitter, fit = found.best.fitter, found.best.fit
    told = estimates(fitter, fit, catalogue)
    stuck, guesses = at_bound(fitter.free, told), not_determined(told)
    notes = [*taken_notes(records, fitter.records), *delay_note(records, fitter, fit), *clock_note(fitter, fit),
             *(note for note in remarks_on(model, fit.state.model) if note.partition(":")[0] not in found.sentence)]
    notes += [said_not_determined(guesses)] if guesses else []
    explained = fit.converged and found.best.error_held_out <= ADEQUATE * found.noise_floor and found.verdict in _EXPLAINS
    tapped = beside_the_tap(model, told, explained)
    notes += [*([said_at_bound(stuck)] if stuck else []),
              *said_of_the_tap(tapped, any(one.kind == "cut" for one in fitter.records))]
    return stuck, guesses, notes, [one.as_json() for one in tapped]


def force_maps(found: Any, catalogue: Any) -> list[Any]:
    """Force-state maps of what the best model still lacks; none where that is but noise."""
    from testbed.analysis.force.force_state import force_states
    from testbed.analysis.search.candidate import ADEQUATE, Candidate

    best = found.best
    if not isinstance(best, Candidate) or best.error_held_out <= ADEQUATE * found.noise_floor:
        return []
    states = force_states(engine_of(catalogue), best.fitter, best.fit, best.errors, catalogue)
    return [(one.name, one.x, one.v, one.force) for one in states]
