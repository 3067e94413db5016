"""How uncertain fitted modes are: by the noise of the lines, and by how much the blows scatter."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import chdtri, stdtrit

from testbed.analysis.estimate import Estimate
from testbed.analysis.information import Z_95
from testbed.analysis.tap.order import together
from testbed.analysis.tap.real_modes import Fit

_CHANCE = 0.01  # by which blows scatter more than their noise explains


def covariance(fit: Fit) -> np.ndarray:
    """Covariance of all parameters, (n, n), by the misfit's size and over how many lines it goes together."""
    free = max(1.0, fit.lines.count - fit.parameters.size - 2.0 * len(fit.lines.responses))
    size = fit.cost / free * together(fit.lines, fit.misfit)
    return size * np.linalg.pinv(fit.slopes.T @ fit.slopes, rcond=1e-14, hermitian=True)


def widths(fit: Fit) -> np.ndarray:
    """Half widths of 95 % intervals of all combinations' parameters, as a matrix root: (n, n), z included."""
    noise = covariance(fit)
    scatter, freedom = by_blows(fit)
    if scatter is None:
        return Z_95**2 * noise
    found = Z_95**2 * noise
    for place in range(len(noise)):
        ratio = scatter[place, place] / max(noise[place, place], 1e-300)
        if ratio > chdtri(freedom, _CHANCE) / freedom:
            wide = float(stdtrit(freedom, 0.975)) ** 2 * scatter[place, place] / max(found[place, place], 1e-300)
            found[place, :] *= math.sqrt(wide)
            found[:, place] *= math.sqrt(wide)
    return found


def by_blows(fit: Fit) -> tuple[np.ndarray | None, int]:
    """Covariance of the parameters as blows scatter, and its degrees of freedom; None without several blows everywhere."""
    counts = [len(one.deviations) for one in fit.lines.responses]
    if min(counts, default=0) < 2 or not fit.parameters.size:
        return None, 0
    inverse = np.linalg.pinv(fit.slopes, rcond=1e-10)
    total = np.zeros((fit.parameters.size,) * 2)
    row = 0
    for place, (one, mask) in enumerate(zip(fit.lines.responses, fit.lines.masks, strict=True)):
        rows = 2 * int(mask.sum())
        moved = np.array([inverse[:, row : row + rows] @ fit.lines.projected(place, each[mask]) for each in one.deviations])
        total += len(moved) / (len(moved) - 1.0) * moved.T @ moved
        row += rows
    return total, min(counts) - 1


def estimates(fit: Fit, place: int) -> dict[str, Estimate]:
    """natural_frequency (Hz), damping_ratio, mass (kg) and direction (rad) of the mode in a row of the fit's parameters."""
    width = fit.parameters.shape[1]
    mine = slice(place * width, (place + 1) * width)
    square = widths(fit)[mine, mine]
    row, basis = fit.parameters[place], fit.lines.basis
    omega, zeta, shape = math.exp(row[0]), math.exp(row[1]), row[2:]
    size = float(shape @ shape)
    lean = np.zeros(width)
    lean[2:] = -2.0 * shape / max(size, 1e-300)  # of the logarithm of the mass
    wide = [math.sqrt(max(0.0, one)) for one in (square[0, 0], square[1, 1], lean @ square @ lean)]
    made = {"natural_frequency": (omega / (2.0 * math.pi), wide[0], "Hz"), "damping_ratio": (zeta, wide[1], "1"),
            "mass": (1.0 / max(size, 1e-300), wide[2], "kg")}
    found = {name: Estimate(value, value * math.exp(-min(part, 50.0)), value * math.exp(min(part, 50.0)), unit)
             for name, (value, part, unit) in made.items()}
    vector = shape @ basis
    angle = math.atan2(vector[1], vector[0])
    angle = angle + math.pi if angle <= -0.5 * math.pi + 1e-12 else angle - math.pi if angle > 0.5 * math.pi + 1e-12 else angle
    spread = 0.0
    if width > 3:
        turn = np.zeros(width)
        turn[2:] = np.array([-shape[1], shape[0]]) / max(size, 1e-300)
        spread = math.sqrt(max(0.0, turn @ square @ turn))
    found["direction"] = Estimate(angle, angle - spread, angle + spread, "rad", math.pi)
    return found
