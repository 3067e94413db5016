"""Least squares of a transient by multiplier modes, y_n = y* + s n + sum_k mu_k^n phi_k, by variable projection.

The vectors y*, phi_k are linear and are projected out (Golub and Pereyra 1973, SIAM J. Numer. Anal. 10, 413), so only
the multipliers and the sensor's drift s are searched. With white noise this is the maximum likelihood estimate: unlike
the least-squares Jacobian of y_{n+1} = J y_n it has no errors-in-variables bias. A pair of multipliers is carried by
its sum and product, which stay smooth where a complex pair becomes two real multipliers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from testbed.system.kernel_cache import kept

_KEPT_COLUMNS = 16  # singular directions of the samples that can hold modes; the rest is noise alone


@dataclass(frozen=True)
class MultiplierFit:
    """A fit of `rank` modes.

    multipliers (rank,) complex, largest first; parameters (sums and products of pairs, an odd multiplier, drift per
    period); covariance (2 rank, 2 rank) of [real parts, imaginary parts] in multiplier order; noise: rms of the
    residual corrected for the parameters spent (the sample's unit); misfit: sum of squares; rows (n,): rms of the
    residual of each period; drift: per period.
    """

    multipliers: np.ndarray
    parameters: np.ndarray
    covariance: np.ndarray
    noise: float
    misfit: float
    rows: np.ndarray
    drift: float

    @property
    def rank(self) -> int:
        """Number of modes."""
        return self.multipliers.size

    @property
    def standard_errors(self) -> np.ndarray:
        """Root of the summed variances of real and imaginary part, (rank,)."""
        variance = np.diag(self.covariance)
        return np.sqrt(variance[:self.rank] + variance[self.rank:])


@kept
def mode_basis(parameters, rank, periods):
    """Orthonormal columns (periods, rank + 1) spanning 1 and the modes' sequences; a dependent column is left zero."""
    columns = np.empty((rank + 1, periods))
    columns[0] = 1.0
    for pair in range(rank // 2):
        total, product = parameters[2 * pair], parameters[2 * pair + 1]
        for which in range(2):
            row = columns[1 + 2 * pair + which]
            row[0], row[1] = 1.0 - which, float(which)
            for n in range(2, periods):
                row[n] = total * row[n - 1] - product * row[n - 2]
    if rank % 2:
        columns[rank, 0] = 1.0
        for n in range(1, periods):
            columns[rank, n] = columns[rank, n - 1] * parameters[rank - 1]
    for i in range(rank + 1):
        row = columns[i]
        before = math.sqrt(np.sum(row * row))
        row /= before
        for _ in range(2):  # twice is enough (Kahan and Parlett)
            for j in range(i):
                row -= np.sum(row * columns[j]) * columns[j]
        after = math.sqrt(np.sum(row * row))
        if after > 1e-13:
            row /= after
        else:
            row[:] = 0.0
    return columns.T


@kept
def _projected(parameters, rank, drift, data, ramp):
    """What the modes cannot explain of data (periods, columns), flat."""
    left = data.copy()
    if drift:
        left -= parameters[rank] * ramp
    bounded = np.minimum(np.maximum(parameters, -5.0), 5.0)
    basis = np.ascontiguousarray(mode_basis(bounded, rank, data.shape[0]))
    return (left - basis @ (basis.T @ left)).ravel()


@kept
def _slopes(parameters, left, rank, drift, data, ramp):
    """Forward differences of `_projected`, (values, parameters)."""
    result = np.empty((left.size, parameters.size))
    for i in range(parameters.size):
        step = 1.5e-8 * max(1.0, abs(parameters[i]))
        moved = parameters.copy()
        moved[i] += step
        result[:, i] = (_projected(moved, rank, drift, data, ramp) - left) / step
    return result


@kept
def _search(parameters, rank, drift, data, ramp, most):
    """Levenberg-Marquardt: parameters of least misfit from these, and the slopes there."""
    left = _projected(parameters, rank, drift, data, ramp)
    cost = np.sum(left * left)
    slopes = _slopes(parameters, left, rank, drift, data, ramp)
    damping = 1e-3
    for _ in range(most):
        normal = slopes.T @ slopes
        gradient = slopes.T @ left
        accepted, shrink = False, 0.0
        while damping < 1e12:
            damped = normal.copy()
            for i in range(parameters.size):
                damped[i, i] += damping * normal[i, i] + 1e-300
            step = np.linalg.solve(damped, -gradient)
            trial = parameters + step
            left_there = _projected(trial, rank, drift, data, ramp)
            cost_there = np.sum(left_there * left_there)
            if cost_there < cost:
                accepted, shrink = True, (cost - cost_there) / cost
                parameters, left, cost = trial, left_there, cost_there
                damping = max(0.1 * damping, 1e-9)
                break
            damping *= 10.0
        if not accepted:
            break
        slopes = _slopes(parameters, left, rank, drift, data, ramp)
        if shrink < 1e-10:
            break
    return parameters, slopes


def _roots(parameters: np.ndarray, rank: int) -> np.ndarray:
    values = []
    for pair in range(rank // 2):
        half, product = 0.5 * parameters[2 * pair], parameters[2 * pair + 1]
        root = np.sqrt(complex(half * half - product))
        values += [half + root, half - root]
    if rank % 2:
        values.append(complex(parameters[rank - 1]))
    return np.array(values, dtype=complex)


def _root_slopes(parameters: np.ndarray, rank: int) -> np.ndarray:
    """d multipliers / d parameters, complex (rank, rank)."""
    slopes = np.zeros((rank, rank), dtype=complex)
    values = _roots(parameters, rank)
    for pair in range(rank // 2):
        for i in (2 * pair, 2 * pair + 1):
            other = values[4 * pair + 1 - i]
            gap = values[i] - other if abs(values[i] - other) > 1e-9 else 1e-9
            slopes[i, 2 * pair], slopes[i, 2 * pair + 1] = values[i] / gap, -1.0 / gap
    if rank % 2:
        slopes[rank - 1, rank - 1] = 1.0
    return slopes


def _parameters_of(multipliers: np.ndarray) -> np.ndarray:
    """Sums and products of neighbours after conjugates are brought together; a real one is left over if odd."""
    values = np.asarray(multipliers, dtype=complex)
    upper = values[values.imag > 1e-12]
    reals = np.sort(values[np.abs(values.imag) <= 1e-12].real)[::-1]
    pairs = [(2.0 * mu.real, abs(mu) ** 2) for mu in upper]
    while reals.size >= 2:
        pairs.append((reals[0] + reals[1], reals[0] * reals[1]))
        reals = reals[2:]
    return np.array([number for pair in pairs for number in pair] + list(reals))


def fit_multipliers(samples: np.ndarray, start: np.ndarray, drift: bool = False) -> MultiplierFit:
    """Fit modes to samples (periods, delays) from the multipliers `start` (closed under conjugation).

    ValueError when there are not at least two periods more than modes.
    """
    samples = np.asarray(samples, float)
    periods, delays = samples.shape
    rank = len(start)
    if periods < rank + 3:
        raise ValueError(f"{rank} multipliers need at least {rank + 3} periods, not {periods}")
    _, singular, right = np.linalg.svd(samples - samples.mean(axis=0), full_matrices=False)
    kept = right[:min(_KEPT_COLUMNS, periods, delays)]
    if drift:  # the drift moves all phases alike: that direction must be among those kept
        rest = np.ones(delays) - kept.T @ (kept @ np.ones(delays))
        if np.linalg.norm(rest) > 1e-9 * math.sqrt(delays):
            kept = np.vstack([kept, rest / np.linalg.norm(rest)])
    scale = max(float(np.sqrt(np.mean(samples**2))), 1e-300)
    data = np.ascontiguousarray(samples @ kept.T / scale)
    ramp = np.outer(np.arange(periods), kept.sum(axis=1))

    first = np.append(_parameters_of(start), [0.0] * drift)
    if first.size:
        parameters, slopes = _search(first, rank, drift, data, ramp, 60)
    else:
        parameters, slopes = first, np.empty((data.size, 0))
    return _finished(samples, parameters, slopes, rank, scale if drift else 0.0, scale)


def _finished(samples, parameters, slopes, rank, drift_scale, scale) -> MultiplierFit:
    periods, delays = samples.shape
    drift = parameters[rank] * drift_scale if drift_scale else 0.0
    basis = mode_basis(np.clip(parameters, -5.0, 5.0), rank, periods)
    rows = samples - drift * np.arange(periods)[:, None]
    left = rows - basis @ (basis.T @ rows)
    misfit = float(np.sum(left**2))
    freedom = max(1, periods * delays - (rank + 1) * delays - parameters.size)
    noise = math.sqrt(misfit / freedom)
    values = _roots(parameters, rank)
    spread = np.linalg.pinv(slopes.T @ slopes) * (noise / scale) ** 2
    gradient = _root_slopes(parameters, rank) @ np.eye(rank, parameters.size)
    gradient = np.vstack([gradient.real, gradient.imag])
    covariance = gradient @ spread @ gradient.T
    order = np.lexsort((-values.imag, -np.round(np.abs(values), 12)))
    both = np.concatenate([order, order + rank])
    share = np.sqrt(np.clip(1.0 - np.sum(basis**2, axis=1), 1e-3, None))  # of the noise that the fit leaves in a row
    return MultiplierFit(values[order], parameters, covariance[np.ix_(both, both)], noise, misfit,
                         np.sqrt(np.mean(left**2, axis=1)) / share, float(drift))


def delay_embedding_multipliers(samples: np.ndarray, rank: int, blocks: int = 1) -> np.ndarray:
    """Eigenvalues of the least-squares Jacobian of the embedded samples (periods, delays), truncated to `rank`.

    The constant fixed point is removed by differencing neighbouring periods. `blocks` periods are stacked into one
    embedded vector. The plain estimate of the paper (full rank where `rank` is the number of delays).
    """
    steps = np.diff(np.asarray(samples, float), axis=0)
    count = steps.shape[0] - blocks + 1
    embedded = np.hstack([steps[i:i + count] for i in range(blocks)])
    _, _, right = np.linalg.svd(embedded, full_matrices=False)
    reduced = embedded @ right[:rank].T
    jacobian, *_ = np.linalg.lstsq(reduced[:-1], reduced[1:], rcond=None)
    values = np.linalg.eigvals(jacobian.T)
    return values[np.lexsort((-values.imag, -np.round(np.abs(values), 12)))]


def best_fit(samples: np.ndarray, rank: int, drift: bool = False) -> MultiplierFit:
    """The best of several starts: truncated Jacobians of the samples with one, two and three periods stacked."""
    best: MultiplierFit | None = None
    for blocks in (1, 2, 3):
        if rank == 0 and blocks > 1 or samples.shape[0] - blocks < rank + 2:
            break
        start = delay_embedding_multipliers(samples, rank, blocks) if rank else np.empty(0)
        modulus = np.maximum(np.abs(start), 1e-12)
        fit = fit_multipliers(samples, start * np.minimum(1.0, 1.5 / modulus), drift)
        if best is None or fit.misfit < best.misfit * (1 - 1e-9):
            best = fit
    if best is None:
        raise ValueError(f"{rank} multipliers need more than {samples.shape[0]} periods")
    return best
