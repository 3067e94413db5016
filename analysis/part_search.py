"""The part of the first and of the last pass that one record's cut has, looked for at fixed machine parameters."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.fit_state import State, WaveformFit
from analysis.held_out import own_refit
from analysis.nuisances import MISSING, Nuisances, end_moved_in_arc
from analysis.pass_search import squares_of
from analysis.waveform import Fitter

REACH = 2  # passes beside the entry and the exit that are tried
PARTS = 8  # into which the arc is divided first,
HALVINGS = 6  # and how often the best part is then halved
PLAIN = 2.0  # in minus the log likelihood: what a place within the arc must save against a whole pass; more would bend the rest
ENDS = tuple(MISSING)


def settled(fitter: Fitter, index: int, state: State, own: Nuisances) -> tuple[float, Nuisances]:
    """(cost, nuisances) of one record with all its own unknowns refitted, ends within an arc among them."""
    alone = State(state.model, state.angle, (own,))
    single = fitter.of_records([index])
    found = own_refit(single, alone, [0])
    return single.cost(found), found.nuisances[0]


def best_ends(fitter: Fitter, index: int, state: State, starts: list[Nuisances]) -> tuple[float, Nuisances]:
    """(cost, nuisances) of one record with its entry and its exit at their best places, whole passes or within an arc."""
    arc = state.share_in_arc(fitter.records[index].flutes)
    tried = [_tried(fitter, index, state, own, arc, ends) for own in starts for ends in (ENDS, ENDS[::-1])]
    return settled(fitter, index, state, min(tried, key=lambda pair: pair[0])[1])


def best_whole(fitter: Fitter, index: int, state: State, own: Nuisances) -> tuple[float, Nuisances]:
    """(cost, nuisances) of one record with the whole passes beside its ends that explain it best, its own unknowns refitted."""
    tried = whole_passes(own, own.ends_in_arc(fitter.gradual))
    return min((settled(fitter, index, state, one) for one in tried), key=lambda pair: pair[0])


def plainer(fitter: Fitter, index: int, state: State, own: Nuisances) -> Nuisances:
    """The nuisances of one record with each end at a whole pass that explains it as well as its place within an arc does."""
    cost, own = settled(fitter, index, state, own)
    for end in own.ends_in_arc(fitter.gradual):
        whole, tried = min((settled(fitter, index, state, one) for one in whole_passes(own, (end,))), key=lambda pair: pair[0])
        if whole - cost < PLAIN:
            cost, own = whole, tried
    return own


def whole_passes(own: Nuisances, ends: tuple[str, ...]) -> list[Nuisances]:
    """The nuisances with these ends, now within an arc, at the whole passes to either side."""
    found = [own]
    for end in ends:
        beside = [0, 1] if end == "entry" else [0, -1]
        found = [one.with_fields(**{end: getattr(one, end) + by, MISSING[end]: 0.0}) for one in found for by in beside]
    return [one for one in found if one.entry < one.exit]


def best_moved(fitter: Fitter, fit: WaveformFit, index: int) -> tuple[float, Nuisances]:
    """(cost, nuisances) of the best other place of either end of one record's cut, with all unknowns following it.

    A pass wrong bends what all records share, and at that the right one looks worse. The cost, of all records, is taken as
    quadratic in everything that is continuous.
    """
    own, part = fit.state.nuisances[index], fit.parts[index]
    arc = fit.state.share_in_arc(fitter.records[index].flutes)
    places = (one for end in _movable(fitter, index, fit.state, own) for one in _places(own, arc, end))
    tried = [own, *(one for one in places if one.entry < one.exit)]
    rests = part.without_own(fitter.residuals_of(index, [(fit.state.model, fit.state.angle, one) for one in tried]))
    slopes = [each.without_own(each.shared.T).T for each in fit.parts]
    pulls = (rests - rests[0]) @ slopes[index]
    normal = np.sum([one.T @ one for one in slopes], axis=0)
    followed = pulls @ np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    squares = np.einsum("ij,ij->i", rests, rests)
    costs = fit.cost + 0.5 * (squares - squares[0] - np.einsum("ij,ij->i", pulls, followed))
    best = int(np.argmin(costs))
    return float(costs[best]), tried[best]


def _movable(fitter: Fitter, index: int, state: State, own: Nuisances) -> tuple[str, ...]:
    """The ends that may be looked for: not a gradual entry's, which is fitted, nor an exit beyond the record's end."""
    beyond = own.exit > fitter.records[index].last_pass(state.angle, own) + 1
    return tuple(end for end in ENDS if not (fitter.gradual if end == "entry" else beyond))


def _tried(
    fitter: Fitter, index: int, state: State, own: Nuisances, arc: float, ends: tuple[str, ...]
) -> tuple[float, Nuisances]:
    """(cost, nuisances) of the best place of one end, then of the other, then of both once more."""
    movable, cost = _movable(fitter, index, state, own), np.inf
    for _ in range(2):
        before = own
        for end in (one for one in ends if one in movable):
            cost, own = _placed(fitter, index, state, own, arc, end)
        if own == before:
            break
    return cost, own


def _placed(fitter: Fitter, index: int, state: State, own: Nuisances, arc: float, end: str) -> tuple[float, Nuisances]:
    tried = [one for one in (own, *_places(own, arc, end)) if one.entry < one.exit]
    costs = 0.5 * squares_of(fitter, index, state, tried)
    cost, best = float(costs.min()), tried[int(np.argmin(costs))]
    step = 0.5 / PARTS
    for _ in range(HALVINGS):
        near = [one for by in (-step, step) if (one := end_moved_in_arc(best, end, by, arc)).entry < one.exit]
        costs = 0.5 * squares_of(fitter, index, state, near)
        if costs.min() < cost:
            cost, best = float(costs.min()), near[int(np.argmin(costs))]
        step *= 0.5
    return cost, best


def _places(own: Nuisances, arc: float, end: str) -> Iterator[Nuisances]:
    """Whole passes beside the one that begins or ends the cut, and each with a part of its arc."""
    whole = own.with_fields(**{MISSING[end]: 0.0})
    for part in range(-REACH * PARTS, (REACH + 1) * PARTS):
        yield end_moved_in_arc(whole, end, part / PARTS, arc)
