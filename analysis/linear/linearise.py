"""Multipliers of the whole regenerative loop, effects and all, linearised about its periodic motion.

    dY/dphi = f(phi, Y(phi), Y(phi - delay), ...),    phi the spindle angle

The loop (`testbed.engines.regenerative_loop`) is handed in: it gives f and its partial derivatives as the effects' own files
have them. Between two breaks the motion is collocated at Gauss points (Hairer, Norsett and Wanner 1993, Solving Ordinary
Differential Equations I, section II.7; Engelborghs, Luzyanina, in 't Hout and Roose 2001, SIAM J. Sci. Comput. 22, 1593). The
periodic motion is found by Newton's method on the same points (`period_grid`), and the map of one period takes the delayed
values at those points, and the state, to the next. A period is one pitch, or a revolution where teeth are of unequal pitch; a
principal period of several is the product of their maps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from testbed.analysis.linear.period_grid import PeriodGrid, Stretch, gauss

TIME = 2
SAME = 1e-9  # of the largest singular value: below it is the rounding of differences
MOST_BYTES = 1_000_000_000  # of the map of one period
LONGEST = 240  # passes among which a principal period is sought


class Loop(Protocol):
    """What is asked of a loop; see `testbed.engines.regenerative_loop.RegenerativeLoop`."""

    unknowns: np.ndarray
    prescribed: np.ndarray
    nominal_speed: float
    fastest: float
    steady: bool
    period_passes: int
    periods_alike: int

    @property
    def segments(self) -> Sequence[Stretch]: ...

    @property
    def delays(self) -> Sequence[float]: ...

    @property
    def size(self) -> int: ...

    def rates(self, phases: np.ndarray, segment: int, number: int, states: np.ndarray, pasts: np.ndarray,
              scale: np.ndarray | None = None) -> Any: ...


@dataclass(frozen=True)
class LinearisedMotion:
    """The periodic motion of a loop and its multipliers.

    multipliers: over the principal period of `passes` tooth passes, largest modulus first, of a pair the upper first.
    entry_state (K,): the unknowns at the start of the period; phases (n,), motion (passes, n, K): the motion at the
    collocation points.
    mismatch: relative change of the spindle speed from one period to the next, 0 where the period is exact. out_of_work: the
    share of the cut in which the chip of a tooth would be negative.
    """

    multipliers: np.ndarray
    passes: int
    entry_state: np.ndarray
    phases: np.ndarray
    motion: np.ndarray
    mismatch: float
    out_of_work: float


def _grid(loop: Loop, coarser: float = 1.0) -> PeriodGrid:
    return PeriodGrid(loop.segments, loop.delays, loop.fastest / loop.nominal_speed, coarser)


class _Course:
    """A motion over the principal period at the grid's points: whole states (periods, n, size); time from `begin`."""

    def __init__(self, loop: Loop, grid: PeriodGrid, periods: int, first: int) -> None:
        self.loop, self.grid, self.first = loop, grid, first
        self.states = np.zeros((periods, grid.phases.size, loop.size))
        self.duration = periods * grid.period / loop.nominal_speed
        self.begin = first * grid.period / loop.nominal_speed
        for number in range(periods):
            self.states[number, :, TIME] = (number * grid.period + grid.phases) / loop.nominal_speed
        self.states[:, :, TIME] += self.begin

    def past(self, number: int) -> np.ndarray:
        """Whole states a delay ago, (n, delays, size); before the first period, those of the last one."""
        earlier = self.states[number - 1].copy()
        if number == 0:
            earlier[:, TIME] -= self.duration
        both = np.concatenate([earlier, self.states[number]])
        return np.stack([weights @ both for weights in self.grid.past], axis=1)

    def rates(self, number: int, scale: np.ndarray | None) -> list[Any]:
        """The loop's rates in each piece of period `number`."""
        past = self.past(number)
        return [self.loop.rates(self.grid.phases[piece.where], piece.segment, self.first + number,
                                self.states[number, piece.where], past[piece.where], scale)
                for piece in self.grid.pieces]

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
    past = np.concatenate([part.before[..., kept[:, None], kept] for parts in rates for part in parts]).reshape(-1, kept.size)
    told = np.flatnonzero(np.abs(past).sum(axis=0))
    _, sizes, sums = np.linalg.svd(past[:, told], full_matrices=False)
    rank = int(np.count_nonzero(sizes > SAME * sizes.max(initial=0.0)))
    found = np.zeros((rank, kept.size))
    found[:, told] = np.eye(rank) if rank == told.size else sums[:rank]
    return found


def _period_map(grid: PeriodGrid, parts: list[Any], load: list[np.ndarray], kept: np.ndarray,
                delayed: np.ndarray) -> np.ndarray:
    """All points' unknowns, then the end state, (n K + K, m + 1), of u = [delayed values, start state, 1].

    kept (K,): which unknowns; delayed (r, K): sums of them that act a delay later; load: f less its linear part, per piece.
    """
    width, late = kept.size, grid.late.size * len(delayed)
    m = late + width
    state = np.zeros((width, m + 1))
    state[:, late:m] = np.eye(width)
    rows = np.empty((grid.phases.size * width + width, m + 1))
    sums = np.zeros((grid.phases.size, len(delayed) * (m + 1)))
    for piece, reads, part, source in zip(grid.pieces, grid.reads, parts, load, strict=True):
        where, length = piece.where, piece.length
        count = where.stop - where.start
        _, inner, weights = gauss(count)
        now = part.now[:, kept[:, None], kept]
        driven = np.zeros((count, width, m + 1))
        for lane, before, points, here in reads:
            push = part.before[:, lane][:, kept[:, None], kept] @ delayed.T
            driven[:, :, :late] += np.einsum("nl,nkr->nklr", before, push).reshape(count, width, late)
            if points.size:
                driven += push @ (here @ sums[points]).reshape(count, len(delayed), m + 1)
        driven[:, :, m] += source[:, kept]
        left = np.eye(count * width) - length * np.einsum("ij,jkl->ikjl", inner, now).reshape(count * width, -1)
        right = state + length * np.einsum("ij,jkm->ikm", inner, driven)
        values = np.linalg.solve(left, right.reshape(count * width, -1)).reshape(count, width, m + 1)
        state = state + length * np.einsum("j,jkm->km", weights, np.einsum("jkl,jlm->jkm", now, values) + driven)
        sums[where] = (delayed @ values).reshape(count, -1)
        rows[where.start * width:where.stop * width] = values.reshape(count * width, -1)
    rows[-width:] = state
    return rows


def _next(grid: PeriodGrid, rows: np.ndarray, width: int, delayed: np.ndarray) -> np.ndarray:
    """The rows of a period's map that make up u of the next period (without its 1)."""
    points = (delayed @ rows[:-width].reshape(-1, width, rows.shape[1])[grid.late]).reshape(-1, rows.shape[1])
    return np.vstack([points, rows[-width:]])


def _newton_step(course: _Course, scale: np.ndarray) -> tuple[float, np.ndarray]:
    """Move the course to the periodic motion of its linearisation; returns the relative change and the start state."""
    loop, grid = course.loop, course.grid
    periods, points, width = course.states.shape[0], grid.phases.size, loop.unknowns.size
    rates = [course.rates(number, scale) for number in range(periods)]
    kept = np.arange(width)
    delayed = _delayed_sums(rates, kept)
    size = grid.late.size * len(delayed) + width + 1
    if 8 * points * width * size > MOST_BYTES:
        raise ValueError("the structure swings too often within a period: its map would not fit into memory")
    maps, total = [], np.eye(size)
    for number, parts in enumerate(rates):
        now, past = course.states[number][:, loop.unknowns], course.past(number)[:, :, loop.unknowns]
        load = [part.f - np.einsum("nij,nj->ni", part.now, now[piece.where])
                - np.einsum("ndij,ndj->ni", part.before, past[piece.where])
                for part, piece in zip(parts, grid.pieces, strict=True)]
        maps.append(_period_map(grid, parts, load, kept, delayed))
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
        return loop.period_passes * loop.periods_alike, 0.0
    most = longest // loop.period_passes
    course = _Course(loop, _grid(loop), most + 1, 0)
    course.set_clock()
    speed = np.array([np.concatenate([part.speed for part in course.rates(number, None)]) for number in range(most + 1)])
    candidates = np.arange(loop.periods_alike, most + 1, loop.periods_alike)
    mismatch = np.max(np.abs(speed[candidates] - speed[0]), axis=1) / loop.nominal_speed
    close = np.flatnonzero(mismatch < 1e-6)
    best = close[0] if close.size else int(np.argmin(mismatch))
    return int(candidates[best]) * loop.period_passes, float(mismatch[best])


def _sorted(values: np.ndarray) -> np.ndarray:
    return np.array(sorted(values, key=lambda mu: (-round(abs(mu), 12), -mu.real, -mu.imag)))


def linearise(loop: Loop, *, first_pass: int = 0, passes: int | None = None, tolerance: float = 1e-8,
              iterations: int = 40, coarser: float = 1.0) -> LinearisedMotion:
    """The periodic motion of `loop` and its characteristic multipliers over the principal period.

    first_pass: the pass after the entry at which slow changes (wear, a growing engagement) are held. passes: the
    principal period in tooth passes; found where None. coarser: pieces so many times as long, to see the error.
    The speed is a given course: what sets it (droop) takes its
    periodic value and is not perturbed. ValueError where no periodic motion is found, or where a law of the chip
    bends in it: a tooth then meets what was left longer ago than its delay.
    """
    passes, mismatch = (passes, 0.0) if passes else principal_passes(loop)
    count, grid = passes // loop.period_passes, _grid(loop, coarser)
    course = _Course(loop, grid, count, first_pass // loop.period_passes)
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
    if any(part.bent.any() for parts in rates for part in parts):
        raise ValueError("a law of the chip bends within the periodic motion: a tooth meets what was left longer ago")
    kept = np.flatnonzero(~loop.prescribed)
    delayed = _delayed_sums(rates, kept)
    total = np.eye(grid.late.size * len(delayed) + kept.size)
    for parts in rates:
        rows = _period_map(grid, parts, [np.zeros_like(part.f) for part in parts], kept, delayed)
        total = _next(grid, rows, kept.size, delayed)[:, :-1] @ total
    motion = course.states[:, :, loop.unknowns]
    return LinearisedMotion(_sorted(np.linalg.eigvals(total)), passes, start, grid.phases, motion, mismatch,
                            _out_of_work(grid, rates))


def _out_of_work(grid: PeriodGrid, rates: list[list[Any]]) -> float:
    inside, out = np.mean([[grid.integrate(np.concatenate([part.contact[:, which] for part in parts]))[1] for which in (0, 1)]
                           for parts in rates], axis=0)
    return float(out / inside) if inside else 0.0
