"""Spectral elements: the map of a delay equation over one delay, to an order that follows the oscillations of the cut.

Between two corners of the engagement the acceleration is a polynomial through Gauss points at which it meets the equation
(collocation for a second-order equation, de Boor and Swartz 1973, SIAM J. Numer. Anal. 10, 582; for multipliers of delay
equations, Engelborghs, Luzyanina, in 't Hout and Roose 2001, SIAM J. Sci. Comput. 22, 1593). The delayed motion is needed at
the same points, free flight is exact, and with p points an element is of order 2 p. The unknowns u^n of period n are the
displacements at the points of the cut and the state (displacement, velocity) at its end; u^n = Q u^{n-1}, and the
eigenvalues of Q are the characteristic multipliers. Times are in units of delay / 2 pi, so that Q has no units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from testbed.analysis.linear.characteristic import corrected
from testbed.analysis.linear.delay_equation import DelayEquation
from testbed.analysis.linear.temporal_elements import sort_multipliers, transition_matrix
from testbed.system.kernel_cache import kept

MOST_POINTS, LONGEST = 24, 16.0  # points of one element, rad in it: beyond, several elements cost less
FEWEST, A_RADIAN = 2.5, 0.65  # points of an element for 1e-5: measured on random cuts
TURN = 0.7 * 2.0 * math.pi  # rad in a delay by which the coefficients' own changes add to the swings
MOST_OF_A_TRIAL = 40.0 * 2.0 * math.pi  # rad in the cut
MOST_UNKNOWNS = 800  # about 150 oscillations in the cut
FINER = (0, 1, 2, 4, 6)  # points more in every element, as long as the largest multiplier has not settled
# of the largest multiplier over max(1, modulus), as the map has it: one point more leaves a tenth; fine: of one cut alone
TOLERANCE, FINE = 1e-5, 1e-6


def _tables() -> tuple[np.ndarray, ...]:
    """By points p of an element: nodes, weights (p); first and second integrals up to each node (p, p); all on 0 to 1."""
    nodes, weights = np.zeros((MOST_POINTS + 1, MOST_POINTS)), np.zeros((MOST_POINTS + 1, MOST_POINTS))
    once, twice = (np.zeros((MOST_POINTS + 1, MOST_POINTS, MOST_POINTS)) for _ in range(2))
    for p in range(1, MOST_POINTS + 1):
        points, gauss = legendre.leggauss(p)
        # the polynomial that is 1 at node j and 0 at the others, as a Legendre series: exact, since Gauss's rule is
        series = (0.5 * (2 * np.arange(p) + 1))[:, None] * legendre.legvander(points, p - 1).T * gauss
        nodes[p, :p], weights[p, :p] = 0.5 * (points + 1.0), 0.5 * gauss
        for table, times in ((once, 1), (twice, 2)):
            table[p, :p, :p] = 0.5**times * legendre.legval(points, legendre.legint(series, times, lbnd=-1)).T
    return nodes, weights, once, twice


TABLES = _tables()


@kept
def _eliminate(matrix, p, columns):
    """Solve in place: matrix (p, p + columns) holds left and right sides; the solution stands in its last columns."""
    width = p + columns
    for k in range(p):
        best = k
        for i in range(k + 1, p):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        if best != k:
            for j in range(k, width):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        inverse = 1.0 / matrix[k, k]
        for i in range(k + 1, p):
            factor = matrix[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, width):
                    matrix[i, j] -= factor * matrix[k, j]
    for k in range(p - 1, -1, -1):
        inverse = 1.0 / matrix[k, k]
        for j in range(p, width):
            matrix[k, j] *= inverse
        for i in range(k):
            factor = matrix[i, k]
            for j in range(p, width):
                matrix[i, j] -= factor * matrix[k, j]


@kept(fastmath=True)
def element_map(h, p, damping, stiffness, delayed, work, local, nodes, weights, once, twice):
    """What one element makes of [its points a delay ago (p), its start state (2)]: its points (p) and its end state (2).

    h: its length; coefficients (p,). Written into `local` (p + 2, p + 2); work (p, 2 p + 2).
    """
    c, b, first, second = nodes[p], weights[p], once[p], twice[p]
    h2 = h * h
    for i in range(p):
        for j in range(p):
            work[i, j] = h * damping[i] * first[i, j] + h2 * stiffness[i] * second[i, j]
            work[i, p + j] = 0.0
        work[i, i] += 1.0
        work[i, p + i] = delayed[i]
        work[i, 2 * p] = -stiffness[i]
        work[i, 2 * p + 1] = -(damping[i] + stiffness[i] * c[i] * h)
    _eliminate(work, p, p + 2)
    for i in range(p):
        for j in range(p + 2):
            local[i, j] = 0.0
        for k in range(p):
            factor = h2 * second[i, k]
            for j in range(p + 2):
                local[i, j] += factor * work[k, p + j]
        local[i, p] += 1.0
        local[i, p + 1] += c[i] * h
    for j in range(p + 2):
        local[p, j], local[p + 1, j] = 0.0, 0.0
    for k in range(p):
        speed = h * b[k]
        place = h * (1.0 - c[k]) * speed
        for j in range(p + 2):
            local[p, j] += place * work[k, p + j]
            local[p + 1, j] += speed * work[k, p + j]
    local[p, p] += 1.0
    local[p, p + 1] += h
    local[p + 1, p + 1] += 1.0


@kept(fastmath=True)
def dense_map(points, locals_, flight, q):
    """Q (n, n) from the elements' own maps (E, p + 2, p + 2) and the free flight (2, 2)."""
    n = q.shape[0]
    state = np.zeros((2, n))
    after = np.empty((2, n))
    for i in range(2):
        for j in range(2):
            state[i, n - 2 + j] = flight[i, j]
    begin = 0
    for e in range(points.size):
        p = points[e]
        local = locals_[e]
        for i in range(p + 2):
            x, v = local[i, p], local[i, p + 1]
            row = q[begin + i] if i < p else after[i - p]
            for j in range(n):
                row[j] = x * state[0, j] + v * state[1, j]
            for j in range(p):
                row[begin + j] += local[i, j]
        for j in range(n):
            state[0, j], state[1, j] = after[0, j], after[1, j]
        begin += p
    for j in range(n):
        q[n - 2, j], q[n - 1, j] = state[0, j], state[1, j]


@kept(fastmath=True)
def times_map(points, locals_, flight, u, result):
    """result <- Q u without Q, in a time that grows with n alone."""
    n = u.size
    x = flight[0, 0] * u[n - 2] + flight[0, 1] * u[n - 1]
    v = flight[1, 0] * u[n - 2] + flight[1, 1] * u[n - 1]
    begin = 0
    for e in range(points.size):
        p = points[e]
        local = locals_[e]
        next_x, next_v = 0.0, 0.0
        for i in range(p + 2):
            total = local[i, p] * x + local[i, p + 1] * v
            for j in range(p):
                total += local[i, j] * u[begin + j]
            if i < p:
                result[begin + i] = total
            elif i == p:
                next_x = total
            else:
                next_v = total
        x, v = next_x, next_v
        begin += p
    result[n - 2], result[n - 1] = x, v


@dataclass(frozen=True)
class Elements:
    """How the cut is divided: edges (E + 1,) as fractions of the delay, points of every element (E,)."""

    edges: np.ndarray
    points: np.ndarray

    @property
    def unknowns(self) -> int:
        """Of the map."""
        return int(self.points.sum()) + 2

    @property
    def lengths(self) -> np.ndarray:
        """Of the elements (E,), in units of delay / 2 pi."""
        return 2.0 * math.pi * np.diff(self.edges)

    def more(self, points: int) -> Elements:
        """The same elements with so many points more in each."""
        return Elements(self.edges, np.minimum(self.points + points, MOST_POINTS))

    def times(self) -> np.ndarray:
        """All points in turn, as fractions of the delay."""
        lengths = np.diff(self.edges)
        return np.concatenate([start + length * TABLES[0][p, :p]
                               for start, length, p in zip(self.edges[:-1], lengths, self.points, strict=True)])


def divided(breaks: np.ndarray, swing: float) -> Elements:
    """Elements for a cut with corners at `breaks` (fractions of the delay) while the motion turns by `swing` rad a delay.

    ArithmeticError if that is more than can be resolved.
    """
    phases = np.diff(breaks) * (swing + TURN)
    if not phases.sum() < MOST_UNKNOWNS / A_RADIAN:
        raise ArithmeticError(f"the structure swings {np.ptp(breaks) * swing / (2.0 * math.pi):.3g} times in the cut, "
                              "more than can be resolved")
    parts = np.maximum(np.ceil(phases / LONGEST), 1.0).astype(int)
    points = np.ceil(FEWEST + A_RADIAN * phases / parts).astype(int)
    edges = [np.linspace(low, high, count + 1)[:-1] for low, high, count in zip(breaks[:-1], breaks[1:], parts, strict=True)]
    return Elements(np.concatenate([*edges, breaks[-1:]]), np.repeat(points, parts))


def sampled(equation: DelayEquation) -> np.ndarray:
    """Times (s) that show how large the coefficients become."""
    return np.concatenate([np.linspace(low, high, 18)[1:-1]
                           for low, high in zip(equation.breaks[:-1], equation.breaks[1:], strict=True)])


def swing_rate(damping: float, stiffness: float, changing: np.ndarray, added: float) -> np.ndarray:
    """At most so fast (rad/s) does the motion turn, for multipliers of modulus about 1.

    damping (1/s), stiffness (1/s^2): constants. changing: largest periodic and delayed stiffness together; added: damping.
    """
    return np.sqrt(abs(stiffness) + changing) + 0.5 * (abs(damping) + added)


def _swing(equation: DelayEquation) -> float:
    """The same over a delay, rad."""
    times = sampled(equation)
    changing = np.abs(equation.periodic_stiffness(times)).max() + np.abs(equation.delayed(times)).max()
    added = float(np.abs(equation.periodic_damping(times)).max())
    return equation.delay * float(swing_rate(equation.damping, equation.stiffness, changing, added))


@kept
def element_maps(lengths, points, damping, stiffness, delayed, nodes, weights, once, twice):
    """The maps of all elements, (E, most points + 2, most points + 2); coefficients (sum of points,)."""
    most = points.max()
    locals_, work = np.empty((points.size, most + 2, most + 2)), np.empty((most, 2 * most + 2))
    begin = 0
    for e in range(points.size):
        end = begin + points[e]
        element_map(lengths[e], points[e], damping[begin:end], stiffness[begin:end], delayed[begin:end], work, locals_[e],
                    nodes, weights, once, twice)
        begin = end
    return locals_


def coefficients(equation: DelayEquation, elements: Elements) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(damping, stiffness, delayed) of an equation at all points, in units of delay / 2 pi."""
    unit = equation.delay / (2.0 * math.pi)
    times = elements.times() * equation.delay
    return (unit * (equation.damping + equation.periodic_damping(times)),
            unit**2 * (equation.stiffness + equation.periodic_stiffness(times)), unit**2 * equation.delayed(times))


def plain_multipliers(equation: DelayEquation) -> np.ndarray:
    """Multipliers, largest first, of the map of the first order alone: right to about 1e-5, but nothing is checked.

    For fits, whose far trials may ask for what cannot be resolved: those are taken as far as 40 oscillations in the cut.
    """
    breaks = np.array(equation.breaks) / equation.delay
    elements = divided(breaks, min(_swing(equation), MOST_OF_A_TRIAL / float(breaks[-1])))
    return _of_map(equation, elements, _flight(equation))


def _flight(equation: DelayEquation) -> np.ndarray:
    unit = equation.delay / (2.0 * math.pi)
    return transition_matrix(unit * equation.damping, unit**2 * equation.stiffness, equation.free_flight / unit)


def _of_map(equation: DelayEquation, elements: Elements, flight: np.ndarray) -> np.ndarray:
    maps = element_maps(elements.lengths, elements.points, *coefficients(equation, elements), *TABLES)
    q = np.empty((elements.unknowns, elements.unknowns))
    dense_map(elements.points, maps, flight, q)
    return sort_multipliers(np.linalg.eigvals(q))


def multipliers(equation: DelayEquation, tolerance: float = FINE) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers (n,), complex, largest modulus first, of a pair the upper first; and an estimate of the error of each.

    The estimate is the correction by the characteristic equation at a higher order, some ten times the error left. The order
    is raised until it is below `tolerance` * max(1, modulus) for the largest; small ones need not settle. ArithmeticError if
    it does not come below TOLERANCE.
    """
    elements, flight = divided(np.array(equation.breaks) / equation.delay, _swing(equation)), _flight(equation)
    most = np.empty((MOST_POINTS, MOST_POINTS + 2), dtype=complex)
    for more in FINER:
        found, finer = _of_map(equation, elements.more(more), flight), elements.more(more + 1)
        known = coefficients(equation, finer)
        pairs = [corrected(value, finer.lengths, finer.points, *known, flight, TABLES, most) for value in found]
        values, errors = (np.array(part) for part in zip(*pairs, strict=True))
        order = np.argsort(-np.round(np.abs(values), 12), kind="stable")
        settled = errors[order[0]] / max(1.0, abs(values[order[0]]))
        if settled <= tolerance:
            break
    if settled > max(tolerance, TOLERANCE):
        raise ArithmeticError(f"the largest multiplier did not settle to {TOLERANCE:g}")
    return values[order], errors[order]
