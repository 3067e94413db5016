"""Where a search ends with much unexplained: every effect fitted alone anew from the believed machine, and the search repeated.

A search is greedy. The fit of the base model has already made up for a strong effect (an immersion far off by the cutting
coefficients and the tooth's angle), so that from there another effect may seem the strongest, and no later round comes back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from analysis.candidate_round import candidate_of
from analysis.diagnosis import COMPLETE, Candidate, excess
from analysis.effect_start import all_free, applicable
from analysis.forward_search import Path, forward
from analysis.information import effective_size
from analysis.starts import base_fit
from testbed.effect import Effect
from testbed.machine import Model

CLEARLY = 0.5  # share of the excess of the first search that the second may leave, to be believed instead


def looked_again(
    path: Path, model: Model, catalogue: Mapping[str, Effect], noise: float, most: int, say: Callable[[str], None]
) -> Path:
    """The path, or, where that leaves much, the one that begins with the effect that alone explains most, if it leaves less.

    noise: the noise floor, as the errors.
    """
    cut = path.end.fitter is not None and any(record.cut is not None for record in path.end.fitter.records)
    left = min(path.end.error_held_out, path.end.error_fit)  # a record alone in its size is foretold badly by the right law
    if len(path.steps) < 2 or most < 2 or not cut or left <= COMPLETE * noise:
        return path
    base, first = path.steps[0], path.steps[1]
    say("much is left: looking at every effect again, from the believed machine")
    alone = [_alone(name, base, model, catalogue, say) for name in _others(first, model, catalogue)]
    best = min(alone, key=lambda one: one.error_held_out, default=first)
    if best.error_held_out >= first.error_held_out:
        return path
    again = forward([base, best], model, catalogue, most, say)
    now, before = excess(again.end.error_held_out, noise), excess(path.end.error_held_out, noise)
    return replace(again, seen=(*path.seen, best, *again.seen)) if now <= CLEARLY * before else path


def _others(first: Candidate, model: Model, catalogue: Mapping[str, Effect]) -> list[str]:
    """Effects that could have come first instead, but for those whose phase every record has for itself.

    What recurs in time bends no coefficient that a cut is entered with.
    """
    assert first.fitter is not None
    return [
        name
        for name, effect in catalogue.items()
        if name not in (*first.effects, *model.effects)
        and applicable(effect, first.fitter.records, set(model.effects))
        and effect.parameters
        and not any(one.each_record for one in effect.parameters)
    ]


def _alone(
    name: str, base: Candidate, model: Model, catalogue: Mapping[str, Effect], say: Callable[[str], None]
) -> Candidate:
    """One effect fitted from the believed machine."""
    assert base.fitter is not None and base.fit is not None
    say(f"{name} from the believed machine")
    records = base.fitter.records
    believed = model.with_effect(name, **catalogue[name].example())
    fitter, fit = base_fit(base.fitter.plant, records, believed, free=all_free(records, believed, catalogue))
    return candidate_of(fitter, fit, (name,), base.fit, effective_size(fit))
