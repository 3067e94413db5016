"""The answer of a diagnosis in JSON."""

from __future__ import annotations

from typing import Any

from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.diagnosis import Diagnosis
from testbed.machine import BASE_UNITS, Model, base_parameter


def as_json(result: Diagnosis, before: Model) -> dict[str, Any]:
    """The answer of `testbed diagnose --json` (contract); `history` follows the error from step to step.

    Without `held_out` every error is that in the fit. A candidate that was not `fitted` was ruled out by a first step: it
    carries the numbers of what it was to be added to.
    """
    after = result.best.fit.state.model if isinstance(result.best, Candidate) else before
    units = {name: unit for name in (result.base.fit.names if isinstance(result.base, Candidate) else ())
             if (unit := BASE_UNITS.get(base_parameter(name) or "")) is not None}
    return {
        "verdict": result.verdict,
        "effects": list(result.effects),
        "sentence": result.sentence,
        "held_out": result.held_out,
        "error": {"baseline": result.baseline, "with_effects": result.with_effects, "noise_floor": result.noise_floor},
        "candidates": [
            {
                "effects": list(one.effects),
                "fitted": isinstance(one, Candidate),
                "parameters": dict(one.parameters),
                "error_fit": one.error_fit,
                "error_held_out": one.error_held_out,
                "delta_bic": one.delta_bic,
                "converged": one.converged,
            }
            for one in result.candidates
        ],
        "base_parameters": {
            name: {"before": before.value(name), "after": after.value(name), "unit": unit} for name, unit in units.items()
        },
        "next_test": None
        if result.next_test is None
        else {
            "spindle_speed": result.next_test.spindle_speed,
            "depth_of_cut": result.next_test.depth_of_cut,
            "separates": list(result.separates),
            "difference": result.next_test.difference,
        },
        "misstated": None if result.misstated is None else dict(zip(("condition", "factor"), result.misstated, strict=True)),
        "mode": result.mode,
        "other_law": None if result.form is None else result.form.as_json(),
        "history": [
            {"effects": list(step.effects), "error": step.error_held_out, "noise_floor": result.noise_floor}
            for step in result.steps
        ],
    }
