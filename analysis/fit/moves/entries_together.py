"""First passes of all records looked for together, where an entry that is not sudden lets each make up for the others.

How gradual an entry is, and the cutting coefficients, are shared; the pass it begins with is each record's own whole number.
Moved alone, none helps: the shared unknowns hold it where the others are. So the sum of squares is taken as quadratic in
everything that is continuous, which leaves for every record and every pass a residual and its pull on the shared unknowns,
and the best passes of all records are found by changing one or two of them at a time from several starts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.pass_search import left_at
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter

REACH = 4  # passes to either side that are tried
PAIRED = 24  # records up to which two are moved at a time: of more there are too many pairs
STEPS = 12  # iterations of the fit that follows


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with the first passes of all its cuts at their joint best."""
    moves = best_moves(*_pulls(fitter, fit))
    if np.any(moves):
        moved = tuple(replace(one, entry=min(one.entry + int(move), one.exit - 1))
                      for one, move in zip(fit.state.nuisances, moves, strict=True))
        yield Trial(fitter, fitter.fit(replace(fit.state, nuisances=moved), iterations=STEPS))


MOVE = Move(propose, repeats=6)


def _pulls(fitter: Fitter, fit: WaveformFit) -> tuple[np.ndarray, np.ndarray]:
    """Squares (records, moves) left at fixed shared unknowns, infinite where a move cannot be, and their pulls on these.

    pulls (records, moves, shared): gradients, scaled so that the squares of their sum over records are what the shared
    unknowns then take away. Every record's own unknowns are eliminated.
    """
    shifts = range(-REACH, REACH + 1)
    squares = np.full((len(fitter.records), len(shifts)), np.inf)
    gradients = np.zeros((len(fitter.records), len(shifts), len(fitter.names)))
    normal = np.zeros((len(fitter.names),) * 2)
    for index, (record, part, own) in enumerate(zip(fitter.records, fit.parts, fit.state.nuisances, strict=True)):
        slopes = part.without_own(part.shared.T).T
        normal += slopes.T @ slopes
        can = [0] if record.cut is None or record.starts_in_cut else [k for k in shifts if own.entry + k < own.exit]
        rests = left_at(fitter, fit, index, [replace(own, entry=own.entry + k) for k in can])
        places = [k + REACH for k in can]
        squares[index, places] = np.einsum("ij,ij->i", rests, rests)
        gradients[index, places] = rests @ slopes
    values, vectors = np.linalg.eigh(normal)
    kept = values > 1e-12 * max(float(values.max(initial=0.0)), 1e-300)
    return squares, gradients @ vectors[:, kept] / np.sqrt(values[kept])


def best_moves(squares: np.ndarray, pulls: np.ndarray) -> np.ndarray:
    """Moves (records,), of -REACH to REACH, that leave the least of squares (records, moves) less the squared sum of pulls.

    Changed one or two at a time, from every place at which all move alike.
    """
    starts = [np.full(len(squares), place) for place in range(squares.shape[1])]
    starts = [np.where(np.isfinite(squares[np.arange(len(squares)), one]), one, REACH) for one in starts]
    found = [_descended(squares, pulls, one) for one in starts]
    return min(found, key=lambda pair: pair[0])[1] - REACH


def _descended(squares: np.ndarray, pulls: np.ndarray, places: np.ndarray) -> tuple[float, np.ndarray]:
    """(least squares, places) from given places on, changing the one or the two that help most until none does."""
    rows = np.arange(len(squares))
    whole, drawn = squares[rows, places].sum(), pulls[rows, places].sum(axis=0)

    def left(changes: tuple[int, ...]) -> np.ndarray:
        """Squares over all places of the records that change, the others held; one axis for each."""
        some = list(changes)
        fixed, total = whole - squares[some, places[some]].sum(), drawn - pulls[some, places[some]].sum(axis=0)
        if len(changes) == 1:
            return fixed + squares[changes[0]] - np.sum((total + pulls[changes[0]]) ** 2, axis=1)
        one, two = changes
        both = total + pulls[one][:, None] + pulls[two][None]
        return fixed + squares[one][:, None] + squares[two][None] - np.sum(both**2, axis=2)

    pairs: list[tuple[int, ...]] = [(int(one), int(two)) for one in rows for two in rows if one < two]
    if not 2 <= len(rows) <= PAIRED:
        pairs = [(int(one),) for one in rows]
    best = float(whole - np.sum(drawn**2))
    while True:
        tried = [(left(pair), pair) for pair in pairs]
        costs, pair = min(tried, key=lambda one: float(np.min(one[0])))
        lowest = float(np.min(costs))
        if not lowest < best - 1e-9 * abs(best):
            return best, places
        best, places = lowest, places.copy()
        places[list(pair)] = np.unravel_index(int(np.argmin(costs)), costs.shape)
        whole, drawn = squares[rows, places].sum(), pulls[rows, places].sum(axis=0)
