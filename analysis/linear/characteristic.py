"""The characteristic equation of a delay equation, by which a multiplier found from a map is corrected and its error told.

For a motion that a delay multiplies by mu the delayed displacement is x / mu, and the delay equation is an ordinary one:

    x'' + [damping + c(t)] x' + [stiffness + k(t) - d(t) / mu] x = 0,    det(Phi(mu) - mu I) = 0

with Phi (2, 2) its transition over the delay. A step of Newton's method at a higher order than the map's costs little, and its
length is the error of the multiplier before it.
"""

from __future__ import annotations

import numpy as np

from testbed.system.kernel_cache import kept

DIFFERENCE = 1e-5  # of mu, for the slope
CORRECTED = 0.1  # of mu: a longer step leads nowhere


@kept(fastmath=True)
def _solve(matrix, p):
    """Two right-hand sides behind a matrix (p, p + 2), in place."""
    for k in range(p):
        best, size = k, abs(matrix[k, k].real) + abs(matrix[k, k].imag)
        for i in range(k + 1, p):
            other = abs(matrix[i, k].real) + abs(matrix[i, k].imag)
            if other > size:
                best, size = i, other
        if best != k:
            for j in range(k, p + 2):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        inverse = 1.0 / matrix[k, k]
        for i in range(k + 1, p):
            factor = matrix[i, k] * inverse
            for j in range(k + 1, p + 2):
                matrix[i, j] -= factor * matrix[k, j]
    for k in range(p - 1, -1, -1):
        inverse = 1.0 / matrix[k, k]
        for j in range(p, p + 2):
            total = matrix[k, j]
            for i in range(k + 1, p):
                total -= matrix[k, i] * matrix[i, j]
            matrix[k, j] = total * inverse


@kept(fastmath=True)
def _characteristic(mu, lengths, points, damping, stiffness, delayed, flight, nodes, weights, once, twice, work):
    """det(Phi(mu) - mu I); coefficients at all points in turn, work (most points, most points + 2) complex."""
    x0, x1 = complex(flight[0, 0], 0.0), complex(flight[0, 1], 0.0)
    v0, v1 = complex(flight[1, 0], 0.0), complex(flight[1, 1], 0.0)
    inverse = 1.0 / mu
    begin = 0
    for e in range(points.size):
        p, h = points[e], lengths[e]
        c, b, first, second = nodes[p], weights[p], once[p], twice[p]
        for i in range(p):
            drag = h * damping[begin + i]
            spring = stiffness[begin + i] - delayed[begin + i] * inverse
            squared = h * h * spring
            for j in range(p):
                work[i, j] = squared * second[i, j] + drag * first[i, j]
            work[i, i] += 1.0
            work[i, p] = -spring
            work[i, p + 1] = -(damping[begin + i] + spring * (c[i] * h))
        _solve(work, p)
        xx, xv, vx, vv = complex(1.0, 0.0), complex(h, 0.0), complex(0.0, 0.0), complex(1.0, 0.0)
        for k in range(p):
            speed = h * b[k]
            place = h * (1.0 - c[k]) * speed
            xx += place * work[k, p]
            xv += place * work[k, p + 1]
            vx += speed * work[k, p]
            vv += speed * work[k, p + 1]
        x0, v0 = xx * x0 + xv * v0, vx * x0 + vv * v0
        x1, v1 = xx * x1 + xv * v1, vx * x1 + vv * v1
        begin += p
    return (x0 - mu) * (v1 - mu) - x1 * v0


@kept
def corrected(mu, lengths, points, damping, stiffness, delayed, flight, tables, work):
    """A multiplier after a step of Newton's method, and the step's length; the multiplier as it was if that is too long."""
    nodes, weights, once, twice = tables
    size = abs(mu)
    if not size > 1e-12:
        return mu, size
    other = mu * (1.0 + DIFFERENCE)
    here = _characteristic(mu, lengths, points, damping, stiffness, delayed, flight, nodes, weights, once, twice, work)
    there = _characteristic(other, lengths, points, damping, stiffness, delayed, flight, nodes, weights, once, twice, work)
    slope = (there - here) / (other - mu)
    if not abs(slope) > 0.0:
        return mu, np.inf
    step = here / slope
    if not abs(step) <= CORRECTED * size:
        return mu, abs(step)
    return mu - step, abs(step)
