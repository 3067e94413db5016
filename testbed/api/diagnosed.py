"""What is said of a diagnosis beside its verdict: of the best fit, of decoys, and which command goes on."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

from testbed.api.fitting import plant_of

if TYPE_CHECKING:
    from testbed.analysis.search.diagnosis import Diagnosis as Diagnosed

_EXPLAINS = ("adequate", "missing_effect")  # verdicts by which the best model leaves no physics out


def decoys_in(found: Diagnosed, catalogue: Any) -> dict[str, Any]:
    """Laws that no machine has: those offered, and those named."""
    from testbed.catalogue import DECOYS

    offered = [name for name, effect in catalogue.items() if effect.path is not None and effect.path.parent == DECOYS]
    return {"offered": offered, "named": [name for name in found.effects if name in offered]}


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
    from testbed.analysis.fit.taken import taken_notes
    from testbed.analysis.search.diagnosis import ADEQUATE
    from testbed.analysis.search.mark_delay import delay_note

    fitter, fit = found.best.fitter, found.best.fit
    if fitter is None or fit is None:
        return (), (), [], []
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
    from testbed.analysis.search.diagnosis import ADEQUATE

    best = found.best
    if best.fit is None or best.fit.state.model.planar or best.error_held_out <= ADEQUATE * found.noise_floor:
        return []
    states = force_states(plant_of(catalogue), best.fitter, best.fit, best.errors, catalogue)
    return [(one.name, one.x, one.v, one.force) for one in states]


def next_command(found: Any, campaign: str, model_file: str, proposed: bool, folders: tuple[str, ...] = ()) -> str:
    """The command to go on with; empty where there is none, or where it is told with what was proposed.

    folders: of the user's own effects, which the command will know no more than this one did without them. proposed: whether a
    force was asked for already, or cannot be: a missing one is along x so far.
    """
    if found.mode:
        return ""
    if found.verdict == "missing_effect":
        return add_command(found.effects, campaign, model_file, folders)
    if found.verdict == "unexplained" and found.candidates and not proposed:  # without candidates no effect was looked for
        return shlex.join(["testbed", "diagnose", campaign, "-m", model_file, *_own(folders), "--propose", "DIR"])
    return ""


def add_command(effects: tuple[str, ...], campaign: str, model_file: str, folders: tuple[str, ...]) -> str:
    return shlex.join(["testbed", "add", *effects, "-m", model_file, "-c", campaign, *_own(folders), "-o", "NEW.yaml"])


def _own(folders: tuple[str, ...]) -> list[str]:
    return [word for folder in folders for word in ("--effects", folder)]
