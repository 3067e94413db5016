"""Where a search ends with much unexplained, it is repeated from the effects that explain most from the believed machine.

A search is greedy: where the base model has made up for a strong effect, another may seem the strongest, and no later round
comes back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from testbed.analysis.search.candidate_round import by_noise
from testbed.analysis.search.diagnosis import FAINT_REST, excess
from testbed.analysis.search.forward_search import forward
from testbed.analysis.search.gates import against, worth_naming
from testbed.analysis.search.law_form import steeper_form
from testbed.analysis.search.prior_screening import PriorScreening
from testbed.analysis.search.selection_trace import SelectionTrace

CLEARLY = 0.5  # share of the excess of the first search that the second may leave, to be believed instead
SEEN = 0.8  # share of the cost of the openings with one effect that those with two may leave, to be fitted


def restarted(path: SelectionTrace, look: PriorScreening, noise: float, most: int) -> SelectionTrace:
    """The path, or, where that leaves much, the one that begins with the effect that alone explains most, if it leaves less.

    Which that is, the openings of the records tell. Where that, too, leaves much, it is tried with every other effect at once:
    of two strong ones neither need explain anything alone. noise: the noise floor, as the errors.
    """
    if most < 2 or path.form or path.end.error_where_known <= FAINT_REST * noise or (best := look.leader) is None:
        return path
    found = begun_with(path, [best], look, noise, most)
    if found.form or found.end.error_where_known <= FAINT_REST * noise:
        return found
    pairs = look.beside_leader()
    other = min(pairs, key=lambda name: pairs[name], default=best)
    if not pairs or pairs[other] > SEEN * look.opened(best):
        return found
    return begun_with(found, [best, other], look, noise, most)


def begun_with(path: SelectionTrace, names: Sequence[str], look: PriorScreening, noise: float, most: int) -> SelectionTrace:
    """The path, or the one that begins with these effects fitted from the believed machine, if it leaves clearly less.

    It is asked where they foretell more than what the path began with, or explain clearly more: of two effects that are missing
    the one that a single record shows need not foretell that record before the other is there, too.
    """
    base, first = look.base, path.steps[1] if len(path.steps) > 1 else None
    if first is not None and tuple(names) == first.effects:
        return path
    begun = against(look.fitted(*names), base)
    reference = first if first is not None and len(first.effects) == len(names) else base
    less = begun.error_held_out < reference.error_held_out or begun.error_fit < CLEARLY * reference.error_fit
    if not less or first is None and not worth_naming(begun, base, base, noise):
        return path
    form = steeper_form([by_noise(begun)], [by_noise(one) for one in (*path.steps, begun)], look.catalogue, look.say)
    if form is not None:
        return replace(path, seen=(*path.seen, begun), form=form)
    again = forward([base, begun], look.model, look.catalogue, most, look.say)
    now, before = excess(again.end.error_held_out, noise), excess(path.end.error_held_out, noise)
    return replace(again, seen=(*path.seen, begun, *again.seen)) if now <= CLEARLY * before else path
