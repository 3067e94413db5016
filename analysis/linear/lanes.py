"""Small dense problems side by side: the same steps for LANES matrices at once, so that each step is one of vector arithmetic.

Arrays end in the axis of lanes, and no lane sees another: an answer does not depend on its neighbours. Where a lane asks for
other steps than its neighbours (rows exchanged, more squarings) it is told to be unsure and goes the road of one alone.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.linear.dominant import FIRST_SQUARINGS, MOST_SQUARINGS, dominant, told
from testbed.system.kernel_cache import kept

LANES = 32  # handed to the compiled functions: a short loop of a length known to the compiler is unrolled and stays scalar
GROWTH = 1e6  # squares of an elimination's factors without exchange of rows: three digits lost
FEW = 2  # lanes that are not worth another squaring of all


@kept(fastmath={"contract"}, noalias=True)
def _clear(matrix, factors, pivot, n, width):
    """matrix (n, width) -= factors (n) pivot (width), in every lane: two rows at once."""
    lanes = matrix.shape[2]
    for i in range(0, n - 1, 2):
        for j in range(width):
            for l in range(lanes):
                matrix[i, j, l] -= factors[i, l] * pivot[j, l]
                matrix[i + 1, j, l] -= factors[i + 1, l] * pivot[j, l]
    if n % 2:
        for j in range(width):
            for l in range(lanes):
                matrix[n - 1, j, l] -= factors[n - 1, l] * pivot[j, l]


@kept(fastmath={"contract"}, noalias=True)
def _pivoted(matrix, k, n, width, factors, pivot, growth):
    """Row k over its pivot, and what every row takes of it; the row and column of the matrix are left empty."""
    lanes = growth.size
    for l in range(lanes):
        pivot[width, l] = 1.0 / matrix[k, k, l]
        matrix[k, k, l] = 1.0
    for j in range(width):
        for l in range(lanes):
            pivot[j, l] = matrix[k, j, l] * pivot[width, l]
            matrix[k, j, l] = 0.0
    for i in range(n):
        for l in range(lanes):
            factors[i, l] = matrix[i, k, l]
            matrix[i, k, l] = 0.0
            factor = factors[i, l] * pivot[width, l]
            growth[l] += factor * factor
    for l in range(lanes):
        factors[k, l] = -1.0


@kept(noalias=True)
def invert(matrix, n, width, factors, pivot, growth):
    """In place, by Gauss and Jordan without exchange of rows: the first n columns of (n, width) become their inverse, the
    others the solutions to them. factors (n, LANES), pivot (width + 1, LANES). growth (LANES): its factors' squares are added.
    """
    for k in range(n):
        _pivoted(matrix, k, n, width, factors, pivot, growth)
        _clear(matrix, factors, pivot, n, width)


@kept(fastmath={"contract"}, noalias=True)
def _four_rows(out, i, a, b, k, width):
    """out[i] += a[i, k] b[k] + ... of four rows k, in every lane; from k = 0 it is set."""
    if k == 0:
        for j in range(width):
            for l in range(LANES):
                out[i, j, l] = (a[i, 0, l] * b[0, j, l] + a[i, 1, l] * b[1, j, l] + a[i, 2, l] * b[2, j, l]
                                + a[i, 3, l] * b[3, j, l])
    else:
        for j in range(width):
            for l in range(LANES):
                out[i, j, l] += (a[i, k, l] * b[k, j, l] + a[i, k + 1, l] * b[k + 1, j, l] + a[i, k + 2, l] * b[k + 2, j, l]
                                 + a[i, k + 3, l] * b[k + 3, j, l])


@kept(fastmath={"contract"}, noalias=True)
def _two_rows(out, i, a, b, k, width):
    lanes = out.shape[2]
    for j in range(width):
        for l in range(lanes):
            out[i, j, l] += a[i, k, l] * b[k, j, l] + a[i, k + 1, l] * b[k + 1, j, l]


@kept(fastmath={"contract"}, noalias=True)
def _one_row(out, i, a, b, k, width):
    lanes = out.shape[2]
    for j in range(width):
        for l in range(lanes):
            out[i, j, l] += a[i, k, l] * b[k, j, l]


@kept(noalias=True)
def multiply(a, b, out, rows, inner, width):
    """out (rows, width) <- a (rows, inner) b (inner, width), in every lane."""
    for i in range(rows):
        if inner < 4:
            out[i, :width] = 0.0
        k = 0
        while k + 4 <= inner:
            _four_rows(out, i, a, b, k, width)
            k += 4
        if k + 2 <= inner:
            _two_rows(out, i, a, b, k, width)
            k += 2
        if k < inner:
            _one_row(out, i, a, b, k, width)


@kept(fastmath={"contract"}, noalias=True)
def _add_squares(matrix, j, n, total):
    """total += squares of the entries of column j, in every lane."""
    lanes = total.size
    for i in range(n):
        for l in range(lanes):
            total[l] += matrix[i, j, l] * matrix[i, j, l]


@kept(fastmath={"contract"}, noalias=True)
def _normalised(matrix, n, factor, out):
    """A matrix over its norm, in every lane: its powers are of no larger one. factor (LANES)."""
    lanes = factor.size
    factor[:] = 0.0
    for j in range(n):
        _add_squares(matrix, j, n, factor)
    for l in range(lanes):
        factor[l] = 1.0 / math.sqrt(factor[l]) if factor[l] > 0.0 else 0.0
    for i in range(n):
        for j in range(n):
            for l in range(lanes):
                out[i, j, l] = matrix[i, j, l] * factor[l]


@kept(fastmath={"contract"}, noalias=True)
def _add_dot(a, b, n, total):
    """total += a b of vectors (n, 1), in every lane."""
    lanes = total.size
    for i in range(n):
        for l in range(lanes):
            total[l] += a[i, 0, l] * b[i, 0, l]


@kept(fastmath={"contract"}, noalias=True)
def _pairs(sums, s, p):
    """s and p of u2 = s u1 - p u0 by least squares, in every lane; sums as of `dominant.told`."""
    lanes = s.size
    for l in range(lanes):
        inverse = 1.0 / (sums[0, l] * sums[2, l] - sums[1, l] * sums[1, l])
        s[l] = (sums[0, l] * sums[4, l] - sums[1, l] * sums[3, l]) * inverse
        p[l] = (sums[1, l] * sums[4, l] - sums[2, l] * sums[3, l]) * inverse


@kept(fastmath={"contract"}, noalias=True)
def _add_misfit(s, p, vectors, n, total):
    lanes = s.size
    for i in range(n):
        for l in range(lanes):
            rest = vectors[2, i, 0, l] - s[l] * vectors[1, i, 0, l] + p[l] * vectors[0, i, 0, l]
            total[l] += rest * rest


@kept(fastmath={"contract"}, noalias=True)
def _fitted(matrix, power, n, vectors, sums, value, sure):
    """`dominant.told` by the largest column of a power, where a lane is not sure yet.

    vectors (3, n, 1, LANES), sums (9, LANES).
    """
    lanes = matrix.shape[2]
    best, column = np.full(lanes, -1.0), np.zeros(lanes, dtype=np.int64)
    for j in range(n):
        sums[0] = 0.0
        _add_squares(power, j, n, sums[0])
        for l in range(lanes):
            if sums[0, l] > best[l]:
                best[l], column[l] = sums[0, l], j
    for i in range(n):
        for l in range(lanes):
            vectors[0, i, 0, l] = power[i, column[l], l]
    multiply(matrix, vectors[0], vectors[1], n, n, 1)
    multiply(matrix, vectors[1], vectors[2], n, n, 1)
    sums[:] = 0.0
    for k, (a, b) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
        _add_dot(vectors[a], vectors[b], n, sums[k])
    _pairs(sums, sums[6], sums[7])
    _add_misfit(sums[6], sums[7], vectors, n, sums[8])
    for l in range(lanes):
        if not sure[l]:
            value[l], sure[l] = told(sums[:, l])


@kept
def largest_eigenvalues(matrix, n, power, vectors, sums, value):
    """The largest eigenvalue of every lane's matrix (n, n), of a pair the upper, into value (LANES), as `dominant` finds it.

    power (2, n, n, LANES), vectors (3, n, 1, LANES), sums (9, LANES).
    """
    lanes = value.size
    sure, now, done = np.zeros(lanes, dtype=np.bool_), 0, 0
    _normalised(matrix, n, sums[0], power[0])
    while True:
        if done >= FIRST_SQUARINGS and done % 2 == 0:
            _fitted(matrix, power[now], n, vectors, sums, value, sure)
            if done == MOST_SQUARINGS or lanes - np.count_nonzero(sure) < FEW:
                break
            _normalised(power[now], n, sums[0], power[1 - now])
            now = 1 - now
        multiply(power[now], power[now], power[1 - now], n, n, n)
        now, done = 1 - now, done + 1
    for l in range(lanes):
        if not sure[l]:
            alone = np.ascontiguousarray(matrix[:n, :n, l])
            value[l] = dominant(alone, np.empty((2, n, n)), np.empty(n), np.empty(n), np.empty(n))
