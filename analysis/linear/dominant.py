"""The largest eigenvalue of a map: by repeated squaring of a small matrix, by Arnoldi's method for a large one.

Squaring leaves what the largest one or two eigenvalues span; they follow from three powers, and the misfit of those shows what
a third still contributes. A matrix whose pair cannot be vouched for is given the full eigenvalue problem.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.linear.spectral_elements import dense_map, times_map
from testbed.system.kernel_cache import kept

DENSE = 32  # unknowns up to which the whole matrix is squared
FIRST_SQUARINGS, MOST_SQUARINGS = 4, 14  # 2^14 passes: 11.5 / 2^14 tells two moduli apart that differ by 7e-4
MISFIT = 1e-10  # of a squared norm: 1e-5 of the vector
KRYLOV = (28, 56, 112, 160)  # vectors, as many as it takes
FULL = 200  # unknowns up to which a cell may be given the full problem, a fifth of a second
RITZ = 1e-5  # residual of an eigenvector over its eigenvalue, which is corrected afterwards


@kept(fastmath=True)
def _square(matrix, product):
    """product <- matrix @ matrix, scaled to a largest entry of 1."""
    n = matrix.shape[0]
    largest = 0.0
    for i in range(n):
        for j in range(n):
            product[i, j] = 0.0
        for k in range(n):
            factor = matrix[i, k]
            for j in range(n):
                product[i, j] += factor * matrix[k, j]
        for j in range(n):
            largest = max(largest, abs(product[i, j]))
    scale = 1.0 / largest if largest > 0.0 else 0.0
    for i in range(n):
        for j in range(n):
            product[i, j] *= scale


@kept(fastmath=True)
def _times(matrix, vector, result):
    for i in range(vector.size):
        total = 0.0
        for j in range(vector.size):
            total += matrix[i, j] * vector[j]
        result[i] = total


@kept
def full(matrix):
    """Largest eigenvalue by the full problem; of a pair the upper."""
    if not np.all(np.isfinite(matrix)):
        return complex(math.nan, math.nan)
    values = np.linalg.eigvals(matrix.astype(np.complex128))
    best = values[0]
    for value in values:
        if abs(value) > abs(best) * (1.0 + 1e-12):
            best = value
    imaginary = abs(best.imag)
    return complex(best.real, imaginary if imaginary > 1e-9 * abs(best) else 0.0)


@kept(fastmath={"contract"})
def told(sums):
    """The largest eigenvalue by a column u0 of a power of a matrix, and u1, u2, what the matrix makes of it and of that; and
    whether it can be vouched for.

    sums: u0 u0, u0 u1, u1 u1, u0 u2, u1 u2, u2 u2; s and p of u2 = s u1 - p u0 by least squares, and its misfit. Two guards. If
    one Rayleigh quotient already has no residual, one real multiplier dominates and the fit would be singular. Otherwise the
    misfit shows what a third multiplier still contributes.
    """
    a00, a01, a11, c, s, p = sums[0], sums[1], sums[2], sums[5], sums[6], sums[7]
    if a00 == 0.0 or c == 0.0:
        return complex(0.0, 0.0), False
    if a00 * a11 - a01 * a01 < MISFIT * a00 * a11:
        return complex(a01 / a00, 0.0), True
    discriminant = 0.25 * s * s - p
    if discriminant < 0.0:
        value = complex(0.5 * s, math.sqrt(-discriminant))
    else:
        value = complex(0.5 * s + math.copysign(math.sqrt(discriminant), s), 0.0)
    return value, sums[8] < MISFIT * c and abs(discriminant) > 1e-6 * abs(p)


@kept(fastmath=True)
def _pair(matrix, power, u0, u1, u2):
    """`told` by the largest column of a power of the matrix."""
    n = matrix.shape[0]
    best, column = -1.0, 0
    for j in range(n):
        total = 0.0
        for i in range(n):
            total += power[i, j] ** 2
        if total > best:
            best, column = total, j
    for i in range(n):
        u0[i] = power[i, column]
    _times(matrix, u0, u1)
    _times(matrix, u1, u2)
    sums = np.zeros(9)
    for i in range(n):
        sums[0] += u0[i] * u0[i]
        sums[1] += u0[i] * u1[i]
        sums[2] += u1[i] * u1[i]
        sums[3] += u0[i] * u2[i]
        sums[4] += u1[i] * u2[i]
        sums[5] += u2[i] * u2[i]
    determinant = sums[0] * sums[2] - sums[1] * sums[1]
    if determinant > 0.0:
        sums[6] = (sums[0] * sums[4] - sums[1] * sums[3]) / determinant
        sums[7] = (sums[1] * sums[4] - sums[2] * sums[3]) / determinant
        for i in range(n):
            sums[8] += (u2[i] - sums[6] * u1[i] + sums[7] * u0[i]) ** 2
    return told(sums)


@kept
def dominant(matrix, work, u0, u1, u2):
    """The largest eigenvalue of a matrix (n, n), of a pair the upper; work (2, n, n), vectors (n,)."""
    _square(matrix, work[0])
    at = 0
    for done in range(1, MOST_SQUARINGS + 1):
        if done >= FIRST_SQUARINGS and done % 2 == 0:
            value, sure = _pair(matrix, work[at], u0, u1, u2)
            if sure:
                return value
        _square(work[at], work[1 - at])
        at = 1 - at
    return full(matrix)


@kept
def append(basis, h, k, new):
    """Make `new`, the map of Arnoldi's vector k (row of `basis`), the next one; h (m + 1, m). True where there are no more."""
    size = math.sqrt(np.dot(new, new))
    for _ in range(2):  # once more: orthogonal to rounding
        for i in range(k + 1):
            part = np.dot(basis[i], new)
            h[i, k] += part
            new -= part * basis[i]
    rest = math.sqrt(np.dot(new, new))
    if not rest > 1e-14 * size:
        return True
    h[k + 1, k] = rest
    basis[k + 1] = new / rest
    return False


@kept
def _expand(points, locals_, flight, basis, h, begin, end):
    """Arnoldi's vectors (rows of `basis`) and Hessenberg matrix h (m + 1, m) from `begin` to `end`; how many there are."""
    new = np.empty(basis.shape[1])
    for k in range(begin, end):
        times_map(points, locals_, flight, basis[k], new)
        if append(basis, h, k, new):
            return k + 1, True
    return end, False


@kept
def _residual(h, count, value):
    """Of the eigenvector that belongs to `value`, over |value|: from the last row of the Hessenberg matrix upwards."""
    z = np.zeros(count, dtype=np.complex128)
    z[count - 1] = 1.0
    for i in range(count - 1, 0, -1):
        total = value * z[i]
        for j in range(i, count):
            total -= h[i, j] * z[j]
        z[i - 1] = total / h[i, i - 1]
        if abs(z[i - 1]) > 1e100:
            z *= 1e-100
    size = math.sqrt(np.sum(z.real**2 + z.imag**2))
    return h[count, count - 1] * abs(z[count - 1]) / (size * abs(value))


@kept
def largest_of(points, locals_, flight, scratch, checked):
    """The largest multiplier of a map given by its elements, of a pair the upper; not a number where it is not found.

    scratch (3, DENSE + 3, DENSE). checked: by the full eigenvalue problem.
    """
    n, dense = points.sum() + 2, scratch.shape[2]
    if n <= dense and not checked:
        q, work = scratch[0, :n, :n], scratch[1:, :n, :n]
        dense_map(points, locals_, flight, q)
        return dominant(q, work, scratch[0, dense, :n], scratch[0, dense + 1, :n], scratch[0, dense + 2, :n])
    if not checked or n > FULL:
        value, found = _by_arnoldi(points, locals_, flight, n)
        if found or n > FULL:
            return value
    q = np.empty((n, n))
    dense_map(points, locals_, flight, q)
    return full(q)


@kept
def _by_arnoldi(points, locals_, flight, n):
    """The largest multiplier, and whether it was found."""
    most = min(KRYLOV[-1], n - 1)
    basis, h = np.empty((most + 1, n)), np.zeros((most + 1, most))
    for i in range(n):  # a start without a pattern of its own
        basis[0, i] = 0.5 + (0.6180339887498949 * (i + 1)) % 1.0
    basis[0] /= math.sqrt(np.dot(basis[0], basis[0]))
    count = 0
    for wanted in KRYLOV:
        count, closed = _expand(points, locals_, flight, basis, h, count, min(wanted, most))
        part = np.ascontiguousarray(h[:count, :count])
        value = dominant(part, np.empty((2, count, count)), np.empty(count), np.empty(count), np.empty(count))
        if closed or _residual(h, count, value) < RITZ:
            return value, True
        if count == most:
            break
    return complex(math.nan, math.nan), False
