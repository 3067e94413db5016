"""Multipliers of the whole regenerative loop, effects and all, linearised about its periodic motion.

    dY/dphi = f(phi, Y(phi), Y(phi - pitch)),    phi the spindle angle

The loop (`testbed.engines.regenerative_loop`) is handed in: it gives f and its partial derivatives as the effects' own
files have them. Between two breaks the motion is collocated at Gauss points (Hairer, Norsett and Wanner 1993, Solving
Ordinary Differential Equations I, section II.7; Engelborghs, Luzyanina, in 't Hout and Roose 2001, SIAM J. Sci. Comput.
22, 1593). The periodic motion is found by Newton's method on the same points, and the map of one pass takes the delayed
values at those points, and the state, to the next; a principal period of several passes is the product of its maps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

PHASE = 1.0  # rad of the fastest vibration in one piece
ANGLE = 0.5  # rad of spindle angle in one piece
TIME = 2
SAME = 1e-9  # of the largest singular value: below it is the rounding of differences
MOST_BYTES = 1_000_000_000  # of the map of one pass
LONGEST = 240  # passes among which a principal period is sought


class Loop(Protocol):
    """What is asked of a loop; see `testbed.engines.regenerative_loop.RegenerativeLoop`."""

    unknowns: np.ndarray
    prescribed: np.ndarray
    breaks: np.ndarray
    teeth: np.ndarray
    pitch: float
    nominal_speed: float
    fastest: float
    steady: bool
    passes_a_turn: int

    @property
    def size(self) -> int: ...

    def rates(self, phases: np.ndarray, pass_number: int, teeth: int, states: np.ndarray, pasts: np.ndarray,
              scale: np.ndarray | None = None) -> Any: ...


@dataclass(frozen=True)
class LinearisedMotion:
    """The periodic motion of a loop and its multipliers.

    multipliers: over the principal period of `passes` tooth passes, largest modulus first, of a pair the upper first.
    entry_state (K,): the unknowns at the start of the period; phases (n,), motion (passes, n, K): the motion at the
    collocation points.
    mismatch: relative change of the spindle speed from one period to the next, 0 where the period is exact.
    """

    multipliers: np.ndarray
    passes: int
    entry_state: np.ndarray
    phases: np.ndarray
    motion: np.ndarray
    mismatch: float


@lru_cache(maxsize=4)
def _gauss(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes, integrals up to each node (count, count), and over the whole, of the polynomials through Gauss points."""
    points, weights = np.polynomial.legendre.leggauss(count)
    nodes = 0.5 * (points + 1.0)
    powers = np.arange(count)
    values = nodes[:, None] ** powers
    inner = nodes[:, None] ** (powers + 1) / (powers + 1)
    return nodes, np.linalg.solve(values.T, inner.T).T, 0.5 * weights


class _Grid:
    """Collocation points of one pass: pieces (start, length, teeth, slice of its points); `late`: points in the cut."""

    def __init__(self, loop: Loop, coarser: float = 1.0) -> None:
        longest = coarser * min(ANGLE, PHASE * loop.nominal_speed / loop.fastest)
        self.pieces: list[tuple[float, float, int, slice]] = []
        phases: list[float] = []
        for low, high, teeth in zip(loop.breaks[:-1], loop.breaks[1:], loop.teeth, strict=True):
            parts = math.ceil((high - low) / longest)
            length = (high - low) / parts
            count = 8 if length > 0.15 * longest else 4
            for part in range(parts):
                start = low + part * length
                self.pieces.append((start, length, int(teeth), slice(len(phases), len(phases) + count)))
                phases.extend(start + length * _gauss(count)[0])
        self.phases = np.array(phases)
        cut = [where for _, _, teeth, where in self.pieces if teeth > 0]
        self.late = np.concatenate([np.arange(where.start, where.stop) for where in cut] or [np.empty(0, dtype=int)])

    def integrate(self, rate: np.ndarray) -> tuple[np.ndarray, float]:
        """Integral of `rate` (n,) over the phase, up to each point and over the pass."""
        total, inner = 0.0, np.empty_like(rate)
        for _, length, _, where in self.pieces:
            _, matrix, weights = _gauss(where.stop - where.start)
            inner[where] = total + length * (matrix @ rate[where])
            total += length * float(weights @ rate[where])
        return inner, total


class _Course:
    """A motion over the principal period at the grid's points: whole states (passes, n, size); time from `begin`."""

    def __init__(self, loop: Loop, grid: _Grid, passes: int, first_pass: int) -> None:
        self.loop, self.grid, self.first_pass = loop, grid, first_pass
        self.states = np.zeros((passes, grid.phases.size, loop.size))
        self.duration = passes * loop.pitch / loop.nominal_speed
        self.begin = first_pass * loop.pitch / loop.nominal_speed
        for number in range(passes):
            self.states[number, :, TIME] = (number * loop.pitch + grid.phases) / loop.nominal_speed
        self.states[:, :, TIME] += self.begin

    def past(self, number: int) -> np.ndarray:
        """Whole states one pitch before pass `number`; before the first pass, the last one a period earlier."""
        past = self.states[number - 1].copy()
        if number == 0:
            past[:, TIME] -= self.duration
        return past

    def rates(self, number: int, scale: np.ndarray | None) -> list[Any]:
        """The loop's rates in each piece of pass `number`."""
        past = self.past(number)
        return [self.loop.rates(self.grid.phases[where], self.first_pass + number, teeth, self.states[number, where],
                                past[where], scale)
                for _, _, teeth, where in self.grid.pieces]

    def set_clock(self) -> None:
        """Let the time follow from the speed, by Picard's iteration."""
        for _ in range(60):
            start, change = self.begin, 0.0
            for number in range(self.states.shape[0]):
                speed = np.concatenate([part.speed for part in self.rates(number, None)])
                inner, total = self.grid.integrate(1.0 / speed)
                change = max(change, float(np.max(np.abs(start + inner - self.states[number, :, TIME]))))
                self.states[number, :, TIME] = start + inner
                start += total
            self.duration = start - self.begin
            if change < 1e-14 * max(1.0, abs(start)):
                return
        raise ValueError("the spindle's course in time was not found")


def _delayed_sums(rates: list[list[Any]], kept: np.ndarray) -> np.ndarray:
    """Sums of the unknowns `kept` (K,) whose past matters, (r, K): of many modes no more than the motion along x and along y.

    An unknown by itself where each tells something else.
    """
    past = np.concatenate([part.before[:, kept[:, None], kept] for parts in rates for part in parts]).reshape(-1, kept.size)
    told = np.flatnonzero(np.abs(past).sum(axis=0))
    _, sizes, sums = np.linalg.svd(past[:, told], full_matrices=False)
    rank = int(np.count_nonzero(sizes > SAME * sizes.max(initial=0.0)))
    found = np.zeros((rank, kept.size))
    found[:, told] = np.eye(rank) if rank == told.size else sums[:rank]
    return found


def _pass_map(grid: _Grid, parts: list[Any], load: list[np.ndarray], kept: np.ndarray,
              delayed: np.ndarray) -> np.ndarray:
    """All points' unknowns, then the end state, (n K + K, m + 1), of u = [delayed values, start state, 1].

    kept (K,): which unknowns; delayed (r, K): sums of them that act one pitch later; load: f less its linear part, per piece.
    """
    width, late = kept.size, len(delayed)
    m = grid.late.size * late + width
    at = 0
    state = np.zeros((width, m + 1))
    state[:, m - width:m] = np.eye(width)
    rows = np.empty((grid.phases.size * width + width, m + 1))
    for (_, length, teeth, where), part, source in zip(grid.pieces, parts, load, strict=True):
        count = where.stop - where.start
        _, inner, weights = _gauss(count)
        now = part.now[:, kept[:, None], kept]
        driven = np.zeros((count, width, m + 1))
        for n in range(count if teeth else 0):
            driven[n, :, at:at + late] = part.before[n][np.ix_(kept, kept)] @ delayed.T
            at += late
        driven[:, :, m] = source[:, kept]
        left = np.eye(count * width) - length * np.einsum("ij,jkl->ikjl", inner, now).reshape(count * width, -1)
        right = state + length * np.einsum("ij,jkm->ikm", inner, driven)
        values = np.linalg.solve(left, right.reshape(count * width, -1)).reshape(count, width, m + 1)
        state = state + length * np.einsum("j,jkm->km", weights, np.einsum("jkl,jlm->jkm", now, values) + driven)
        rows[where.start * width:where.stop * width] = values.reshape(count * width, -1)
    rows[-width:] = state
    return rows


def _next(grid: _Grid, rows: np.ndarray, width: int, delayed: np.ndarray) -> np.ndarray:
    """The rows of a pass map that make up u of the next pass (without its 1)."""
    points = (delayed @ rows[:-width].reshape(-1, width, rows.shape[1])[grid.late]).reshape(-1, rows.shape[1])
    return np.vstack([points, rows[-width:]])


def _newton_step(course: _Course, scale: np.ndarray) -> tuple[float, np.ndarray]:
    """Move the course to the periodic motion of its linearisation; returns the relative change and the start state."""
    loop, grid = course.loop, course.grid
    passes, points, width = course.states.shape[0], grid.phases.size, loop.unknowns.size
    rates = [course.rates(number, scale) for number in range(passes)]
    kept = np.arange(width)
    delayed = _delayed_sums(rates, kept)
    size = grid.late.size * len(delayed) + width + 1
    if 8 * points * width * size > MOST_BYTES:
        raise ValueError("the structure swings too often within a tooth pass: its map would not fit into memory")
    maps, total = [], np.eye(size)
    for number, parts in enumerate(rates):
        now, past = course.states[number][:, loop.unknowns], course.past(number)[:, loop.unknowns]
        load = [part.f - np.einsum("nij,nj->ni", part.now, now[where])
                - np.einsum("nij,nj->ni", part.before, past[where])
                for part, (_, _, _, where) in zip(parts, grid.pieces, strict=True)]
        maps.append(_pass_map(grid, parts, load, kept, delayed))
        total = np.vstack([_next(grid, maps[-1], width, delayed), total[-1:] * 0.0]) @ total
        total[-1, -1] = 1.0
    u = np.append(np.linalg.solve(np.eye(total.shape[0] - 1) - total[:-1, :-1], total[:-1, -1]), 1.0)
    change, start = 0.0, u[-1 - width:-1]
    for number, rows in enumerate(maps):
        values = (rows[:-width] @ u).reshape(points, width)
        size = np.maximum(np.max(np.abs(values), axis=0), 1e-7)  # a constant motion has a velocity of rounding only
        change = max(change, float(np.max(np.abs(values - course.states[number][:, loop.unknowns]) / size)))
        course.states[number][:, loop.unknowns] = values
        u = np.append(_next(grid, rows, width, delayed) @ u, 1.0)
    return change, start


def principal_passes(loop: Loop, longest: int = LONGEST) -> tuple[int, float]:
    """Tooth passes after which the spindle and the teeth repeat, and the relative mismatch of the speed then.

    The smallest number with a mismatch below 1e-6; where there is none up to `longest`, the number with the least.
    """
    if loop.steady:
        return loop.passes_a_turn, 0.0
    grid = _Grid(loop)
    course = _Course(loop, grid, longest + 1, 0)
    course.set_clock()
    speed = np.array([np.concatenate([part.speed for part in course.rates(number, None)])
                      for number in range(longest + 1)])
    candidates = np.arange(loop.passes_a_turn, longest + 1, loop.passes_a_turn)
    mismatch = np.max(np.abs(speed[candidates] - speed[0]), axis=1) / loop.nominal_speed
    close = np.flatnonzero(mismatch < 1e-6)
    best = close[0] if close.size else int(np.argmin(mismatch))
    return int(candidates[best]), float(mismatch[best])


def _sorted(values: np.ndarray) -> np.ndarray:
    return np.array(sorted(values, key=lambda mu: (-round(abs(mu), 12), -mu.real, -mu.imag)))


def linearise(loop: Loop, *, first_pass: int = 0, passes: int | None = None, tolerance: float = 1e-8,
              iterations: int = 40, coarser: float = 1.0) -> LinearisedMotion:
    """The periodic motion of `loop` and its characteristic multipliers over the principal period.

    first_pass: the pass after the entry at which slow changes (wear, a growing engagement) are held. passes: the
    principal period in tooth passes; found where None. coarser: pieces so many times as long, to see the error.
    The speed is a given course: what sets it (droop) takes its
    periodic value and is not perturbed. ValueError where no periodic motion is found, or where a tooth leaves the cut
    in it: then several delays act at once and there is no map of one.
    """
    count, mismatch = (passes, 0.0) if passes else principal_passes(loop)
    grid = _Grid(loop, coarser)
    course = _Course(loop, grid, count, first_pass)
    width = loop.unknowns.size
    scale = np.full(width, 1e-7)
    for _ in range(iterations):
        if not loop.steady:
            course.set_clock()
        change, start = _newton_step(course, scale)
        largest = np.max(np.abs(course.states[:, :, loop.unknowns]), axis=(0, 1))
        scale = np.where(largest > 1e-12, 1e-4 * largest, 1e-7)
        if change < tolerance:
            break
    else:
        raise ValueError("no periodic motion was found: the law may have kinks, or the cut a motion of another period")
    rates = [course.rates(number, scale) for number in range(count)]
    if any(part.lost.any() for parts in rates for part in parts):
        raise ValueError("a tooth leaves the cut within the periodic motion: no linear delay equation of one delay")
    kept = np.flatnonzero(~loop.prescribed)
    delayed = _delayed_sums(rates, kept)
    total = np.eye(grid.late.size * len(delayed) + kept.size)
    for parts in rates:
        rows = _pass_map(grid, parts, [np.zeros_like(part.f) for part in parts], kept, delayed)
        total = _next(grid, rows, kept.size, delayed)[:, :-1] @ total
    motion = course.states[:, :, loop.unknowns]
    return LinearisedMotion(_sorted(np.linalg.eigvals(total)), count, start, grid.phases, motion, mismatch)
