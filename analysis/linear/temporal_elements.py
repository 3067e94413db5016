"""Temporal finite elements (TFEA): the discrete map of a delay equation over one delay.

Cubic Hermite trial functions and the test functions 1 and eta - 1/2 on every element (Bayly et al. 2003, J. Manuf. Sci.
Eng. 125, 220; Mann and Young 2006, section 3 and appendix A). Elements cover the cut; free flight enters as the exact
state-transition matrix. The nodal states (displacement, velocity) a^n of period n obey a^n = Q a^{n-1} + c, and the
eigenvalues of Q are the characteristic multipliers. Error of |mu| in the rig: 1e-4 with 6 elements, 1e-6 with 20. It is the
published method, with numbers of elements as published; charts and all else use `spectral_elements`, of an order that follows
the cut.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from testbed.analysis.linear.delay_equation import DelayEquation
from testbed.system.kernel_cache import kept

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
GAUSS_POINTS, GAUSS_WEIGHTS = 0.5 * (_POINTS + 1.0), 0.5 * _WEIGHTS


@kept(fastmath=True)
def element_matrices(length, damping, stiffness, delayed, forcing, eta, weights, state, past, load):
    """Weighted residuals of one element: N (2, 4) into `state`, P (2, 4) into `past`, C (2) into `load`.

    length: s; the coefficients are (points,) arrays at the quadrature points `eta` with these `weights`.
    """
    state[:], past[:], load[:] = 0.0, 0.0, 0.0
    for g in range(eta.size):
        e = eta[g]
        e2 = e * e
        values = (1.0 - 3.0 * e2 + 2.0 * e2 * e, length * (e - 2.0 * e2 + e2 * e),
                  3.0 * e2 - 2.0 * e2 * e, length * (e2 * e - e2))
        slopes = ((6.0 * e2 - 6.0 * e) / length, 1.0 - 4.0 * e + 3.0 * e2,
                  (6.0 * e - 6.0 * e2) / length, 3.0 * e2 - 2.0 * e)
        curvatures = ((12.0 * e - 6.0) / length**2, (6.0 * e - 4.0) / length,
                      (6.0 - 12.0 * e) / length**2, (6.0 * e - 2.0) / length)
        w1 = weights[g] * length
        w2 = w1 * (e - 0.5)
        for i in range(4):
            residual = curvatures[i] + damping[g] * slopes[i] + stiffness[g] * values[i]
            state[0, i] += w1 * residual
            state[1, i] += w2 * residual
            past[0, i] += w1 * delayed[g] * values[i]
            past[1, i] += w2 * delayed[g] * values[i]
        load[0] -= w1 * forcing[g]
        load[1] -= w2 * forcing[g]


@kept(fastmath=True)
def assemble_map(lengths, damping, stiffness, delayed, forcing, flight, eta, weights, q, c):
    """Q (2E + 2, 2E + 2) and c (2E + 2) of a^n = Q a^{n-1} + c, written into `q` and `c`.

    The global matrices are block bidiagonal, so A^-1 B is found by going from node to node. lengths (E,);
    coefficients (E, points); flight (2, 2): state transition of the free flight from the last node to the first.
    """
    elements = lengths.size
    size = 2 * elements + 2
    state, past, load = np.empty((2, 4)), np.empty((2, 4)), np.empty(2)
    q[:], c[:] = 0.0, 0.0
    for i in range(2):
        for j in range(2):
            q[i, size - 2 + j] = flight[i, j]
    for n in range(elements):
        element_matrices(lengths[n], damping[n], stiffness[n], delayed[n], forcing[n], eta, weights, state, past, load)
        determinant = state[0, 2] * state[1, 3] - state[0, 3] * state[1, 2]
        a, b = state[1, 3] / determinant, -state[0, 3] / determinant
        d, e = -state[1, 2] / determinant, state[0, 2] / determinant
        row = 2 * n
        t00, t01 = -(a * state[0, 0] + b * state[1, 0]), -(a * state[0, 1] + b * state[1, 1])
        t10, t11 = -(d * state[0, 0] + e * state[1, 0]), -(d * state[0, 1] + e * state[1, 1])
        for k in range(size):
            q[row + 2, k] = t00 * q[row, k] + t01 * q[row + 1, k]
            q[row + 3, k] = t10 * q[row, k] + t11 * q[row + 1, k]
        for i in range(4):
            q[row + 2, row + i] += a * past[0, i] + b * past[1, i]
            q[row + 3, row + i] += d * past[0, i] + e * past[1, i]
        c[row + 2] = t00 * c[row] + t01 * c[row + 1] + a * load[0] + b * load[1]
        c[row + 3] = t10 * c[row] + t11 * c[row + 1] + d * load[0] + e * load[1]


@kept
def transition_matrix(damping, stiffness, time):
    """Exact state transition (2, 2) of x'' + damping x' + stiffness x = 0 over `time`; any sign of the discriminant."""
    result = np.empty((2, 2))
    half = 0.5 * damping
    discriminant = stiffness - half * half
    decay = math.exp(-half * time)
    if discriminant > 0.0:
        frequency = math.sqrt(discriminant)
        cosine, sine = math.cos(frequency * time), math.sin(frequency * time) / frequency
    elif discriminant < 0.0:
        frequency = math.sqrt(-discriminant)
        cosine, sine = math.cosh(frequency * time), math.sinh(frequency * time) / frequency
    else:
        cosine, sine = 1.0, time
    result[0, 0], result[0, 1] = decay * (cosine + half * sine), decay * sine
    result[1, 0], result[1, 1] = -decay * stiffness * sine, decay * (cosine - half * sine)
    return result


def element_edges(breaks: tuple[float, ...], elements: int) -> np.ndarray:
    """Node times (s): at least one element between neighbouring breaks, the rest where elements are longest."""
    lengths = np.diff(breaks)
    counts = np.ones(lengths.size, dtype=int)
    for _ in range(elements - lengths.size):
        counts[np.argmax(lengths / counts)] += 1
    pieces = [np.linspace(breaks[i], breaks[i + 1], counts[i] + 1)[:-1] for i in range(lengths.size)]
    return np.concatenate([*pieces, [breaks[-1]]])


@dataclass(frozen=True)
class TemporalElementMap:
    """a^n = matrix a^{n-1} + load; a holds displacement (m) and velocity (m/s) at the nodes in turn.

    matrix Q (2E + 2, 2E + 2), load c (2E + 2,), times of the nodes (E + 1,), s after the entry.
    """

    matrix: np.ndarray
    load: np.ndarray
    times: np.ndarray

    def multipliers(self) -> np.ndarray:
        """Characteristic multipliers, complex (2E + 2,), largest modulus first, of a pair the upper first."""
        scale = np.ones(self.load.size)
        scale[1::2] = self.times[-1]  # velocities in displacements, so that the matrix is balanced
        return sort_multipliers(np.linalg.eigvals(self.matrix * scale[:, None] / scale[None, :]))

    def fixed_point(self) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (m) and velocity (m/s) of the periodic motion at the nodes, each (E + 1,)."""
        state = np.linalg.solve(np.eye(self.load.size) - self.matrix, self.load)
        return state[0::2], state[1::2]


def sort_multipliers(multipliers: np.ndarray) -> np.ndarray:
    """Largest modulus first; of a conjugate pair the member in the upper half plane first."""
    values = np.asarray(multipliers, dtype=complex)
    return values[np.lexsort((-values.imag, -values.real, -np.round(np.abs(values), 12)))]


def temporal_element_map(equation: DelayEquation, elements: int = 6) -> TemporalElementMap:
    """The map of `equation` on `elements` temporal elements (more where it has more smooth pieces than that)."""
    if elements < 1:
        raise ValueError("elements must be at least 1")
    edges = element_edges(equation.breaks, elements)
    lengths = np.diff(edges)
    times = edges[:-1, None] + lengths[:, None] * GAUSS_POINTS
    size = 2 * lengths.size + 2
    q, c = np.empty((size, size)), np.empty(size)
    assemble_map(lengths, equation.damping + equation.periodic_damping(times),
                 equation.stiffness + equation.periodic_stiffness(times), equation.delayed(times),
                 equation.forcing(times), transition_matrix(equation.damping, equation.stiffness, equation.free_flight),
                 GAUSS_POINTS, GAUSS_WEIGHTS, q, c)
    return TemporalElementMap(q, c, edges)


def characteristic_multipliers(equation: DelayEquation, elements: int = 6) -> np.ndarray:
    """Characteristic multipliers by temporal finite elements, complex (2E + 2,), largest first."""
    return temporal_element_map(equation, elements).multipliers()
