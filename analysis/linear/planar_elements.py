"""Spectral elements of a planar machine: what a principal period makes of the motion that the period before left.

As in `spectral_elements`, the accelerations of all modes are polynomials through Gauss points of each element, and free flight
is exact. The force of the cut at the points is all that the modes share: with it eliminated mode by mode, an element has
unknowns for the components of the contact motion alone. The motion a delay ago is the polynomial of the element where it was;
where points fall on points of the tooth before, its very values. Times are spindle angles (rad), speeds of a mode are over its
frequency.

The motion of a period is a vector: of each element the contact motion at its start, its points and its end; then displacement
and speed of every mode at the end.
"""

from __future__ import annotations

import numpy as np

from testbed.analysis.linear.planar_equation import chip_stiffness
from testbed.analysis.linear.spectral_elements import MOST_POINTS, TABLES, _eliminate
from testbed.analysis.linear.temporal_elements import transition_matrix
from testbed.system.kernel_cache import kept

_ON = 1e-10  # of an element: nearer to a point of it is on it


def _nodes() -> tuple[np.ndarray, np.ndarray]:
    """By points p of an element: its start, points and end (p + 2), 0 to 1; and their barycentric weights."""
    places, weights = np.zeros((MOST_POINTS + 1, MOST_POINTS + 2)), np.zeros((MOST_POINTS + 1, MOST_POINTS + 2))
    for p in range(1, MOST_POINTS + 1):
        x = np.concatenate([[0.0], TABLES[0][p, :p], [1.0]])
        gaps = x[:, None] - x[None, :] + np.eye(p + 2)
        logs = -np.log(np.abs(gaps)).sum(axis=1)
        places[p, :p + 2] = x
        weights[p, :p + 2] = np.sign(gaps).prod(axis=1) * np.exp(logs - logs.max())
    return places, weights


PLANAR_TABLES = (*TABLES, *_nodes())


@kept
def offsets(points, d):
    """Where each element's contact motion begins in the vector of a period; the last: where the modes begin."""
    begin = np.zeros(points.size + 1, dtype=np.int64)
    for e in range(points.size):
        begin[e + 1] = begin[e] + (d * (points[e] + 2) if points[e] else 0)
    return begin


@kept
def _met(place, starts, lengths, points, tables, row):
    """The element that holds an angle, and the weights (p + 2) by which its nodes make the motion there, into `row`.

    (element, first node, nodes): one node alone where the angle is on it.
    """
    e = np.searchsorted(starts, place, side="right") - 1
    if points[e] == 0:  # by rounding beyond an edge of the cut
        e = e + 1 if e + 1 < points.size and starts[e] + lengths[e] - place < place - starts[e] else e - 1
    p = points[e]
    x = (place - starts[e]) / lengths[e]
    nodes, bary = tables[4][p], tables[5][p]
    for i in range(p + 2):
        if abs(x - nodes[i]) < _ON:
            row[0] = 1.0
            return e, i, 1
    total = 0.0
    for i in range(p + 2):
        row[i] = bary[i] / (x - nodes[i])
        total += row[i]
    for i in range(p + 2):
        row[i] /= total
    return e, 0, p + 2


@kept
def cut_at(machine, cut, elements, tables):
    """The cut at all points: G of every lane that cuts there and where its delayed motion stands.

    (first (n + 1,) pair of each point, g (pairs, D, D) in kg/rad^2, start in the vector, nodes, whether in the period before,
    weights (pairs, most nodes)).
    """
    axes, _, _, _, entries, delays, law = machine
    speed, depth, lag = cut
    starts, lengths, points = elements
    d, period, n = axes.shape[1], delays.sum(), points.sum()
    begin = offsets(points, d)
    first, most = np.zeros(n + 1, dtype=np.int64), n * entries.size
    g, weights = np.zeros((most, d, d)), np.empty((most, points.max() + 2))
    source, nodes, before = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64), np.empty(most, dtype=np.bool_)
    h, scale = np.empty((2, 2)), depth / speed**2
    pair, point = 0, 0
    for e in range(points.size):
        for i in range(points[e]):
            angle = starts[e] + lengths[e] * tables[0][points[e], i]
            for lane in range(entries.size):
                if not chip_stiffness((angle - entries[lane]) % period, period, lag, law, h):
                    continue
                for a in range(d):
                    for b in range(d):
                        for u in range(2):
                            for v in range(2):
                                g[pair, a, b] += scale * axes[u, a] * h[u, v] * axes[v, b]
                met = angle - delays[lane]
                before[pair] = met < 0.0
                element, node, nodes[pair] = _met(met + period if met < 0.0 else met, starts, lengths, points, tables,
                                                  weights[pair])
                source[pair] = begin[element] + d * node
                pair += 1
            point += 1
            first[point] = pair
    return first, g[:pair], source[:pair], nodes[:pair], before[:pair], weights[:pair]


@kept
def mode_answers(h, p, natural, ratio, tables, work, answer, free, ends, carry):
    """One mode in one element: `answer` (p, p) of its displacements at the points to a force there, `free` (p, 2) to its start;
    its end is `carry` (2, 2) times its start and `ends` (2, p) times the force."""
    c, b, once, twice = tables[0][p], tables[1][p], tables[2][p], tables[3][p]
    w, drag, h2 = natural * natural, 2.0 * ratio * natural, h * h
    for i in range(p):
        for j in range(p):
            work[i, j] = h * drag * once[i, j] + h2 * w * twice[i, j]
            work[i, p + j] = 0.0
        work[i, i] += 1.0
        work[i, p + i] = 1.0
        work[i, 2 * p] = -w
        work[i, 2 * p + 1] = -(drag + w * c[i] * h) * natural
    _eliminate(work, p, p + 2)
    carry[0, 0], carry[0, 1], carry[1, 0], carry[1, 1] = 1.0, h * natural, 0.0, 1.0
    for j in range(p):
        ends[0, j], ends[1, j] = 0.0, 0.0
    for i in range(p):
        for j in range(p):
            answer[i, j] = 0.0
        free[i, 0], free[i, 1] = 1.0, c[i] * h * natural
        for k in range(p):
            factor = h2 * twice[i, k]
            for j in range(p):
                answer[i, j] += factor * work[k, p + j]
            free[i, 0] += factor * work[k, 2 * p]
            free[i, 1] += factor * work[k, 2 * p + 1]
    for k in range(p):
        place, pace = h2 * b[k] * (1.0 - c[k]), h * b[k] / natural
        for j in range(p):
            ends[0, j] += place * work[k, p + j]
            ends[1, j] += pace * work[k, p + j]
        for j in range(2):
            carry[0, j] += place * work[k, 2 * p + j]
            carry[1, j] += pace * work[k, 2 * p + j]


@kept
def mode_flight(length, natural, ratio, carry):
    """A mode's free flight, exactly."""
    moved = transition_matrix(2.0 * ratio * natural, natural * natural, length)
    carry[0, 0], carry[0, 1] = moved[0, 0], moved[0, 1] * natural
    carry[1, 0], carry[1, 1] = moved[1, 0] / natural, moved[1, 1]


@kept
def _couple(p, shapes, g, first, answer, free, work, local):
    """Solve an element's points (p D) for the delayed force and all modes' starts: `local` (p D, p D + 2 M).

    g, first: the pairs of this element's points, `first` (p + 1,).
    """
    d, m = shapes.shape
    size = p * d
    for i in range(p):
        for a in range(d):
            row = i * d + a
            for l in range(p):
                for b in range(d):
                    total = 0.0
                    for j in range(m):
                        total += shapes[a, j] * shapes[b, j] * answer[j, i, l]
                    work[row, size + l * d + b] = total
            for j in range(m):
                work[row, 2 * size + 2 * j] = shapes[a, j] * free[j, i, 0]
                work[row, 2 * size + 2 * j + 1] = shapes[a, j] * free[j, i, 1]
    for row in range(size):
        for l in range(p):
            for c in range(d):
                total = 0.0
                for pair in range(first[l], first[l + 1]):
                    for b in range(d):
                        total += work[row, size + l * d + b] * g[pair, b, c]
                work[row, l * d + c] = total
        work[row, row] += 1.0
    _eliminate(work, size, size + 2 * m)
    for row in range(size):
        for column in range(size + 2 * m):
            local[row, column] = work[row, size + column]


@kept
def period_map(machine, cut, elements, tables):
    """All that `times_period` needs of a period."""
    shapes, naturals, ratios = machine[1], machine[2] / cut[0], machine[3]
    starts, lengths, points = elements
    (d, m), most, count = shapes.shape, points.max(), points.size
    at = cut_at(machine, cut, elements, tables)
    first, g = at[0], at[1]
    local = np.zeros((count, most * d, most * d + 2 * m))
    ends, carry = np.zeros((count, m, 2, most)), np.zeros((count, m, 2, 2))
    answer, free, one = np.empty((m, most, most)), np.empty((m, most, 2)), np.empty((most, 2 * most + 2))
    work = np.empty((most * d, 2 * most * d + 2 * m))
    point = 0
    for e in range(count):
        p = points[e]
        for j in range(m):
            if p == 0:
                mode_flight(lengths[e], naturals[j], ratios[j], carry[e, j])
            else:
                mode_answers(lengths[e], p, naturals[j], ratios[j], tables, one, answer[j], free[j], ends[e, j], carry[e, j])
        if p:
            _couple(p, shapes, g, first[point:point + p + 1], answer, free, work, local[e])
        point += p
    return points, offsets(points, d), shapes, at, local, ends, carry


@kept(fastmath=True)
def times_period(period, u, result):
    """result <- the motion of a period after one of motion u."""
    points, begin, shapes, at, local, ends, carry = period
    first, g, source, nodes, before, weights = at
    d, m = shapes.shape
    x = u[begin[-1]:].copy()
    load, push = np.empty(local.shape[1]), np.empty(local.shape[1])
    point = 0
    for e in range(points.size):
        p, here = points[e], begin[e]
        for i in range(p):
            for a in range(d):
                load[i * d + a] = 0.0
            for pair in range(first[point + i], first[point + i + 1]):
                vector = u if before[pair] else result
                for b in range(d):
                    value = 0.0
                    for node in range(nodes[pair]):
                        value += weights[pair, node] * vector[source[pair] + node * d + b]
                    for a in range(d):
                        load[i * d + a] += g[pair, a, b] * value
        if p:
            for a in range(d):
                total = 0.0
                for j in range(m):
                    total += shapes[a, j] * x[2 * j]
                result[here + a] = total
            for row in range(p * d):
                total = 0.0
                for column in range(p * d):
                    total += local[e, row, column] * load[column]
                for column in range(2 * m):
                    total += local[e, row, p * d + column] * x[column]
                result[here + d + row] = total
        for i in range(p):
            for a in range(d):
                total = load[i * d + a]
                for pair in range(first[point + i], first[point + i + 1]):
                    for b in range(d):
                        total -= g[pair, a, b] * result[here + d + i * d + b]
                push[i * d + a] = total
        for j in range(m):
            q, v = x[2 * j], x[2 * j + 1]
            place, pace = carry[e, j, 0, 0] * q + carry[e, j, 0, 1] * v, carry[e, j, 1, 0] * q + carry[e, j, 1, 1] * v
            for i in range(p):
                force = 0.0
                for a in range(d):
                    force += shapes[a, j] * push[i * d + a]
                place += ends[e, j, 0, i] * force
                pace += ends[e, j, 1, i] * force
            x[2 * j], x[2 * j + 1] = place, pace
        if p:
            for a in range(d):
                total = 0.0
                for j in range(m):
                    total += shapes[a, j] * x[2 * j]
                result[here + d * (p + 1) + a] = total
        point += p
    result[begin[-1]:] = x
