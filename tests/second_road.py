"""Multipliers of a milling cut by another road: Chebyshev collocation of the first-order system, from the forces up.

Shares no code with the analysis: teeth, corners, the force of a helix (Gauss's rule over the height in the cut) and the
solution operator are written anew (Trefethen 2000, Spectral Methods in MATLAB, chapter 6; Butcher et al. 2004, Int. J. Numer.
Meth. Eng. 59, 895). Everything is computed to rounding, at a cost that no chart could bear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(16)


@dataclass(frozen=True)
class Milling:
    """mass kg, frequency Hz, damping ratio; teeth, helix rad, diameter m; up-milling or not, radial depth over diameter;
    K_t and K_n N/m^2; speed rad/s."""

    mass: float
    frequency: float
    damping: float
    teeth: int
    helix: float
    diameter: float
    up: bool
    radial: float
    tangential: float
    normal: float
    speed: float

    @property
    def angles(self) -> tuple[float, float]:
        """Entry and exit, rad from the normal to the feed."""
        return (0.0, math.acos(1 - 2 * self.radial)) if self.up else (math.acos(2 * self.radial - 1), math.pi)

    def lag(self, depth: float) -> float:
        return 2.0 * depth * math.tan(self.helix) / self.diameter

    def stiffness(self, turned: float, depth: float) -> float:
        """Force along the feed per chip at a spindle angle, N/m; tooth 0's tip enters at 0."""
        entry, leave = self.angles
        lag, total = self.lag(depth), 0.0
        for number in range(self.teeth):
            tip = (entry + turned + 2 * math.pi * number / self.teeth - entry) % (2 * math.pi) + entry
            turns = math.floor((leave + lag - tip) / (2 * math.pi)) + 1  # a long helix may still cut from turns before
            for theta in (tip + 2 * math.pi * turn for turn in range(max(turns, 1))):
                if lag == 0.0:
                    if entry < theta < leave:
                        total += depth * self._law(np.array([theta]))[0]
                    continue
                high, low = min(theta, leave), max(theta - lag, entry)
                if high > low:
                    angles = 0.5 * (high + low) + 0.5 * (high - low) * _POINTS
                    total += depth / lag * 0.5 * (high - low) * float(_WEIGHTS @ self._law(angles))
        return total

    def _law(self, theta: np.ndarray) -> np.ndarray:
        return (self.tangential * np.cos(theta) + self.normal * np.sin(theta)) * np.sin(theta)

    def corners(self, depth: float) -> list[float]:
        """Spindle angles within a pitch at which a point of an edge enters or leaves, and the cut's end."""
        pitch, wide = 2 * math.pi / self.teeth, self.angles[1] - self.angles[0]
        reach = min(wide + self.lag(depth), pitch)
        places = {angle % pitch for angle in (wide, self.lag(depth), wide + self.lag(depth))}
        inner = sorted(place for place in places if 1e-9 < place < reach - 1e-9)
        apart = [place for number, place in enumerate(inner) if number == 0 or place - inner[number - 1] > 1e-9]
        return [0.0, *apart, reach]


def _differences(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev points from -1 to 1 and the matrix that differentiates through them."""
    k = np.arange(count + 1)
    x = -np.cos(math.pi * k / count)
    c = np.where((k == 0) | (k == count), 2.0, 1.0) * (-1.0) ** k
    matrix = np.outer(c, 1 / c) / (x[:, None] - x[None, :] + np.eye(count + 1))
    return x, matrix - np.diag(matrix.sum(axis=1))


def multipliers(machine: Milling, depth: float, finer: float = 1.0) -> np.ndarray:
    """All multipliers over a tooth passing period, largest first."""
    omega = 2 * math.pi * machine.frequency
    edges = np.array(machine.corners(depth)) / machine.speed
    delay = 2 * math.pi / (machine.teeth * machine.speed)
    strongest = depth * (abs(machine.tangential) + abs(machine.normal)) / machine.mass * max(1.0, machine.teeth / 2)
    fast = math.sqrt(omega**2 + 2 * strongest)
    counts = [int(finer * (24 + 0.8 * fast * (b - a))) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    size = sum(count + 1 for count in counts)
    flight = expm(np.array([[0.0, 1.0], [-(omega**2), -2 * machine.damping * omega]]) * max(delay - edges[-1], 0.0))
    # what follows from the points of the period before and its last velocity: u = [x at all points, v at the end]
    state = np.zeros((2, size + 1))
    state[:, size - 1], state[:, size] = flight[:, 0], flight[:, 1]
    rows, begin = [], 0
    for a, b, count in zip(edges[:-1], edges[1:], counts, strict=True):
        x, slope = _differences(count)
        slope = slope * 2.0 / (b - a)
        times = 0.5 * (a + b) + 0.5 * (b - a) * x
        inside = np.clip(times, a + 1e-9 * (b - a), b - 1e-9 * (b - a))  # the limit from within, at corners
        force = np.array([machine.stiffness(machine.speed * time, depth) for time in inside]) / machine.mass
        n = count + 1
        left = np.block([[slope, -np.eye(n)], [np.diag(omega**2 + force), slope + 2 * machine.damping * omega * np.eye(n)]])
        right = np.zeros((2 * n, size + 1))
        right[n + np.arange(n), begin + np.arange(n)] = force
        for row, start in ((0, state[0]), (n, state[1])):
            left[row], right[row] = 0.0, start
            left[row, row] = 1.0
        scale = np.concatenate([np.ones(n), np.full(n, omega)])  # displacements and velocities alike in size
        solved = np.linalg.solve(left * scale, right) * scale[:, None]
        rows.append(solved[:n])
        state = solved[[n - 1, 2 * n - 1]]
        begin += n
    matrix = np.vstack([*rows, state[1]])
    scale = np.ones(size + 1)
    scale[-1] = omega
    values = np.linalg.eigvals(matrix * scale / scale[:, None])
    return values[np.argsort(-np.abs(values))]
