"""The correction of many multipliers of one mode, side by side, by the characteristic equation.

For a motion that a delay multiplies by mu, x' - x = -k x with k = 1 - 1 / mu (`lane_maps`), and the state's transition over an
element is a power series in k whose terms vanish as those of a cosine do. What stands before its powers is the same for all
depths but for a power of the depth, so that a step of Newton's method on det(transition - mu) costs little. As `characteristic`
does for one cut, it is taken at an order above the map's, and its length is the error before it.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.linear.characteristic import CORRECTED
from testbed.analysis.linear.lane_maps import alike, room, spread, structure
from testbed.system.kernel_cache import kept

TERMS = 60  # of the series, at most
SMALLEST = 1e-22  # of a state's transition, where the series ends: what more cells together would add changes no digit
REACH = 4.0  # |k| up to which it does: |mu| down to a third
TINY = 1e-24  # square of a multiplier that is left as it is
SMALL, CANCELLED = 1e-26, 1e8  # squares: the last term of a cell, and one so large that four digits are lost


@kept
def _moments(parts, stiffness, factor, points, reach, moments):
    """What (-k)^1, (-k)^2, ... stand before in the transition of each element, (E, TERMS, 2, 2), and how many they are (E,).

    stiffness (points, 1, 1) times `factor`: G. reach: beyond this |k| more might be asked for.
    """
    answers, starts, ends, _, _ = parts
    size, first = starts.shape[1], 0
    motion, after, counts = np.empty((size, 2)), np.empty((size, 2)), np.full(points.size, TERMS)
    for e in range(points.size):
        p, power = points[e], 1.0
        for i in range(p):
            motion[i, 0], motion[i, 1] = starts[e, i, 0], starts[e, i, 1]
        for order in range(TERMS):
            largest = 0.0
            for i in range(p):
                pull = factor * stiffness[first + i, 0, 0]
                motion[i, 0], motion[i, 1] = pull * motion[i, 0], pull * motion[i, 1]
            for j in range(2):
                for i in range(2):
                    total = 0.0
                    for k in range(p):
                        total += ends[e, i, k] * motion[k, j]
                    moments[e, order, i, j] = total
                    largest = max(largest, abs(total))
            power *= reach
            if largest * power < SMALLEST:
                counts[e] = order + 1
                break
            for i in range(p):
                x, y = 0.0, 0.0
                for k in range(p):
                    x += answers[e, i, k] * motion[k, 0]
                    y += answers[e, i, k] * motion[k, 1]
                after[i, 0], after[i, 1] = x, y
            motion, after = after, motion
        first += p
    return counts


@kept(fastmath={"contract"}, noalias=True)
def _evaluated(carry, moments, count, share, powers, found, large):
    """An element's transition and its derivative by k, in every lane: found (2, real and imaginary part, 2, 2, lanes).

    share (2, lanes): -k; powers (5, lanes). large (lanes): raised to the largest term's square, to infinity where the last one
    is not small.
    """
    lanes = large.size
    found[:] = 0.0
    for l in range(lanes):
        powers[0, l], powers[1, l] = 1.0, 0.0
    for i in range(2):
        for j in range(2):
            for l in range(lanes):
                found[0, 0, i, j, l] = carry[i, j, l]
    for order in range(count):
        for l in range(lanes):
            powers[2, l] = powers[0, l] * share[0, l] - powers[1, l] * share[1, l]
            powers[3, l] = powers[0, l] * share[1, l] + powers[1, l] * share[0, l]
            powers[4, l] = 0.0
        for i in range(2):
            for j in range(2):
                for l in range(lanes):
                    moment = moments[order, i, j, l]
                    turned = -(order + 1.0) * moment
                    found[0, 0, i, j, l] += powers[2, l] * moment
                    found[0, 1, i, j, l] += powers[3, l] * moment
                    found[1, 0, i, j, l] += powers[0, l] * turned
                    found[1, 1, i, j, l] += powers[1, l] * turned
                    powers[4, l] += moment * moment
        for l in range(lanes):
            powers[0, l], powers[1, l] = powers[2, l], powers[3, l]
            powers[4, l] *= powers[2, l] * powers[2, l] + powers[3, l] * powers[3, l]
            large[l] = max(large[l], powers[4, l])
    for l in range(lanes):
        if not powers[4, l] < SMALL:
            large[l] = math.inf


@kept(fastmath={"contract"}, noalias=True)
def _chained(found, transition, after):
    """The transition over a period and its derivative by k, after another element: after <- found transition, in every lane."""
    lanes = after.shape[4]
    after[:] = 0.0
    for i in range(2):
        for j in range(2):
            for k in range(2):
                for l in range(lanes):
                    x, y = found[0, 0, i, k, l], found[0, 1, i, k, l]
                    u, v = transition[0, 0, k, j, l], transition[0, 1, k, j, l]
                    after[0, 0, i, j, l] += x * u - y * v
                    after[0, 1, i, j, l] += x * v + y * u
                    after[1, 0, i, j, l] += (x * transition[1, 0, k, j, l] - y * transition[1, 1, k, j, l]
                                             + found[1, 0, i, k, l] * u - found[1, 1, i, k, l] * v)
                    after[1, 1, i, j, l] += (x * transition[1, 1, k, j, l] + y * transition[1, 0, k, j, l]
                                             + found[1, 0, i, k, l] * v + found[1, 1, i, k, l] * u)


@kept
def _entry(transition, part, i, j, lane):
    return complex(transition[part, 0, i, j, lane], transition[part, 1, i, j, lane])


@kept
def _corrected(mu, transition, turn, lane):
    """A multiplier after a step of Newton's method, and the step's length; the multiplier as it was if that is too long.

    turn: derivative of k by mu.
    """
    a, b = _entry(transition, 0, 0, 0, lane) - mu, _entry(transition, 0, 0, 1, lane)
    c, d = _entry(transition, 0, 1, 0, lane), _entry(transition, 0, 1, 1, lane) - mu
    slope = ((_entry(transition, 1, 0, 0, lane) * turn - 1.0) * d + a * (_entry(transition, 1, 1, 1, lane) * turn - 1.0)
             - _entry(transition, 1, 0, 1, lane) * turn * c - b * _entry(transition, 1, 1, 0, lane) * turn)
    steep = slope.real**2 + slope.imag**2
    if not steep > 0.0:
        return mu, math.inf
    step = (a * d - b * c) * complex(slope.real / steep, -slope.imag / steep)
    length = math.sqrt(step.real**2 + step.imag**2)
    if not length <= CORRECTED * math.sqrt(mu.real**2 + mu.imag**2):
        return mu, length
    return mu - step if mu.imag > 0.0 else complex(mu.real - step.real, 0.0), length


@kept(nogil=True)
def corrected_multipliers(machine, cells, cut, points, tables, lanes, largest, error):
    """Multipliers (C,) of one mode after a step of Newton's method on the characteristic equation, and its length: their error.

    largest (C,): the multipliers before and after. Not a number where lanes cannot tell. Else as `rough_multipliers`.
    """
    units, added, shapes, scales = cells
    lengths, free, stiffness = cut
    parts, wide, _ = room(machine, points, lanes)
    moments, many = np.zeros((points.size, TERMS, 2, 2)), np.zeros((points.size, TERMS, 2, 2, lanes))
    own, held = np.zeros(points.size, dtype=np.int64), -1
    share, powers, found, large = np.empty((2, lanes)), np.empty((5, lanes)), np.empty((2, 2, 2, 2, lanes)), np.empty(lanes)
    transitions, turns = np.empty((2, 2, 2, 2, 2, lanes)), np.empty(lanes, dtype=np.complex128)
    last, reach, counts = largest.size - 1, REACH * scales.max(), np.zeros(points.size, dtype=np.int64)
    for block in range(0, largest.size, lanes):
        begin = 0
        for e in range(points.size):
            many[e, :counts[e]] = 0.0
        counts[:] = 0
        for l in range(lanes):
            cell = min(block + l, last)
            mu, scale = largest[cell], scales[cell]
            size = mu.real**2 + mu.imag**2
            inverse = complex(mu.real / size, -mu.imag / size) if size > TINY else complex(1.0, 0.0)
            share[0, l], share[1, l], large[l] = scale * (inverse.real - 1.0), scale * inverse.imag, 0.0
            turns[l] = scale * inverse * inverse
            if l == lanes - 1 or not alike(cells, cell, min(cell + 1, last)):
                if held < 0 or not alike(cells, cell, held):
                    shape, held = shapes[cell], cell
                    structure(machine, units[cell], added[cell], lengths[shape], points, free[shape], tables, parts)
                    own = _moments(parts, stiffness[shape], units[cell] ** 2, points, reach, moments)
                for e in range(points.size):
                    spread(moments[e, :own[e]], many[e, :own[e]], begin, l + 1)
                    counts[e] = max(own[e], counts[e])
                spread(parts[3], wide[3], begin, l + 1)
                spread(parts[4], wide[4], begin, l + 1)
                begin = l + 1
        now = 0
        transitions[0] = 0.0
        transitions[0, 0, 0] = wide[4]
        for e in range(points.size):
            _evaluated(wide[3][e], many[e], counts[e], share, powers, found, large)
            _chained(found, transitions[now], transitions[1 - now])
            now = 1 - now
        for l in range(min(lanes, largest.size - block)):
            cell = block + l
            mu = largest[cell]
            if mu.real**2 + mu.imag**2 <= TINY:
                largest[cell], error[cell] = mu, abs(mu)
            elif large[l] < CANCELLED:
                largest[cell], error[cell] = _corrected(mu, transitions[now], turns[l], l)
            else:
                largest[cell], error[cell] = complex(math.nan, math.nan), math.nan
