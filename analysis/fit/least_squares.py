"""Levenberg-Marquardt for parameters that all records share, with each record's own unknowns eliminated (Schur complement).

A problem says what its records leave at a state and how that changes; it holds no step. Marquardt (1963), J. SIAM 11, 431.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from testbed.analysis.fit.fit_state import Descent, Evaluation, Jacobian, State, names_of

FAINTEST = 1e-3  # slope by an unknown, in units of the noise over a natural step, below which it is as good as none
ROUNDED = 1e-12  # share of an unknown's squared slopes below which what the records' own unknowns leave is rounding
COLLINEAR = 1e-10  # eigenvalue of the unknowns' correlations below which a combination of them is as good as unknown
UNTOLD, PART = 1e30, 1e-3  # variance of such a combination, in units of what its unknowns tell alone; a share in it that counts
PACE = 4  # iterations over which the pace of a descent is measured,
SPARE = 3.0  # and times that pace: what even so would not reach its goal in the iterations left is given up


class Problem(Protocol):
    """What is solved: residuals of records, and their slopes by shared and own unknowns, at any state."""

    @property
    def records(self) -> Sequence[Any]:
        """The records, in the order of every sequence below."""
        ...

    def look(self, state: State) -> tuple[Evaluation, ...]:
        """Every record's prediction and residual."""
        ...

    def linearise_all(self, state: State, looked: Sequence[Evaluation] | None = None) -> tuple[Jacobian, ...]:
        """Every record's residual and slopes; looked: what is known of them there."""
        ...

    def residuals(self, state: State) -> tuple[np.ndarray, ...]:
        """Every record's residual, in units of its scale."""
        ...

    def cost_of(self, residuals: Iterable[np.ndarray], state: State, places: Iterable[int]) -> float:
        """Half the sum of squares of residuals, and of what holds the records' own unknowns."""
        ...

    def own_steps(self, record: Any, nuisances: Any) -> Sequence[Mapping[str, float]]:
        """Natural steps of a record's own unknowns."""
        ...

    def moved(self, state: State, step: np.ndarray) -> State:
        """The state after a step of the shared unknowns."""
        ...

    def with_own(self, state: State, moves: Sequence[np.ndarray]) -> State:
        """The state after a step of the records' own unknowns."""
        ...


def too_slow(costs: Sequence[float], iterations: int, cost_limit: float) -> bool:
    """Whether a descent of so many iterations would not come down to its goal at the best pace of its last ones."""
    done = len(costs) - 1
    if done < PACE:
        return False
    pace = max(before - after for before, after in itertools.pairwise(costs[-PACE - 1 :]))
    return costs[-1] - SPARE * pace * (iterations - done) > cost_limit


def gauss_newton_step(parts: Sequence[Jacobian], damping: float, used: Sequence[int] | None = None
                      ) -> tuple[np.ndarray, list[np.ndarray]]:  # fmt: skip
    """Damped Gauss-Newton step: (shared unknowns, every record's own unknowns); `used` names the records that count."""
    shared = parts[0].shared.shape[1]
    normal, gradient = np.zeros((shared, shared)), np.zeros(shared)
    solved = []
    for index, part in enumerate(parts):
        own, cross, pulled, by_shared, steepest = part.products
        own = own + np.diag(damping * np.diag(own) + 1e-12 * max(1.0, float(np.trace(own))))
        inverse = np.linalg.pinv(own) if len(own) else own
        solved.append((inverse, cross, pulled))
        if used is None or index in used:
            normal += by_shared - cross.T @ inverse @ cross
            gradient += steepest - cross.T @ inverse @ pulled
    full = normal + np.diag(damping * np.diag(normal) + 1e-14 * max(1e-300, float(np.trace(normal))))
    move = -np.linalg.lstsq(full, gradient, rcond=1e-14)[0]
    return move, [-inverse @ (pulled + cross @ move) for inverse, cross, pulled in solved]


def covariance(parts: Sequence[Jacobian], steps: np.ndarray, variance: float = 1.0) -> np.ndarray:
    """Covariance of the shared unknowns in their own units, for residuals of the given variance. steps: their natural ones.

    What the records do not tell, alone or only together (the offset and angle of a runout of two teeth), has a large one.
    """
    normal, whole = np.zeros((len(steps), len(steps))), np.zeros(len(steps))
    for part in parts:
        whole += np.diag(part.products.shared)
        normal += part.information[0]
    size = np.sqrt(np.maximum(np.diag(normal), np.maximum(FAINTEST**2, ROUNDED * whole)))
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    inverse = (vectors / np.maximum(values, COLLINEAR)) @ vectors.T
    for vector in vectors.T[values < COLLINEAR]:  # of what has no part in it, rounding must not be made large
        taking_part = np.where(np.abs(vector) > PART, vector, 0.0)
        inverse += UNTOLD * np.outer(taking_part, taking_part)
    return variance * inverse * np.outer(steps / size, steps / size)


def levenberg_marquardt(problem: Problem, state: State, iterations: int, tolerance: float, near: Descent | None,
                        cost_limit: float) -> Descent:  # fmt: skip
    """The descent from a state until a step lowers the cost by less than `tolerance` of itself; see `Fitter.descend`."""
    parts, anew = first_slopes(problem, state, near)
    cost = 0.5 * sum(float(part.residual @ part.residual) for part in parts)
    damping, converged, count, costs = 1e-3, False, 0, [cost]
    looked: tuple[Evaluation, ...] | None = None
    while count < iterations and not converged and not too_slow(costs, iterations, cost_limit):
        if not anew and count:
            parts, anew = problem.linearise_all(state, looked), True
        count += 1
        move, own = gauss_newton_step(parts, damping)
        trial = problem.with_own(problem.moved(state, move), own)
        seen = problem.look(trial)
        new = problem.cost_of((one.residual for one in seen), trial, range(len(seen)))
        if np.isfinite(new) and new < cost:
            converged = anew and cost - new < tolerance * cost
            state, looked, cost, anew, damping = trial, seen, new, False, max(damping / 8.0, 1e-9)
        elif anew:
            converged = damping > 1e4 or (np.isfinite(new) and abs(new - cost) < 1e-9 * cost)
            damping *= 6.0
        costs.append(cost)
    return Descent(state=state, cost=cost, parts=parts, anew=anew, converged=converged, iterations=count, looked=looked)


def first_slopes(problem: Problem, state: State, near: Descent | None) -> tuple[tuple[Jacobian, ...], bool]:
    """Residuals and slopes to descend from a state with, and whether the slopes are its own and not lent from near by."""
    if near is None:
        return problem.linearise_all(state), True
    if near.anew and near.state is state:
        return near.parts, True
    own = [names_of(problem.own_steps(*each)) for each in zip(problem.records, state.nuisances, strict=True)]
    if own != [part.known for part in near.parts]:
        return problem.linearise_all(state), True
    held = [record.off_marks(own) for record, own in zip(problem.records, state.nuisances, strict=True)]
    rests = [np.append(rest, own) for rest, own in zip(problem.residuals(state), held, strict=True)]
    return tuple(replace(part, residual=rest) for part, rest in zip(near.parts, rests, strict=True)), False
