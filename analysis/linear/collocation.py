"""Chebyshev collocation of a delay equation: the second road to its multipliers and periodic motion.

Between two breaks the motion is a Chebyshev series that meets the equation at the Chebyshev-Gauss points of the piece
and joins its neighbour in displacement and velocity; the delayed motion is the series of one delay ago (compare
Butcher, Ma, Bueler, Averina and Szabo 2004, Int. J. Numer. Meth. Eng. 59, 895). Free flight is the matrix exponential.
Shares nothing with the temporal elements but the statement of the problem. Converges spectrally: degree 10 gives 3e-8.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev
from scipy.linalg import expm

from testbed.analysis.linear.delay_equation import DelayEquation


def _basis(points: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Chebyshev polynomials 0..degree and their first two derivatives at `points`, each (points, degree + 1)."""
    unit = np.eye(degree + 1)
    slope = chebyshev.chebder(unit, axis=0)
    curvature = chebyshev.chebder(unit, 2, axis=0)
    return (chebyshev.chebvander(points, degree),
            chebyshev.chebvander(points, slope.shape[0] - 1) @ slope,
            chebyshev.chebvander(points, curvature.shape[0] - 1) @ curvature)


def _piece(equation: DelayEquation, start: float, end: float, degree: int):
    """Rows of one piece: (left-hand side, its start state rows, delayed rows, load) with the series as unknown."""
    half = 0.5 * (end - start)
    count = degree - 1
    points = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    times = start + half * (points + 1.0)
    value, slope, curvature = _basis(points, degree)
    damping = (equation.damping + equation.periodic_damping(times))[:, None]
    stiffness = (equation.stiffness + equation.periodic_stiffness(times))[:, None]
    left = curvature + half * damping * slope + half**2 * stiffness * value
    past = half**2 * equation.delayed(times)[:, None] * value
    load = -(half**2) * equation.forcing(times)
    ends = []
    for side in (-1.0, 1.0):
        value, slope, _ = _basis(np.array([side]), degree)
        ends.append(np.vstack([value, slope / half]))
    return left, past, load, ends[0], ends[1]


def collocation_map(equation: DelayEquation, degree: int = 16) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """U, load and start rows of c^n = U c^{n-1} + load, where c holds the Chebyshev coefficients of all pieces.

    The third array (2, unknowns) gives displacement and velocity at the entry from c. degree: of each piece's series.
    """
    pieces = [_piece(equation, equation.breaks[i], equation.breaks[i + 1], degree)
              for i in range(len(equation.breaks) - 1)]
    width, size = degree + 1, (degree + 1) * len(pieces)
    left, right, load = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    flight = expm(np.array([[0.0, 1.0], [-equation.stiffness, -equation.damping]]) * equation.free_flight)
    for i, (rows, past, source, first, _) in enumerate(pieces):
        here = slice(i * width, (i + 1) * width)
        top = i * width
        scale = np.array([[1.0], [0.5 * (equation.breaks[i + 1] - equation.breaks[i])]])
        left[top:top + 2, here] = scale * first
        if i == 0:
            right[top:top + 2, size - width:] = scale * (flight @ pieces[-1][4])
        else:
            left[top:top + 2, here.start - width:here.start] = -scale * pieces[i - 1][4]
        left[top + 2:top + width, here], right[top + 2:top + width, here] = rows, past
        load[top + 2:top + width] = source
    start = np.zeros((2, size))
    start[:, :width] = pieces[0][3]
    return np.linalg.solve(left, right), np.linalg.solve(left, load), start


def collocation_multipliers(equation: DelayEquation, degree: int = 16) -> np.ndarray:
    """Characteristic multipliers by collocation, complex, largest modulus first, of a pair the upper first."""
    values = np.linalg.eigvals(collocation_map(equation, degree)[0])
    return np.array(sorted(values, key=lambda mu: (-round(abs(mu), 12), -mu.real, -mu.imag)))


def collocation_entry_state(equation: DelayEquation, degree: int = 16) -> np.ndarray:
    """Displacement (m) and velocity (m/s) of the periodic motion at a tooth's entry, shape (2,)."""
    matrix, load, start = collocation_map(equation, degree)
    return start @ np.linalg.solve(np.eye(load.size) - matrix, load)
