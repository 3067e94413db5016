"""Collocation points of a period of a delay equation, and from which of them what was a delay ago is read.

A delay is a whole period, where the points stand at the same angles; or it is shorter, and what was is read from the polynomial
through the Gauss points of the piece in which that angle lies, of the same period or the one before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy import sparse

PHASE = 1.0  # rad of the fastest vibration in one piece
ANGLE = 0.5  # rad of spindle angle in one piece


class Stretch(Protocol):
    """What is asked of a segment of the period; see `testbed.engines.regenerative_loop.Segment`."""

    @property
    def low(self) -> float: ...

    @property
    def high(self) -> float: ...

    @property
    def lanes(self) -> list[int]: ...


class Read(NamedTuple):
    """What a piece reads for one delay: weights (its points, late points) of the period before; points of this one, weights."""

    lane: int
    before: np.ndarray
    points: np.ndarray
    here: np.ndarray


@dataclass(frozen=True)
class Piece:
    """A stretch between two breaks that is collocated; where: its points among those of the period."""

    start: float
    length: float
    segment: int
    where: slice


@lru_cache(maxsize=4)
def gauss(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes, integrals up to each node (count, count), and over the whole, of the polynomials through Gauss points."""
    points, weights = np.polynomial.legendre.leggauss(count)
    nodes = 0.5 * (points + 1.0)
    powers = np.arange(count)
    values = nodes[:, None] ** powers
    inner = nodes[:, None] ** (powers + 1) / (powers + 1)
    return nodes, np.linalg.solve(values.T, inner.T).T, 0.5 * weights


def _through(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Weights (n, count) of the values at the nodes for the polynomial through them at the places `at` (n,)."""
    others = [np.delete(nodes, one) for one in range(nodes.size)]
    return np.column_stack([np.prod((at[:, None] - rest) / (node - rest), axis=1)
                            for node, rest in zip(nodes, others, strict=True)])


class PeriodGrid:
    """Collocation points of one period.

    phases (n,), rad; late: points of the period before of which something is read; past: for each delay the weights (n, 2 n)
    of what is read, of the period before and of this one; reads: of each piece, from late points and from this period.
    """

    def __init__(self, segments: Sequence[Stretch], delays: Sequence[float], swing: float, coarser: float = 1.0) -> None:
        """segments, delays: of the period, rad. swing: rad of the fastest vibration in a rad of the spindle."""
        self.period = segments[-1].high
        longest = coarser * min(ANGLE, PHASE / swing)
        if delays[0] != self.period:
            longest = min(longest, 0.5 * min(delays))  # what is read lies in a piece before
        self.pieces: list[Piece] = []
        phases: list[float] = []
        for number, segment in enumerate(segments):
            parts = math.ceil((segment.high - segment.low) / longest)
            length = (segment.high - segment.low) / parts
            count = 8 if length > 0.15 * longest else 4
            for part in range(parts):
                start = segment.low + part * length
                self.pieces.append(Piece(start, length, number, slice(len(phases), len(phases) + count)))
                phases.extend(start + length * gauss(count)[0])
        self.phases = np.array(phases)
        self.past = [self._read(segments, lane, delay) for lane, delay in enumerate(delays)]
        size = self.phases.size
        self.late = np.unique(np.concatenate([weights.indices[weights.indices < size] for weights in self.past]))
        self.reads = [[self._part(piece, lane) for lane in segments[piece.segment].lanes] for piece in self.pieces]

    def _part(self, piece: Piece, lane: int) -> Read:
        weights, where, size = self.past[lane], piece.where, self.phases.size
        begin, end = weights.indptr[where.start], weights.indptr[where.stop]
        rows = np.repeat(np.arange(where.stop - where.start), np.diff(weights.indptr[where.start : where.stop + 1]))
        columns, values = weights.indices[begin:end], weights.data[begin:end]
        early = columns < size
        before = np.zeros((where.stop - where.start, self.late.size))
        before[rows[early], np.searchsorted(self.late, columns[early])] = values[early]
        points = np.unique(columns[~early])
        here = np.zeros((where.stop - where.start, points.size))
        here[rows[~early], np.searchsorted(points, columns[~early])] = values[~early]
        return Read(lane, before, points - size, here)

    def _read(self, segments: Sequence[Stretch], lane: int, delay: float) -> Any:
        size = self.phases.size
        wanted = np.concatenate([np.arange(piece.where.start, piece.where.stop) for piece in self.pieces
                                 if lane in segments[piece.segment].lanes] or [np.empty(0, dtype=int)])
        if delay == self.period:
            return sparse.csr_matrix((np.ones(wanted.size), (wanted, wanted)), shape=(size, 2 * size))
        angle = self.phases[wanted] - delay
        earlier = angle < 0.0
        angle[earlier] += self.period
        place = np.searchsorted([piece.start for piece in self.pieces], angle, side="right") - 1
        rows, columns, weights = [], [], []
        for number in np.unique(place):
            piece, mine = self.pieces[number], np.flatnonzero(place == number)
            nodes = gauss(piece.where.stop - piece.where.start)[0]
            found = _through(nodes, (angle[mine] - piece.start) / piece.length)
            rows.append(np.repeat(wanted[mine], nodes.size))
            columns.append((np.arange(piece.where.start, piece.where.stop) + np.where(earlier[mine], 0, size)[:, None]).ravel())
            weights.append(found.ravel())
        return sparse.csr_matrix((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))),
                                 shape=(size, 2 * size))

    def integrate(self, rate: np.ndarray) -> tuple[np.ndarray, float]:
        """Integral of `rate` (n,) over the phase, up to each point and over the period."""
        total, inner = 0.0, np.empty_like(rate)
        for piece in self.pieces:
            _, matrix, weights = gauss(piece.where.stop - piece.where.start)
            inner[piece.where] = total + piece.length * (matrix @ rate[piece.where])
            total += piece.length * float(weights @ rate[piece.where])
        return inner, total
