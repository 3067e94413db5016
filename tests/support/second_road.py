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


def angles(up: bool, radial: float) -> tuple[float, float]:
    """Entry and exit, rad from the normal to the feed; radial: depth over diameter."""
    return (0.0, math.acos(1 - 2 * radial)) if up else (math.acos(2 * radial - 1), math.pi)


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
        return angles(self.up, self.radial)

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


@dataclass(frozen=True)
class Planar:
    """Modes as (mass kg, frequency Hz, damping ratio, direction rad); pitches rad, of each tooth to the one before it; helix
    rad, diameter m; up-milling or not, radial depth over diameter; K_t and K_n N/m^2; speed rad/s."""

    modes: tuple[tuple[float, float, float, float], ...]
    pitches: tuple[float, ...]
    helix: float
    diameter: float
    up: bool
    radial: float
    tangential: float
    normal: float
    speed: float

    @property
    def angles(self) -> tuple[float, float]:
        return angles(self.up, self.radial)

    def forces(self, turned: float, depth: float, tooth: int) -> np.ndarray:
        """Force (x, y) on the workpiece by a chip along x and along y, of one tooth at a spindle angle; tooth 0 enters at 0.

        Slices of the edge are summed by Gauss's rule over the part of the height that is in the cut.
        """
        entry, leave = self.angles
        lag = 2.0 * depth * math.tan(self.helix) / self.diameter
        total = np.zeros((2, 2))
        tip = (turned - sum(self.pitches[1:tooth + 1])) % (2 * math.pi) + entry
        while tip < leave + lag:
            high, low = min(tip, leave), max(tip - lag, entry)
            angles, weights = np.array([tip]), np.array([depth if tip < leave else 0.0])
            if lag > 0.0:
                angles = 0.5 * (high + low) + 0.5 * (high - low) * _POINTS
                weights = 0.5 * (high - low) * _WEIGHTS * depth / lag
            for theta, weight in zip(angles, weights, strict=True):
                along = np.array([-math.cos(theta), math.sin(theta)])  # where K_t pushes the workpiece
                inward = np.array([-math.sin(theta), -math.cos(theta)])  # and K_n
                chip = np.array([math.sin(theta), math.cos(theta)])
                total += weight * np.outer(self.tangential * along + self.normal * inward, chip)
            tip += 2 * math.pi
        return total


def planar_multipliers(machine: Planar, depth: float, finer: float = 1.0) -> np.ndarray:
    """All multipliers over a revolution, largest first: Chebyshev collocation of the first-order system of all modes.

    The mesh is the entries and exits of all teeth and the surface that each has from the two before it; the motion a delay ago
    is the polynomial of the piece where it was, by barycentric interpolation.
    """
    mass, frequency, damping, direction = (np.array(part) for part in zip(*machine.modes, strict=True))
    shape, omega = np.array([np.cos(direction), np.sin(direction)]), 2 * math.pi * frequency
    turn, window = 2 * math.pi, machine.angles[1] - machine.angles[0] + 2 * depth * math.tan(machine.helix) / machine.diameter
    starts = np.cumsum(machine.pitches) - machine.pitches[0]
    lag = window - (machine.angles[1] - machine.angles[0])
    edges = {(start + place) % turn for start in starts for place in (0.0, lag, window - lag, window)}
    for _ in range(2):
        edges |= {(edge + pitch) % turn for tooth, pitch in enumerate(machine.pitches) for edge in edges
                  if (edge - starts[tooth - 1]) % turn < window}
    places = [0.0]
    for edge in [*sorted(edges), turn]:
        if edge - places[-1] > 1e-7:
            places.append(edge)
    places[-1] = turn
    strongest = 2 * depth * (machine.tangential + machine.normal) * len(machine.pitches) * (1 / mass).sum()
    fast = math.sqrt(omega.max() ** 2 + strongest) / machine.speed
    shortest = min(machine.pitches)
    mesh = []
    for a, b in zip(places[:-1], places[1:], strict=True):
        pieces = max(1, math.ceil((b - a) / shortest), math.ceil((b - a) * fast / 20.0))
        mesh += [(a + (b - a) * k / pieces, a + (b - a) * (k + 1) / pieces) for k in range(pieces)]
    counts = [int(finer * (10 + 1.0 * fast * (b - a))) for a, b in mesh]
    begin = np.concatenate([[0], np.cumsum([count + 1 for count in counts])])
    modes, size = mass.size, int(begin[-1])
    unknowns = 2 * size + 2 * modes  # x and y at all points, then displacements and speeds over omega at the end
    motion = np.zeros((2 * size, unknowns))  # of this revolution, by what went before it
    state = np.zeros((2 * modes, unknowns))
    state[:, 2 * size:] = np.eye(2 * modes)
    grids = [_differences(count) for count in counts]
    ends = np.array([b for _, b in mesh])
    for piece, (a, b) in enumerate(mesh):
        x, slope = grids[piece]
        n, slope = x.size, slope * 2.0 / (b - a)
        angles = 0.5 * (a + b) + 0.5 * (b - a) * x
        inside = np.clip(angles, a + 1e-9 * (b - a), b - 1e-9 * (b - a))
        push, past = np.zeros((n, 2, 2)), np.zeros((2 * n, unknowns))
        for i, angle in enumerate(inside):
            for tooth, pitch in enumerate(machine.pitches):
                force = machine.forces(angle, depth, tooth)
                if not force.any():
                    continue
                push[i] += force
                met = angle - pitch
                source = min(int(np.searchsorted(ends, met % turn)), len(mesh) - 1)
                low, high = mesh[source]
                row = _interpolated(grids[source][0], (2 * (met % turn) - low - high) / (high - low))
                for axis in range(2):
                    there = slice(2 * int(begin[source]) + axis, 2 * int(begin[source + 1]), 2)
                    if met < 0:
                        past[2 * i:2 * i + 2, there] += np.outer(force[:, axis], row)
                    else:
                        past[2 * i:2 * i + 2] += np.outer(force[:, axis], row @ motion[there])
        left, right = np.zeros((2 * modes * n, 2 * modes * n)), np.zeros((2 * modes * n, 2 * modes + 2 * n))
        for j in range(modes):
            q, v = slice(2 * j * n, (2 * j + 1) * n), slice((2 * j + 1) * n, (2 * j + 2) * n)
            rate = omega[j] / machine.speed
            left[q, q], left[q, v] = slope, -rate * np.eye(n)
            left[v, q], left[v, v] = rate * np.eye(n), slope + 2 * damping[j] * rate * np.eye(n)
            scale = 1 / (mass[j] * machine.speed * omega[j])
            for other in range(modes):  # the push by the motion of now is minus that of the chip left before
                own = np.einsum("a,nab,b->n", shape[:, j], push, shape[:, other]) * scale
                left[v, 2 * other * n:(2 * other + 1) * n] -= np.diag(own)
            for axis in range(2):
                right[v, 2 * modes + axis::2] = -scale * shape[axis, j] * np.eye(n)
            for part, row in ((q, 2 * j), (v, 2 * j + 1)):
                left[part.start], right[part.start] = 0.0, 0.0
                left[part.start, part.start] = right[part.start, row] = 1.0
        solved = np.linalg.solve(left, right).reshape(modes, 2, n, 2 * modes + 2 * n)
        given = np.vstack([state, past])
        rows = np.einsum("aj,jnu->nau", shape, solved[:, 0]).reshape(2 * n, -1)
        motion[2 * begin[piece]:2 * begin[piece + 1]] = rows @ given
        state = solved[:, :, -1].reshape(2 * modes, -1) @ given
    matrix = np.vstack([motion, state])
    met = matrix.any(axis=0)  # points that no tooth meets afterwards have multipliers of 0
    values = np.linalg.eigvals(matrix[np.ix_(met, met)])
    return values[np.argsort(-np.abs(values))]


def _interpolated(x: np.ndarray, place: float) -> np.ndarray:
    """Weights of the values at Chebyshev points in the value at a place."""
    signs = (-1.0) ** np.arange(x.size)
    signs[[0, -1]] *= 0.5
    gaps = place - x
    if np.abs(gaps).min() < 1e-13:
        return (np.abs(gaps) == np.abs(gaps).min()).astype(float)
    weights = signs / gaps
    return weights / weights.sum()
