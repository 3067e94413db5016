"""A Kalman smoother of an oscillator under an unknown force: motion and force, with their variances, off noisy samples.

The force has a Gaussian process as prior, with exponential or Matern 3/2 covariance; variance and time scale are those
of maximum likelihood. Source: J. Hartikainen and S. Sarkka (2010), MLSP (the state-space form); H. Rauch, F. Tung and
C. Striebel (1965), AIAA J. 3, 1445 (the smoother).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_discrete_lyapunov
from scipy.optimize import minimize

from testbed.machine import Model

SETTLING = 80  # samples that the filter is given before its innovations count
LONGEST = 4000  # samples for which the gain is computed anew at most; it is constant once settled
LOOSE = 10.0  # variance at the start over that of motion under the force for ever
SHORTEST = 3.0  # samples, shortest time scale of a force
TUNED = 20000  # samples of the worst fitted record that the prior is tuned on


@dataclass(frozen=True)
class Prior:
    """Prior of the latent force: order 1 (exponential) or 2 (Matern 3/2), size (N) and time scale (s)."""

    order: int
    size: float
    time_scale: float


def _transition(model: Model, order: int, scale: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """(transition, noise) over dt in units where mass, stiffness and the force's variance are 1; time in 1 / omega."""
    zeta = model.structure.damping_ratio
    size = 2 + order
    drift, diffusion = np.zeros((size, size)), np.zeros((size, size))
    drift[0, 1], drift[1, :3] = 1.0, (-1.0, -2.0 * zeta, 1.0)
    drift[2:, 2:], diffusion[2:, 2:] = latent(order, scale)
    return over_a_sample(drift, diffusion, dt)


def latent(order: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """(drift, diffusion) of a force of unit variance, both (order, order)."""
    if order == 1:
        return np.array([[-1.0 / scale]]), np.array([[2.0 / scale]])
    rate = math.sqrt(3.0) / scale
    return np.array([[0.0, 1.0], [-(rate**2), -2.0 * rate]]), np.diag([0.0, 4.0 * rate**3])


def over_a_sample(drift: np.ndarray, diffusion: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """(transition, noise) over dt of x' = drift x + white noise of that diffusion."""
    size = len(drift)
    block = np.block([[-drift, diffusion], [np.zeros((size, size)), drift.T]])  # C. Van Loan (1978)
    whole = expm(block * dt)
    transition = whole[size:, size:].T
    noise = transition @ whole[:size, size:]
    return transition, 0.5 * (noise + noise.T)


def _sensing(model: Model, channels: Sequence[str], order: int) -> np.ndarray:
    """Rows that read the channels off the state [x, x', f ...], with x in m and time in 1 / omega."""
    omega, zeta = model.structure.natural_frequency_rad, model.structure.damping_ratio
    rows = np.zeros((len(channels), 2 + order))
    for row, name in zip(rows, channels, strict=True):
        kind = name.split("_")[0]
        if kind == "displacement":
            row[0] = 1.0
        elif kind == "velocity":
            row[1] = omega
        else:
            row[:3] = omega**2 * np.array([-1.0, -2.0 * zeta, 1.0])
    return rows


def settled_spread(transition: np.ndarray, rows: np.ndarray, disturbance: np.ndarray) -> np.ndarray:
    """Covariance of the prediction that the filter settles to, for unit noise on the rows, by structured doubling.

    Source: E. Chu, H. Fan, W. Lin and C. Wang (2004), Int. J. Control 77, 767. It keeps its digits where rows and
    disturbance differ by many powers of ten, as acceleration makes them. ValueError where it does not settle.
    """
    a, g, h, unit = transition.T, rows.T @ rows, disturbance, np.eye(len(transition))
    for _ in range(60):
        left = np.linalg.solve(unit + g @ h, np.hstack([a, g]))
        pulled, spread = left[:, : len(a)], left[:, len(a) :]
        more = a.T @ h @ pulled
        g = g + a @ spread @ a.T
        h, a = h + 0.5 * (more + more.T), a @ pulled
        if not np.isfinite(h).all():
            break
        if np.abs(more).max() <= 1e-12 * np.abs(h).max():
            return h
    raise ValueError("the filter does not settle")


def tuned_prior(model: Model, residual: np.ndarray, channel: str, noise: float, rate: float) -> Prior:
    """The prior under which one channel's residual (samples,) is likeliest."""
    omega = model.structure.natural_frequency_rad
    values = residual[:TUNED] / noise
    unit = noise / abs(_sensing(model, [channel], 1)[0]).max()  # displacement that the noise stands for, m
    shortest = math.log(SHORTEST * omega / rate)  # below that the prior is white, and no smoother

    def limited(parameters: np.ndarray) -> np.ndarray:
        return np.exp(np.clip(parameters, (-12.0, shortest), (16.0, 4.0)))

    from scipy.signal import lfilter  # slow to import, wanted by few

    def cost(parameters: np.ndarray, order: int) -> float:
        size, scale = limited(parameters)
        transition, disturbance = _transition(model, order, scale, omega / rate)
        row = _sensing(model, [channel], order) * unit / noise
        try:
            spread = settled_spread(transition, row, size**2 * disturbance)
        except (np.linalg.LinAlgError, ValueError):
            return 1e12
        variance = float((row @ spread @ row.T)[0, 0]) + 1.0
        if not 1.0 - 1e-6 <= variance < math.inf:  # the solver lost its digits
            return 1e12
        gain = transition @ spread @ row.T / variance
        below, above = np.poly(transition - gain @ row), np.poly(transition)
        innovation = lfilter(above.real, below.real, values)[SETTLING:]
        return 0.5 * float(np.mean(innovation**2)) / variance + 0.5 * math.log(variance)

    found = []
    for order in (1, 2):
        for start in ((2.0, 0.0), (4.0, -1.0)):
            best = minimize(cost, start, (order,), method="Nelder-Mead", options={"maxfev": 90, "xatol": 0.05, "fatol": 1e-5})
            found.append((float(best.fun), order, limited(best.x)))
    _, order, (size, scale) = min(found, key=lambda entry: entry[0])
    return Prior(order, float(size) * unit * model.structure.stiffness, float(scale) / omega)


def march(matrix: np.ndarray, pushes: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Rows m_k = matrix m_(k-1) + pushes_k (count, size) from m_(-1) = start, by eigenvectors where they are well apart."""
    from scipy.signal import lfilter  # slow to import, wanted by few

    values, vectors = np.linalg.eig(matrix)
    if np.linalg.cond(vectors) < 1e7:
        modes, first = np.linalg.solve(vectors, pushes.T), np.linalg.solve(vectors, start.astype(complex))
        rows = [lfilter([1.0], [1.0, -value], mode, zi=[value * one])[0] if len(mode) else mode
                for value, mode, one in zip(values, modes.astype(complex), first, strict=True)]  # fmt: skip
        return (vectors @ np.stack(rows)).real.T
    found, now = np.empty_like(pushes), start
    for place, push in enumerate(pushes):
        now = matrix @ now + push
        found[place] = now
    return found


def smooth(
    model: Model, prior: Prior, residual: np.ndarray, channels: Sequence[str], noise: np.ndarray, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """(states, variances), both (samples, 3): displacement (m), velocity (m/s) and force (N) behind a residual motion.

    residual (channels, samples) of displacement, velocity or acceleration, noise (channels,) its standard deviations.
    Velocity or acceleration alone does not see a standing force: its mean is then a guess.
    """
    omega, stiffness = model.structure.natural_frequency_rad, model.structure.stiffness
    unit = prior.size / stiffness  # m; keeps every state near 1
    transition, disturbance = _transition(model, prior.order, prior.time_scale * omega, omega / rate)
    rows = _sensing(model, channels, prior.order) * unit / noise[:, None]
    means, variances = smoothed(transition, disturbance, rows, (residual / noise[:, None]).T)
    scale = np.array([unit, unit * omega, prior.size])
    return means[:, :3] * scale, variances[:, :3] * scale**2


def smoothed(transition: np.ndarray, disturbance: np.ndarray, rows: np.ndarray, values: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """(means, variances), both (samples, states), of states that rows (channels, states) read off, under unit noise, as values
    (samples, channels)."""
    size, count = len(transition), len(values)
    mean, spread = np.zeros(size), LOOSE * solve_discrete_lyapunov(transition, disturbance)
    steady = settled_spread(transition, rows, disturbance)
    means = np.empty((count, size))
    filtered: list[np.ndarray] = []
    ahead: list[np.ndarray] = []  # covariances of the predictions that led to each sample
    for place in range(min(LONGEST, count)):
        if place:
            mean, spread = transition @ mean, transition @ spread @ transition.T + disturbance
            if np.allclose(np.diag(spread), np.diag(steady), rtol=1e-4, atol=0.0):
                mean = means[place - 1]
                break
        ahead.append(spread)
        gain = np.linalg.solve(rows @ spread @ rows.T + np.eye(len(rows)), rows @ spread).T
        mean = mean + gain @ (values[place] - rows @ mean)
        left = np.eye(size) - gain @ rows
        spread = left @ spread @ left.T + gain @ gain.T
        filtered.append(spread)
        means[place] = mean
    settled = len(filtered)
    gain = np.linalg.solve(rows @ steady @ rows.T + np.eye(len(rows)), rows @ steady).T
    means[settled:] = march(transition - gain @ (rows @ transition), values[settled:] @ gain.T, mean)
    final = (np.eye(size) - gain @ rows) @ steady
    back = np.linalg.solve(steady, transition @ final).T
    variances = np.empty((count, size))
    spread = filtered[-1] if settled == count else final
    variances[-1] = np.diag(spread)
    part = means - means @ (back @ transition).T
    means[settled:-1] = march(back, part[settled:-1][::-1], means[-1])[::-1]
    for place in range(count - 2, settled - 1, -1):
        following = final + back @ (spread - steady) @ back.T
        variances[place] = np.diag(following)
        if np.allclose(variances[place], np.diag(spread), rtol=1e-6, atol=0.0):
            variances[settled:place] = variances[place]
            break
        spread = following
    for place in range(min(settled, count - 1) - 1, -1, -1):
        expected = ahead[place + 1] if place + 1 < settled else transition @ filtered[place] @ transition.T + disturbance
        back = np.linalg.solve(expected, transition @ filtered[place]).T
        means[place] = means[place] + back @ (means[place + 1] - transition @ means[place])
        spread = filtered[place] + back @ (spread - expected) @ back.T
        variances[place] = np.diag(spread)
    return means, np.maximum(variances, 0.0)
