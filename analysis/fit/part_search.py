"""The part of the first and of the last pass that one record's cut has, looked for at fixed machine parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.held_out import own_refit
from testbed.analysis.fit.nuisances import MISSING, Nuisances, end_moved_in_arc, end_whole
from testbed.analysis.fit.pass_search import left_at, squares_of
from testbed.analysis.fit.waveform import Fitter

REACH = 2  # passes beside the entry and the exit that are tried, or one where the parts are more than FINE
PARTS = 8  # into which the arc is divided first,
FEW = 2  # where it is only asked what any place could explain,
FINE = 32  # and in the end: of a tooth that enters at its full chip a fiftieth of a pass is a kick
# Or so many to each swing of the structure in an arc: a kick a swing too early or too late explains nearly as much.
PER_SWING = {PARTS: 4, FEW: 1, FINE: 4}
MOST_SWINGS = 16  # up to which they are counted
VALLEYS = 3  # places that cost less than those beside them from which the best is looked for: an arc may hold several,
HALVINGS = 6  # halving the step so often
LITTLE = 0.01  # of the arc, beside a whole pass: from there slopes lead on
PLAIN = 2.0  # in minus the log likelihood: what a place within the arc must save against a whole pass; more would bend the rest
ROUNDING = 1e-12  # share of the largest square below which a mixture of changes is none
ENDS = tuple(MISSING)
CostsOf = Callable[[Sequence[Nuisances]], np.ndarray]


def settled(fitter: Fitter, index: int, state: State, own: Nuisances) -> tuple[float, Nuisances]:
    """(cost, nuisances) of one record with all its own unknowns refitted, ends within an arc among them."""
    alone = State(state.model, state.angle, (own,))
    single = fitter.of_records([index])
    found = own_refit(single, alone, [0])
    return single.cost(found), found.nuisances[0]


def best_ends(fitter: Fitter, index: int, state: State, starts: list[Nuisances]) -> tuple[float, Nuisances]:
    """(cost, nuisances) of one record with its entry and its exit at their best places, whole passes or within an arc.

    From each start, and with either end first, coarse places are tried; the best of all is then made exact.
    """
    arc, parts = state.share_in_arc(fitter.records[index]), _parts(fitter, index, state, PARTS)

    def costs_of(tried: Sequence[Nuisances]) -> np.ndarray:
        return 0.5 * squares_of(fitter, index, state, tried)

    tried = []
    for cost, own in zip(costs_of(starts), starts, strict=True):
        movable = _movable(fitter, index, state, own)
        for ends in (movable, movable[::-1]):
            found = float(cost), own
            for end in ends:
                found = _placed(costs_of, found, arc, end, 0, parts)
            tried.append(found)
    found = min(tried, key=_cost)
    for end in _movable(fitter, index, state, found[1]):
        found = _placed(costs_of, found, arc, end, VALLEYS, parts)
    return settled(fitter, index, state, found[1])


def best_whole(fitter: Fitter, index: int, state: State, own: Nuisances) -> tuple[float, Nuisances]:
    """(cost, nuisances) of one record with the whole passes beside its ends that explain it best, its own unknowns refitted."""
    tried = whole_passes(own, own.ends_in_arc(fitter.gradual))
    return min((settled(fitter, index, state, one) for one in tried), key=_cost)


def plainer(fitter: Fitter, index: int, state: State, own: Nuisances) -> Nuisances:
    """The nuisances of one record with each end at a whole pass that explains it as well as its place within an arc does."""
    cost, own = settled(fitter, index, state, own)
    for end in own.ends_in_arc(fitter.gradual):
        whole, tried = min((settled(fitter, index, state, one) for one in whole_passes(own, (end,))), key=_cost)
        if whole - cost < PLAIN:
            cost, own = whole, tried
    return own


def whole_passes(own: Nuisances, ends: tuple[str, ...]) -> list[Nuisances]:
    """The nuisances with these ends, now within an arc, at the whole passes to either side."""
    found = [own]
    for end in ends:
        found = [end_whole(one, end, passes) for one in found for passes in (0, 1)]
    return [one for one in found if one.entry < one.exit]


def beside_whole(fitter: Fitter, index: int, state: State) -> list[Nuisances]:
    """The nuisances of one record with one of its ends a little to either side of the whole passes next to it."""
    own, arc = state.nuisances[index], state.share_in_arc(fitter.records[index])
    tried = [end_moved_in_arc(whole, end, by, arc) for end in _movable(fitter, index, state, own)
             for whole in whole_passes(own, (end,) if end in own.ends_in_arc() else ())
             for by in (-LITTLE, LITTLE)]  # fmt: skip
    return [one for one in tried if one.entry < one.exit]


def best_moved(fitter: Fitter, fit: WaveformFit, index: int) -> tuple[float, Nuisances]:
    """(cost, nuisances) of the best other place of either end of one record's cut, with all unknowns following it.

    A pass wrong bends what all records share, and at that the right one looks worse. The cost, of all records, is taken as
    quadratic in everything that is continuous.
    """
    own, arc = fit.state.nuisances[index], fit.state.share_in_arc(fitter.records[index])
    slopes = [each.without_own(each.shared.T).T for each in fit.parts]
    followed = np.linalg.pinv(np.sum([one.T @ one for one in slopes], axis=0), rcond=1e-12, hermitian=True)

    now = left_at(fitter, fit, index, [own])[0]

    def costs_of(tried: Sequence[Nuisances]) -> np.ndarray:
        rests = left_at(fitter, fit, index, tried)
        pulls = (rests - now) @ slopes[index]
        squares = np.einsum("ij,ij->i", rests, rests)
        return fit.cost + 0.5 * (squares - now @ now - np.einsum("ij,ij->i", pulls, pulls @ followed))

    parts = _parts(fitter, index, fit.state, FINE)
    places = [_placed(costs_of, (fit.cost, own), arc, end, VALLEYS, parts) for end in _movable(fitter, index, fit.state, own)]
    return min([(fit.cost, own), *places], key=_cost)


def reachable(fitter: Fitter, fit: WaveformFit, index: int) -> float:
    """What other places of a cut's ends could at most explain of one record, in minus the log likelihood, to first order.

    Of what is left, the part that any mixture of the changes by coarse moves makes up, the record's own unknowns following.
    """
    own, arc = fit.state.nuisances[index], fit.state.share_in_arc(fitter.records[index])
    parts = _parts(fitter, index, fit.state, FEW)
    places = [place for end in _movable(fitter, index, fit.state, own) for place in _places(own, arc, end, parts)
              if place.entry < place.exit]  # fmt: skip
    if not places:
        return 0.0
    now, *moved = left_at(fitter, fit, index, (own, *places))
    changes = np.array(moved) - now
    values, vectors = np.linalg.eigh(changes @ changes.T)
    kept = values > ROUNDING * values[-1]
    along = (now @ changes.T) @ vectors[:, kept] / np.sqrt(values[kept])
    return 0.5 * float(along @ along)


def _movable(fitter: Fitter, index: int, state: State, own: Nuisances) -> tuple[str, ...]:
    """The ends that may be looked for: not a gradual entry's, which is fitted, nor one long before the record or beyond it."""
    record = fitter.records[index]
    before = record.starts_in_cut and own.entry <= record.first_simulated
    out = {"entry": fitter.gradual or before, "exit": own.exit > record.last_pass(state.angle, own) + 1}
    return tuple(end for end in ENDS if not out[end])


def _parts(fitter: Fitter, index: int, state: State, least: int) -> int:
    """Into how many parts an arc is divided: so many at least, or as its swings ask for."""
    record = fitter.records[index]
    swings = state.model.structure.frequency_range[1] * record.period / record.flutes * state.share_in_arc(record)
    return max(least, math.ceil(PER_SWING[least] * min(swings, MOST_SWINGS)))


def _placed(
    costs_of: CostsOf, found: tuple[float, Nuisances], arc: float, end: str, valleys: int, parts: int
) -> tuple[float, Nuisances]:
    """(cost, nuisances) of the best place of one end: where it was found, a place among so many `parts` of an arc, or the
    bottom of one of so many valleys that those show."""
    places = [one for one in _places(found[1], arc, end, parts) if one.entry < one.exit]
    if not places:
        return found
    costs = costs_of(places)
    tried = [found, (float(costs.min()), places[int(np.argmin(costs))])]
    for place in _valleys(costs)[:valleys]:
        cost, best, step = float(costs[place]), places[place], 0.5 / parts
        for _ in range(HALVINGS):
            near = [one for by in (-step, step) if (one := end_moved_in_arc(best, end, by, arc)).entry < one.exit]
            beside = costs_of(near)
            if beside.min() < cost:
                cost, best = float(beside.min()), near[int(np.argmin(beside))]
            step *= 0.5
        tried.append((cost, best))
    return min(tried, key=_cost)


def _cost(pair: tuple[float, Nuisances]) -> float:
    return pair[0]


def _valleys(costs: np.ndarray) -> list[int]:
    """Places that cost no more than those beside them, the cheapest first."""
    walled = np.concatenate([[np.inf], costs, [np.inf]])
    low = np.flatnonzero((costs <= walled[:-2]) & (costs <= walled[2:]))
    return [int(place) for place in low[np.argsort(costs[low], kind="stable")]]


def _places(own: Nuisances, arc: float, end: str, parts: int) -> Iterator[Nuisances]:
    """Whole passes beside the one that begins or ends the cut, and each with a part of its arc."""
    whole, reach = end_whole(own, end), REACH if parts <= FINE else 1
    for part in range(-reach * parts, (reach + 1) * parts):
        yield end_moved_in_arc(whole, end, part / parts, arc)
