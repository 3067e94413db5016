"""Stability of a cut: the class of its largest multiplier, and charts over spindle speed and depth of cut.

|mu| < 1 is stable. Crossing the unit circle as a complex pair is a Neimark-Sacker bifurcation (chatter), at -1 a flip
(period doubling), at +1 a saddle node. A chart builds every map by temporal finite elements in compiled code and finds
its dominant pair by repeated squaring; a cell whose pair cannot be vouched for is given the full eigenvalue problem.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit

from analysis.linear.delay_equation import milling_equation
from analysis.linear.temporal_elements import assemble_map, element_edges, transition_matrix
from testbed.cut import Cut
from testbed.machine import Model

LimitLies = Literal["within", "below", "above"]
StabilityClass = Literal["stable", "neimark_sacker", "flip", "saddle_node"]
CLASSES: tuple[StabilityClass, ...] = ("stable", "neimark_sacker", "flip", "saddle_node")
_SAID = {"neimark_sacker": "Neimark-Sacker", "saddle_node": "saddle-node"}
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_ETA, _GAUSS = 0.5 * (_POINTS + 1.0), 0.5 * _WEIGHTS


def said_class(name: str) -> str:
    """A class, or another outcome of a cut, as it is written for people."""
    return _SAID.get(name, name.replace("_", " "))


def classify(multipliers: np.ndarray) -> StabilityClass:
    """The class named by the multiplier of largest modulus; `multipliers` in any order. ValueError if there is none."""
    values = np.asarray(multipliers, dtype=complex).ravel()
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise ValueError("multipliers must be finite, at least one")
    largest = values[np.argmax(np.abs(values))]
    if abs(largest) < 1.0:
        return "stable"
    if abs(largest.imag) > 1e-9 * abs(largest):
        return "neimark_sacker"
    return "flip" if largest.real < 0.0 else "saddle_node"


@dataclass(frozen=True)
class StabilityChart:
    """Largest multipliers over a grid.

    spindle_speeds (S,) rad/s, axial_depths (B,) m; largest (B, S) complex: the multiplier of largest modulus, of a
    pair the upper; classes (B, S): indices into CLASSES.
    """

    spindle_speeds: np.ndarray
    axial_depths: np.ndarray
    largest: np.ndarray
    classes: np.ndarray

    @property
    def spectral_radius(self) -> np.ndarray:
        """|mu| of the largest multiplier, (B, S)."""
        return np.abs(self.largest)

    def stability_limit(self) -> np.ndarray:
        """Depth (m) at which |mu| first reaches 1 at each speed, (S,); NaN where the chart holds no such depth."""
        radius, depths = self.spectral_radius, self.axial_depths
        limit = np.full(self.spindle_speeds.size, np.nan)
        for column, lies in enumerate(self.limit_lies()):
            if lies == "within":
                k = int(np.argmax(radius[:, column] >= 1.0))
                limit[column] = np.interp(1.0, radius[k - 1:k + 1, column], depths[k - 1:k + 1])
        return limit

    def limit_lies(self) -> list[LimitLies | None]:
        """Where the limit lies at each speed: within the chart's depths, below or above them; None where cells are blank."""
        found: list[LimitLies | None] = []
        for radius in self.spectral_radius.T:
            unstable = np.flatnonzero(radius >= 1.0)
            below = radius[unstable[0] - 1] if unstable.size else radius[-1]  # of the cell under the limit
            if unstable.size and unstable[0] == 0:
                found.append("below")
            else:
                found.append(None if np.isnan(below) else "within" if unstable.size else "above")
        return found


@njit(cache=True, fastmath=True)
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


@njit(cache=True, fastmath=True)
def _times(matrix, vector, result):
    for i in range(vector.size):
        total = 0.0
        for j in range(vector.size):
            total += matrix[i, j] * vector[j]
        result[i] = total


@njit(cache=True)
def _full(matrix):
    """Largest eigenvalue by the full problem; of a pair the upper."""
    values = np.linalg.eigvals(matrix.astype(np.complex128))
    best = values[0]
    for value in values:
        if abs(value) > abs(best) * (1.0 + 1e-12):
            best = value
    imaginary = abs(best.imag)
    return complex(best.real, imaginary if imaginary > 1e-9 * abs(best) else 0.0)


@njit(cache=True, fastmath=True)
def _dominant(matrix, work, u0, u1, u2):
    """The largest eigenvalue from a vector filtered by matrix^16, and whether it can be vouched for.

    Two guards. If one Rayleigh quotient already has no residual, one real multiplier dominates and a pair fit would
    be singular. Otherwise u2 = s u1 - p u0 is fitted; its misfit shows what a third multiplier still contributes.
    """
    n = matrix.shape[0]
    _square(matrix, work[0])
    _square(work[0], work[1])
    _square(work[1], work[0])
    _square(work[0], work[1])
    best, column = -1.0, 0
    for j in range(n):
        total = 0.0
        for i in range(n):
            total += work[1][i, j] ** 2
        if total > best:
            best, column = total, j
    for i in range(n):
        u0[i] = work[1][i, column]
    _times(matrix, u0, u1)
    _times(matrix, u1, u2)
    a00, a01, a11, b0, b1, c = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        a00 += u0[i] * u0[i]
        a01 += u0[i] * u1[i]
        a11 += u1[i] * u1[i]
        b0 += u0[i] * u2[i]
        b1 += u1[i] * u2[i]
        c += u2[i] * u2[i]
    if a00 == 0.0 or c == 0.0:
        return complex(0.0, 0.0), False
    real = a01 / a00
    determinant = a00 * a11 - a01 * a01
    if determinant < 1e-10 * a00 * a11:
        return complex(real, 0.0), True
    s = (a00 * b1 - a01 * b0) / determinant
    p = -(a11 * b0 - a01 * b1) / determinant
    misfit = (c - s * b1 + p * b0) / c
    discriminant = 0.25 * s * s - p
    if discriminant < 0.0:
        value = complex(0.5 * s, math.sqrt(-discriminant))
    else:
        value = complex(0.5 * s + math.copysign(math.sqrt(discriminant), s), 0.0)
    return value, misfit < 1e-10 and abs(discriminant) > 1e-6 * abs(p)


@njit(cache=True)
def _chart(delays, fractions, cut_fraction, stiffness, added, damping, stiffness0, eta, weights, largest, checked):
    """Fill `largest` (B, S); returns how many cells went to the full eigenvalue problem, all of them if `checked`.

    fractions (B, E): element lengths over the delay; cut_fraction (B,); stiffness (B, E, G): b K_s at the points;
    added (B or 1, S or 1, E, G): further damping in the cut.
    """
    depths, elements = fractions.shape
    points = eta.size
    n = 2 * elements + 2
    q, c, work = np.empty((n, n)), np.empty(n), np.empty((2, n, n))
    u0, u1, u2 = np.empty(n), np.empty(n), np.empty(n)
    zero, whole, total = np.zeros((elements, points)), np.empty((elements, points)), np.empty((elements, points))
    full = 0
    for s in range(delays.size):
        tau = delays[s]
        scale = tau / (2.0 * math.pi)
        for b in range(depths):
            flight = transition_matrix(damping, stiffness0, (1.0 - cut_fraction[b]) * tau)
            drag = added[min(b, added.shape[0] - 1), min(s, added.shape[1] - 1)]
            for e in range(elements):
                for g in range(points):
                    whole[e, g] = stiffness0 + stiffness[b, e, g]
                    total[e, g] = damping + drag[e, g]
            assemble_map(fractions[b] * tau, total, whole, stiffness[b], zero, flight, eta, weights, q, c)
            for i in range(0, n, 2):
                for j in range(0, n, 2):
                    q[i, j + 1] /= scale
                    q[i + 1, j] *= scale
            value, sure = _dominant(q, work, u0, u1, u2)
            if checked or not sure:
                value = _full(q)
                full += 1
            largest[b, s] = value
    return full


def stability_chart(model: Model, spindle_speeds: np.ndarray, axial_depths: np.ndarray, *, elements: int = 3,
                    added_damping: np.ndarray | None = None, full_eigenvalues: bool = False) -> StabilityChart:
    """Largest multipliers of `model` over spindle speeds (S,) rad/s and axial depths of cut (B,) m.

    elements per cut: |mu| is right to 1e-3 with 3, 8e-5 with 6. added_damping: further damping over the modal mass
    (1/s) in the cut, broadcastable to (B, S). full_eigenvalues: no short cut in any cell.
    """
    speeds, depths = np.atleast_1d(np.asarray(spindle_speeds, float)), np.atleast_1d(np.asarray(axial_depths, float))
    equations = [milling_equation(model, Cut(spindle_speed=speeds[0], axial_depth_of_cut=depth)) for depth in depths]
    flutes = model.cutter.flutes if model.cutter else 1
    edges = [element_edges(equation.breaks, elements) for equation in equations]
    delays = 2.0 * math.pi / (flutes * speeds)
    drag = np.zeros((1, 1)) if added_damping is None else np.atleast_2d(np.asarray(added_damping, float))
    largest = np.empty((depths.size, speeds.size), dtype=complex)
    for count in sorted({edge.size for edge in edges}):  # helix may give deeper cuts more smooth pieces
        rows = [row for row, edge in enumerate(edges) if edge.size == count]
        nodes = np.array([edges[row] for row in rows])
        lengths = np.diff(nodes, axis=1)
        times = nodes[:, :-1, None] + lengths[:, :, None] * _ETA
        stiffness = np.array([equations[row].periodic_stiffness(times[i]) for i, row in enumerate(rows)])
        part = drag[rows] if drag.shape[0] > 1 else drag
        added = np.ascontiguousarray(np.broadcast_to(part[:, :, None, None], (*part.shape, count - 1, _ETA.size)))
        filled = np.empty((len(rows), speeds.size), dtype=complex)
        cut_fraction = np.array([1.0 - equations[row].free_flight / equations[row].delay for row in rows])
        _chart(delays, lengths / delays[0], cut_fraction, stiffness, added, equations[0].damping,
               equations[0].stiffness, _ETA, _GAUSS, filled, full_eigenvalues)
        largest[rows] = filled
    classes = np.where(np.abs(largest) < 1.0, 0, np.where(largest.imag > 1e-9 * np.abs(largest), 1,
                                                         np.where(largest.real < 0.0, 2, 3))).astype(np.int8)
    return StabilityChart(speeds, depths, largest, classes)
