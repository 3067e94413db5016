"""Maps of many cuts of one machine over one delay, side by side.

What the structure does between two corners of the cut does not depend on the depth: with answers C of its points to forces
there, motions F from its state at the start, and the states at the end from either (`structure`), the cut's own G of the point
closes the loop:  x = C G (x' - x) + F z,  x' the motion a delay ago. So x = (1 - W) x' + W F z with W = (1 + C G)^-1 of all
points of an element. The unknowns of a map are the state at the end of a period, then x of all points.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.linear.lanes import GROWTH, invert, largest_eigenvalues, multiply
from testbed.analysis.linear.planar_elements import mode_answers, mode_flight
from testbed.system.kernel_cache import kept


@kept
def structure(machine, unit, added, lengths, points, free, tables, parts):
    """C, F, the ends' answers R, the carried state K of each element and the free flight: scalar tables into `parts`.

    machine: shapes V (D, M), frequencies (M,) rad/s, ratios (M,), all of them in the unit of mass. unit: of time, s.
    added: damping in the cut, 1/s. parts: C (E, d, d), F (E, d, m), R (E, m, d), K (E, m, m), flight (m, m).
    """
    shapes, frequencies, ratios = machine
    answers, starts, ends, carries, flight = parts
    answers[:], starts[:], ends[:], carries[:], flight[:] = 0.0, 0.0, 0.0, 0.0, 0.0
    (d, modes), most = shapes.shape, points.max()
    answer, start, end, carry = np.empty((most, most)), np.empty((most, 2)), np.empty((2, most)), np.empty((2, 2))
    work = np.empty((most, 2 * most + 2))
    for mode in range(modes):
        natural = unit * frequencies[mode]
        mode_flight(free, natural, ratios[mode], carry)
        for q in range(2):
            for r in range(2):
                flight[2 * mode + q, 2 * mode + r] = carry[q, r]
        for e in range(points.size):
            p = points[e]
            mode_answers(lengths[e], p, natural, ratios[mode] + 0.5 * added / frequencies[mode], tables, work, answer, start,
                         end, carry)
            for q in range(2):
                for r in range(2):
                    carries[e, 2 * mode + q, 2 * mode + r] = carry[q, r]
            for a in range(d):
                shape = shapes[a, mode]
                for i in range(p):
                    for q in range(2):
                        starts[e, i * d + a, 2 * mode + q] = shape * start[i, q]
                        ends[e, 2 * mode + q, i * d + a] = shape * end[q, i]
                    for b in range(d):
                        for k in range(p):
                            answers[e, i * d + a, k * d + b] += shape * shapes[b, mode] * answer[i, k]


@kept
def spread(table, lanes, begin, end):
    """A table into some lanes of it."""
    flat, wide = table.reshape(-1), lanes.reshape(-1, lanes.shape[-1])
    for i in range(flat.size):
        for l in range(begin, end):
            wide[i, l] = flat[i]


@kept
def alike(cells, one, other):
    """Whether two cells have one structure and one shape of the cut."""
    units, added, shapes, _ = cells
    return units[one] == units[other] and added[one] == added[other] and shapes[one] == shapes[other]


@kept
def _gathered(machine, cells, block, held, cut, points, tables, parts, wide, g):
    """The structure and the cut of a block of cells into lanes: `wide` as `parts`, g (points, D, D, LANES).

    held: the cell of which `parts` holds the structure, or -1; returned: the same afterwards.
    """
    units, added, shapes, scales = cells
    lengths, free, stiffness = cut
    lanes, last, begin = g.shape[3], units.size - 1, 0
    for l in range(lanes):
        cell = min(block + l, last)
        factor, shape = scales[cell] * units[cell] ** 2, shapes[cell]
        for i in range(g.shape[0]):
            for a in range(g.shape[1]):
                for b in range(g.shape[1]):
                    g[i, a, b, l] = factor * stiffness[shape, i, a, b]
        if l == lanes - 1 or not alike(cells, cell, min(cell + 1, last)):
            if held < 0 or not alike(cells, cell, held):
                structure(machine, units[cell], added[cell], lengths[shape], points, free[shape], tables, parts)
                held = cell
            spread(parts[0], wide[0], begin, l + 1)
            spread(parts[1], wide[1], begin, l + 1)
            spread(parts[2], wide[2], begin, l + 1)
            spread(parts[3], wide[3], begin, l + 1)
            spread(parts[4], wide[4], begin, l + 1)
            begin = l + 1
    return held


@kept(fastmath={"contract"}, noalias=True)
def _driven(a, g, first, rows, p, out):
    """out (rows, p D) <- a (rows, p D) G of p points from `first`, in every lane."""
    lanes = out.shape[2]
    d = g.shape[1]
    for i in range(rows):
        for k in range(p):
            for c in range(d):
                for l in range(lanes):
                    out[i, k * d + c, l] = a[i, k * d, l] * g[first + k, 0, c, l]
                for b in range(1, d):
                    for l in range(lanes):
                        out[i, k * d + c, l] += a[i, k * d + b, l] * g[first + k, b, c, l]


@kept(fastmath={"contract"}, noalias=True)
def _map(wide, g, points, work, q, growth):
    """The map of every lane into q (n, n, LANES). work: loop (d, d + m), factors (d), pivot (d + m + 1), R G and R G W (m, d),
    R G X (m, m), X (d, m), state (2, m, n), each with the lanes."""
    lanes = growth.size
    answers, starts, ends, carries, flight = wide
    loop, factors, pivot, pushed, back, closed, moved, state = work
    m, d = flight.shape[0], g.shape[1]
    q[:], state[:] = 0.0, 0.0
    state[0, :, :m] = flight
    first, begin, now = 0, m, 0
    for e in range(points.size):
        size = points[e] * d
        _driven(answers[e], g, first, size, points[e], loop)
        _driven(ends[e], g, first, m, points[e], pushed)
        for i in range(size):
            for l in range(lanes):
                loop[i, i, l] += 1.0
            for j in range(m):
                for l in range(lanes):
                    loop[i, size + j, l] = starts[e, i, j, l]
        invert(loop, size, size + m, factors, pivot, growth)
        multiply(pushed, loop, back, m, size, size + m)
        for i in range(m):
            for j in range(m):
                for l in range(lanes):
                    closed[i, j, l] = carries[e, i, j, l] - back[i, size + j, l]
        multiply(closed, state[now], state[1 - now], m, m, begin)
        for i in range(size):
            for j in range(m):
                for l in range(lanes):
                    moved[i, j, l] = loop[i, size + j, l]
        multiply(moved, state[now], q[begin:], size, m, begin)
        for i in range(size):
            for j in range(size):
                for l in range(lanes):
                    q[begin + i, begin + j, l] = (1.0 if i == j else 0.0) - loop[i, j, l]
        for i in range(m):
            for j in range(size):
                for l in range(lanes):
                    state[1 - now, i, begin + j, l] = back[i, j, l]
        first, begin, now = first + points[e], begin + size, 1 - now
    q[:m] = state[now]


@kept
def _parts(machine, points, lanes):
    """Room for `structure`; a last axis of so many lanes, where there are any."""
    d, m, e = points.max() * machine[0].shape[0], 2 * machine[1].size, points.size
    return (np.empty((e, d, d * lanes)), np.empty((e, d, m * lanes)), np.empty((e, m, d * lanes)), np.empty((e, m, m * lanes)),
            np.empty((m, m * lanes)))


@kept
def room(machine, points, lanes):
    """Scalar tables of `structure`, the same in lanes, and G in lanes."""
    one, many, components = _parts(machine, points, 1), _parts(machine, points, lanes), machine[0].shape[0]
    e, d, m = one[1].shape
    wide = (many[0].reshape((e, d, d, lanes)), many[1].reshape((e, d, m, lanes)), many[2].reshape((e, m, d, lanes)),
            many[3].reshape((e, m, m, lanes)), many[4].reshape((m, m, lanes)))
    return one, wide, np.empty((points.sum(), components, components, lanes))


@kept(nogil=True)
def rough_multipliers(machine, cells, cut, points, tables, lanes, largest):
    """The largest multiplier of every cell's map, of a pair the upper; not a number where lanes cannot tell it.

    cells: units of time (s), damping added in the cut (1/s), which shape the cut has and its scale, each (C,); those that are
    alike but for the scale in turn. cut: of each shape the lengths of its elements (S, E) and its free flight (S,) in the unit
    of time; its stiffness (S, points, D, D), 1/s^2 times the unit of mass. lanes: LANES.
    """
    parts, wide, g = room(machine, points, lanes)
    _, d, m = parts[1].shape
    n = points.sum() * g.shape[1] + m
    work = (np.empty((d, d + m, lanes)), np.empty((d, lanes)), np.empty((d + m + 1, lanes)), np.empty((m, d, lanes)),
            np.empty((m, d + m, lanes)), np.empty((m, m, lanes)), np.empty((d, m, lanes)), np.empty((2, m, n, lanes)))
    q, power = np.empty((n, n, lanes)), np.empty((2, n, n, lanes))
    vectors, sums = np.empty((3, n, 1, lanes)), np.empty((9, lanes))
    growth, value, held = np.empty(lanes), np.empty(lanes, dtype=np.complex128), -1
    for block in range(0, largest.size, lanes):
        growth[:] = 0.0
        held = _gathered(machine, cells, block, held, cut, points, tables, parts, wide, g)
        _map(wide, g, points, work, q, growth)
        largest_eigenvalues(q, n, power, vectors, sums, value)
        for l in range(min(lanes, largest.size - block)):
            largest[block + l] = value[l] if growth[l] < GROWTH else complex(math.nan, math.nan)
