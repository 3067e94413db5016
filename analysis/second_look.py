"""Where a search ends with much unexplained: every effect fitted alone from the believed machine, and the search repeated.

A search is greedy. The fit of the base model has already made up for a strong effect (an immersion far off by the cutting
coefficients and the tooth's angle), so that from there another effect may seem the strongest, and no later round comes back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from analysis.begun_anew import from_believed, with_examples
from analysis.candidate_round import shifts_in_time
from analysis.diagnosis import COMPLETE, Candidate, excess
from analysis.effect_start import all_free, applicable
from analysis.fit_state import Free
from analysis.forward_search import Path, against, forward, worth_naming
from analysis.observed import Observed
from analysis.starts import glance, opening_fit, structure_start
from testbed.effect import Effect
from testbed.machine import Model

LIKELY = 4  # effects whose openings are fitted from several starts
CLEARLY = 0.5  # share of the excess of the first search that the second may leave, to be believed instead
TWO = 3.0  # error over noise floor from which two effects are tried at once


def looked_again(
    path: Path, model: Model, catalogue: Mapping[str, Effect], noise: float, most: int, say: Callable[[str], None]
) -> Path:
    """The path, or, where that leaves much, the one that begins with the effect that alone explains most, if it leaves less.

    Which that is, the openings of the records tell. Where that, too, leaves much, it is tried with every other effect at once:
    of two strong ones neither need explain anything alone. noise: the noise floor, as the errors.
    """
    cut = path.end.fitter is not None and any(record.cut is not None for record in path.end.fitter.records)
    if most < 2 or not cut or path.end.error_where_known <= COMPLETE * noise:
        return path
    look = _Look(path.steps[0], model, catalogue, say)
    say("much is left: looking at every effect again, from the believed machine")
    every = _could_be_first(look.records, model, catalogue)
    likely = sorted(every, key=look.glanced)[:LIKELY]
    if not likely:
        return path
    costs = {name: look.opened(name) for name in likely}
    best = min(costs, key=lambda name: costs[name])
    found = _begun_with(path, [best], look, noise, most)
    if found.end.error_where_known <= TWO * noise:
        return found
    say(f"much is left: looking at every effect together with {best}")
    others = [name for name in every if name != best and not shifts_in_time(catalogue[name])]
    pairs = {name: look.opened(best, name) for name in others}
    other = min(pairs, key=lambda name: pairs[name], default=best)
    return _begun_with(found, [best, other], look, noise, most) if pairs and pairs[other] <= CLEARLY * costs[best] else found


class _Look:
    """The believed machine with effects at their examples, fitted to the openings of the records of the base fit."""

    def __init__(self, base: Candidate, model: Model, catalogue: Mapping[str, Effect], say: Callable[[str], None]) -> None:
        assert base.fitter is not None
        self.base, self.model, self.catalogue, self.say = base, model, catalogue, say
        self.plant, self.records = base.fitter.plant, base.fitter.records
        self.started = structure_start(self.records, model)

    def _free(self, names: Sequence[str]) -> list[Free]:
        return all_free(self.records, with_examples(self.model, names, self.catalogue), self.catalogue)

    def glanced(self, name: str) -> float:
        """The cost of a short fit."""
        self.say(f"{name} from the believed machine")
        return glance(self.plant, self.records, with_examples(self.started, [name], self.catalogue), self._free([name]))

    def opened(self, *names: str) -> float:
        """The cost of a fit from several starts."""
        self.say(f"{' and '.join(names)} from the believed machine, the openings")
        model = with_examples(self.started, names, self.catalogue)
        return opening_fit(self.plant, self.records, model, self._free(names)).cost


def _begun_with(path: Path, names: Sequence[str], look: _Look, noise: float, most: int) -> Path:
    """The path, or the one that begins with these effects fitted from the believed machine, if it leaves clearly less."""
    base, first = look.base, path.steps[1] if len(path.steps) > 1 else None
    if first is not None and tuple(names) == first.effects:
        return path
    begun = against(from_believed(look.plant, look.records, look.model, names, look.catalogue), base)
    reference = first if first is not None and len(first.effects) == len(names) else base
    if begun.error_held_out >= reference.error_held_out or first is None and not worth_naming(begun, base, base, noise):
        return path
    again = forward([base, begun], look.model, look.catalogue, most, look.say)
    now, before = excess(again.end.error_held_out, noise), excess(path.end.error_held_out, noise)
    return replace(again, seen=(*path.seen, begun, *again.seen)) if now <= CLEARLY * before else path


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
