"""Real modes fitted to measured receptances, all together: natural frequency, damping ratio and mass-normalised shape.

    H(s) = sum over modes of (sensed . g) (along . g) / (s^2 + 2 zeta omega s + omega^2)  +  lower / s^2  +  upper

g is the mode's direction over the root of its mass; where force and sensor turn out not to be at one point, a mode may answer
against the force, with a sign of its own before the product. `lower` and `upper` are real, two for each response: what modes
below and above the band leave in it. They are linear and the same for any modes, so that they are projected out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from testbed.analysis.tap.frequency_response import FrequencyResponse

_SMOOTH = 5  # lines that a level is averaged over
_SPREAD = 0.2  # of a natural frequency, that a fit may move it by
_LEAST_DAMPING, _MOST_DAMPING = 1e-5, 0.5


class Lines:
    """What a fit looks at: the believed lines of several responses of one carrier, stacked as real and imaginary parts.

    errors: (lines,) of each response, m/N, by how much real modes are taken to miss each believed line. against: whether modes
    may answer against the force. weights: one over the uncertainty of each line, its noise and its error together.
    """

    def __init__(self, responses: Sequence[FrequencyResponse], masks: Sequence[np.ndarray], basis: np.ndarray,
                 errors: Sequence[np.ndarray], against: bool = False) -> None:
        self.responses, self.basis, self.against = tuple(responses), basis, against
        self.masks = tuple(masks)
        self.laplace = [one.laplace[mask] for one, mask in zip(responses, masks, strict=True)]
        self.measured = [one.receptance[mask] for one, mask in zip(responses, masks, strict=True)]
        self.sensed = np.array([one.sensed for one in responses]) @ basis.T
        self.along = np.array([one.along for one in responses]) @ basis.T
        self.weights, self._rests = [], []
        for one, mask, laplace, error in zip(responses, masks, self.laplace, errors, strict=True):
            weight = 1.0 / np.sqrt(one.noise[mask] ** 2 + error**2)
            self.weights.append(weight)
            columns = _stacked(_residual_columns(laplace) * weight[:, None])
            self._rests.append(np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0])
        self.count = 2 * sum(map(len, self.laplace))
        self.noise_cost = float(sum(np.sum((one.noise[mask] * weight) ** 2)
                                    for one, mask, weight in zip(responses, masks, self.weights, strict=True)))

    def project(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Complex values of each response's lines, (lines, ...), weighted and stacked without what the residual terms take."""
        return np.concatenate([self.projected(place, part) for place, part in enumerate(parts)])

    def projected(self, place: int, part: np.ndarray) -> np.ndarray:
        """The same of the lines of one response."""
        weight, rest = self.weights[place], self._rests[place]
        column = _stacked(part * (weight if part.ndim == 1 else weight[:, None]))
        return column - rest @ (rest.T @ column)

    def rest_terms(self, parts: Sequence[np.ndarray]) -> list[np.ndarray]:
        """The two residual terms' values (lines, 2) for what the modes leave of each response."""
        found = []
        for part, weight, laplace in zip(parts, self.weights, self.laplace, strict=True):
            columns = _residual_columns(laplace)
            scaled = _stacked(columns * weight[:, None])
            size = np.linalg.norm(scaled, axis=0)
            terms = np.linalg.lstsq(scaled / size, _stacked(part * weight), rcond=None)[0] / size
            found.append(columns * terms)
        return found


def levels(responses: Sequence[FrequencyResponse], masks: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Size of each response about its believed lines, (lines,), m/N."""
    return [uniform_filter1d(np.abs(one.receptance), _SMOOTH, mode="nearest")[mask]
            for one, mask in zip(responses, masks, strict=True)]


def _residual_columns(laplace: np.ndarray) -> np.ndarray:
    return np.column_stack([1.0 / laplace**2, np.ones(len(laplace))])


def _stacked(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag])


@dataclass(frozen=True)
class Fit:
    """Modes and how well they fit. parameters: (modes, 2 + dimensions): log omega, log zeta, shape in the basis.

    signs: (modes,), -1 where a mode answers against the force. slopes: of the weighted model
    (rows, all parameters); misfit: (rows,), weighted.
    """

    lines: Lines
    parameters: np.ndarray
    signs: np.ndarray
    misfit: np.ndarray
    slopes: np.ndarray

    @property
    def cost(self) -> float:
        """Sum of the squared weighted misfit."""
        return float(self.misfit @ self.misfit)

    @property
    def beyond_noise(self) -> float:
        """What of the cost the lines' noise does not explain."""
        return max(0.0, self.cost - self.lines.noise_cost)

    def fitted(self) -> list[np.ndarray]:
        """The fitted receptance of each response at its believed lines."""
        return [parts.sum(axis=1) for parts in self._parts()]

    def size_of_parts(self) -> list[np.ndarray]:
        """Root of the summed squares of the modes' and residual terms' parts in each believed line, (lines,), m/N.

        Where modes cancel one another, what each is wrong by does not cancel.
        """
        return [np.sqrt((np.abs(parts) ** 2).sum(axis=1)) for parts in self._parts()]

    def _parts(self) -> list[np.ndarray]:
        """Of each response (lines, modes + 2): what each mode and each residual term is of it."""
        modal = _modal(self.lines, self.parameters, self.signs)
        left = [measured - part.sum(axis=1) for measured, part in zip(self.lines.measured, modal, strict=True)]
        return [np.column_stack([part, rest]) for part, rest in zip(modal, self.lines.rest_terms(left), strict=True)]


def _unit(lines: Lines, omega: np.ndarray, zeta: np.ndarray) -> list[np.ndarray]:
    """1 / (s^2 + 2 zeta omega s + omega^2), (lines, modes) of each response."""
    return [1.0 / (s[:, None] ** 2 + 2.0 * zeta * omega * s[:, None] + omega**2) for s in lines.laplace]


def _modal(lines: Lines, parameters: np.ndarray, signs: np.ndarray) -> list[np.ndarray]:
    """Receptance of each mode (lines, modes) in each response."""
    omega, zeta, shapes = np.exp(parameters[:, 0]), np.exp(parameters[:, 1]), parameters[:, 2:]
    return [unit * signs * (shapes @ sensed) * (shapes @ along)
            for unit, sensed, along in zip(_unit(lines, omega, zeta), lines.sensed, lines.along, strict=True)]


def _slopes(lines: Lines, parameters: np.ndarray, signs: np.ndarray) -> np.ndarray:
    """Slopes of the weighted model (rows, parameters)."""
    omega, zeta, shapes = np.exp(parameters[:, 0]), np.exp(parameters[:, 1]), parameters[:, 2:]
    width = parameters.shape[1]
    columns = []
    for s, unit, sensed, along in zip(lines.laplace, _unit(lines, omega, zeta), lines.sensed, lines.along, strict=True):
        out, into = shapes @ sensed, shapes @ along
        unit = unit * signs  # squared below, it keeps no sign
        part = np.empty((len(s), len(parameters), width), dtype=complex)
        part[:, :, 0] = -signs * unit**2 * (2.0 * zeta * omega * s[:, None] + 2.0 * omega**2) * out * into
        part[:, :, 1] = -signs * unit**2 * 2.0 * zeta * omega * s[:, None] * out * into
        for axis in range(width - 2):
            part[:, :, 2 + axis] = unit * (sensed[axis] * into + along[axis] * out)
        columns.append(part.reshape(len(s), -1))
    return lines.project(columns)


def residues(lines: Lines, omega: np.ndarray, zeta: np.ndarray) -> tuple[np.ndarray, float]:
    """Least squares with poles held: residues (responses, modes), 1/kg, real and free in each response, and the cost left."""
    found, cost = [], 0.0
    for place, unit in enumerate(_unit(lines, omega, zeta)):
        rows, target = lines.projected(place, unit), lines.projected(place, lines.measured[place])
        size = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        scaled = np.linalg.lstsq(rows / size, target, rcond=None)[0]
        left = target - (rows / size) @ scaled
        cost += float(left @ left)
        found.append(scaled / size)
    return np.array(found), cost


def shapes_of(lines: Lines, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shapes (modes, dimensions) whose products come closest to free residues (responses, modes), and their signs (modes,)."""
    size = lines.basis.shape[0]
    upper = np.triu_indices(size)
    twice = np.where(upper[0] == upper[1], 0.5, 1.0)
    design = np.array([twice * (np.outer(out, into) + np.outer(into, out))[upper]
                       for out, into in zip(lines.sensed, lines.along, strict=True)])
    entries = np.linalg.lstsq(design, found, rcond=None)[0]
    shapes, signs = np.empty((found.shape[1], size)), np.ones(found.shape[1])
    for mode in range(found.shape[1]):
        matrix = np.zeros((size, size))
        matrix[upper] = entries[:, mode]
        values, vectors = np.linalg.eigh(matrix + np.triu(matrix, 1).T)
        best = int(np.argmax(np.abs(values)))
        if lines.against:
            signs[mode] = np.sign(values[best]) or 1.0
        else:
            best = size - 1  # the largest itself
        shapes[mode] = vectors[:, best] * np.sqrt(max(signs[mode] * values[best], 1e-3 * np.abs(values).max(), 1e-12))
    return shapes, signs


def fit_modes(lines: Lines, start: np.ndarray, signs: np.ndarray, most: int = 60) -> Fit:
    """Least squares from start (modes, 2 + dimensions) and its signs, which stay. No mode is a fit, too."""
    target = lines.project(lines.measured)
    if not len(start):
        return Fit(lines, start, signs, target, np.empty((len(target), 0)))
    size = start.shape

    def misfit(flat: np.ndarray) -> np.ndarray:
        parts = [part.sum(axis=1) for part in _modal(lines, flat.reshape(size), signs)]
        return target - lines.project(parts)

    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    low[:, 0], high[:, 0] = start[:, 0] - _SPREAD, start[:, 0] + _SPREAD
    low[:, 1], high[:, 1] = np.log(_LEAST_DAMPING), np.log(_MOST_DAMPING)
    begin = np.clip(start, low + 1e-9, high - 1e-9)
    done = least_squares(misfit, begin.ravel(), lambda flat: -_slopes(lines, flat.reshape(size), signs),
                         (low.ravel(), high.ravel()), x_scale="jac", max_nfev=most, xtol=1e-9, ftol=1e-10)
    found = done.x.reshape(size)
    return Fit(lines, found, signs, done.fun, -done.jac)
