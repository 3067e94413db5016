"""Where a search ends with much unexplained: every effect fitted alone from the believed machine, and the search repeated.

A search is greedy. The fit of the base model has already made up for a strong effect (an immersion far off by the cutting
coefficients and the tooth's angle), so that from there another effect may seem the strongest, and no later round comes back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from analysis.begun_anew import from_believed, with_examples
from analysis.diagnosis import COMPLETE, excess
from analysis.effect_start import all_free, applicable
from analysis.fit_state import Free
from analysis.forward_search import Path, against, forward, worth_naming
from analysis.observed import Observed
from analysis.starts import glance, opening_fit, structure_start
from testbed.effect import Effect
from testbed.machine import Model

LIKELY = 4  # effects whose openings are fitted from several starts
CLEARLY = 0.5  # share of the excess of the first search that the second may leave, to be believed instead


def looked_again(
    path: Path, model: Model, catalogue: Mapping[str, Effect], noise: float, most: int, say: Callable[[str], None]
) -> Path:
    """The path, or, where that leaves much, the one that begins with the effect that alone explains most, if it leaves less.

    Which that is, the openings of the records tell. noise: the noise floor, as the errors.
    """
    cut = path.end.fitter is not None and any(record.cut is not None for record in path.end.fitter.records)
    if most < 2 or not cut or path.end.error_where_known <= COMPLETE * noise:
        return path
    base, first = path.steps[0], path.steps[1] if len(path.steps) > 1 else None
    assert base.fitter is not None and base.fit is not None
    plant, records = base.fitter.plant, base.fitter.records

    started = structure_start(records, model)

    def free(name: str) -> list[Free]:
        return all_free(records, with_examples(model, [name], catalogue), catalogue)

    def glanced(name: str) -> float:
        say(f"{name} from the believed machine")
        return glance(plant, records, with_examples(started, [name], catalogue), free(name))

    def opened(name: str) -> float:
        say(f"{name} from the believed machine, its opening")
        return opening_fit(plant, records, with_examples(started, [name], catalogue), free(name)).cost

    say("much is left: looking at every effect again, from the believed machine")
    likely = sorted(_could_be_first(records, model, catalogue), key=glanced)[:LIKELY]
    best = min(likely, key=opened, default=None)
    if best is None or first is not None and (best,) == first.effects:
        return path
    alone = against(from_believed(plant, records, model, [best], catalogue), base)
    if alone.error_held_out >= (first or base).error_held_out or first is None and not worth_naming(alone, base, base, noise):
        return path
    again = forward([base, alone], model, catalogue, most, say)
    now, before = excess(again.end.error_held_out, noise), excess(path.end.error_held_out, noise)
    return replace(again, seen=(*path.seen, alone, *again.seen)) if now <= CLEARLY * before else path


def _could_be_first(records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect]) -> list[str]:
    """Effects that a search could begin with, but for those whose phase every record has for itself.

    What recurs in time bends no coefficient that a cut is entered with.
    """
    return [
        name
        for name, effect in catalogue.items()
        if name not in model.effects
        and applicable(effect, records, set(model.effects))
        and effect.parameters
        and not any(one.each_record for one in effect.parameters)
    ]
