"""The delayed, damped Mathieu equation: simulated motion and empirical multipliers from one perturbation.

    x'' + kappa x' + [delta + eps cos(2 pi t / tau)] x = b x(t - tau)

The example of Mann and Young (2006, Proc. R. Soc. A 462, 2145, section 2.1; the equation of Insperger and Stepan 2002).
The motion is integrated by the method of steps: classical Runge-Kutta of fourth order on a grid that divides the delay,
the delayed displacement between grid points by the cubic through displacement and velocity of both neighbours, which
keeps the fourth order. The fixed point is x = 0, so that the states need no reference. Time and all else are without
unit, as in the paper.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from testbed.analysis.linear.delay_equation import DelayEquation, mathieu_equation
from testbed.recording import Recording
from testbed.system.kernel_cache import kept

STEPS = 1200  # of Runge-Kutta in a delay; leaves a relative error of about 4e-10


@dataclass(frozen=True)
class Mathieu:
    """kappa: damping; delta: mean stiffness; eps: its fluctuation; b: gain of the delayed displacement; tau: delay."""

    delta: float
    kappa: float = 0.2
    eps: float = 1.0
    b: float = -0.2
    tau: float = 2.0 * math.pi

    def equation(self) -> DelayEquation:
        """The equation as temporal elements and collocation take it."""
        return mathieu_equation(self.kappa, self.delta, self.eps, self.b, self.tau)


@dataclass(frozen=True)
class MathieuMotion:
    """Displacement and velocity on the grid, each (periods * steps + 1,), from time 0; steps to a delay."""

    displacement: np.ndarray
    velocity: np.ndarray
    steps: int
    tau: float

    @property
    def time(self) -> np.ndarray:
        """Times of the grid points."""
        return np.arange(self.displacement.size) * (self.tau / self.steps)

    @property
    def periods(self) -> int:
        """Whole delays simulated."""
        return (self.displacement.size - 1) // self.steps

    def states(self, delays: int, phase: float = 0.0) -> np.ndarray:
        """y_n(k) = x((n + phase + k / delays) tau), shape (periods, delays).

        With phase above 0 the last, unfinished period is left out. ValueError where the instants miss the grid.
        """
        offset, spacing = phase * self.steps, self.steps / delays
        if abs(offset - round(offset)) > 1e-9 or abs(spacing - round(spacing)) > 1e-9:
            raise ValueError(f"{delays} delays from phase {phase:g} do not fall on {self.steps} steps")
        whole = (self.displacement.size - 1 - round(offset)) // self.steps
        first = round(offset) + np.arange(whole)[:, None] * self.steps
        return self.displacement[first + np.arange(delays) * round(spacing)]


@kept
def _method_of_steps(x, v, past_x, past_v, step, kappa, stiffness, b):
    """Fill x, v after their first entries. stiffness: (2 steps + 1,) at half steps of one period; past: (steps + 1,)."""
    steps = past_x.size - 1
    for n in range(x.size - 1):
        i = n % steps
        if n < steps:
            d0, d2 = past_x[i], past_x[i + 1]
            w0, w2 = past_v[i], past_v[i + 1]
        else:
            d0, d2 = x[n - steps], x[n - steps + 1]
            w0, w2 = v[n - steps], v[n - steps + 1]
        d1 = 0.5 * (d0 + d2) + 0.125 * step * (w0 - w2)
        s0, s1, s2 = stiffness[2 * i], stiffness[2 * i + 1], stiffness[2 * i + 2]
        a1 = b * d0 - s0 * x[n] - kappa * v[n]
        v2 = v[n] + 0.5 * step * a1
        a2 = b * d1 - s1 * (x[n] + 0.5 * step * v[n]) - kappa * v2
        v3 = v[n] + 0.5 * step * a2
        a3 = b * d1 - s1 * (x[n] + 0.5 * step * v2) - kappa * v3
        v4 = v[n] + step * a3
        a4 = b * d2 - s2 * (x[n] + step * v3) - kappa * v4
        x[n + 1] = x[n] + step * (v[n] + 2.0 * v2 + 2.0 * v3 + v4) / 6.0
        v[n + 1] = v[n] + step * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0


def simulate_mathieu(oscillator: Mathieu, periods: int, *, steps: int = STEPS, displacement: float = 1.0,
                     velocity: float = 0.0, past: tuple[np.ndarray, np.ndarray] | None = None) -> MathieuMotion:
    """The motion over `periods` delays after one perturbation.

    past: displacement and velocity over the delay before time 0, each (steps + 1,); at rest where None, so that the
    perturbation is the state (displacement, velocity) at time 0.
    """
    if periods < 1 or steps < 4:
        raise ValueError("at least one period and four steps are needed")
    half = np.arange(2 * steps + 1) * (0.5 * oscillator.tau / steps)
    stiffness = oscillator.delta + oscillator.eps * np.cos(2.0 * math.pi * half / oscillator.tau)
    before = (np.zeros(steps + 1), np.zeros(steps + 1)) if past is None else past
    x, v = np.empty(periods * steps + 1), np.empty(periods * steps + 1)
    x[0], v[0] = displacement, velocity
    _method_of_steps(x, v, np.ascontiguousarray(before[0], float), np.ascontiguousarray(before[1], float),
                     oscillator.tau / steps, oscillator.kappa, stiffness, oscillator.b)
    return MathieuMotion(x, v, steps, oscillator.tau)


def state_multipliers(states: np.ndarray, rank: int | None = None, fixed_point: np.ndarray | float = 0.0) -> np.ndarray:
    """Empirical multipliers: eigenvalues of the least-squares J of y_{n+1} - y* = J (y_n - y*), largest first.

    states: (periods, delays). Each pair of neighbours is divided by the size of the first of the two, so that early and
    late periods of a growing or dying motion weigh alike. rank: singular directions kept; all that stand clear of the
    arithmetic's rounding where None. ValueError for fewer than three states or for a motion that is zero.
    """
    motion = np.asarray(states, float) - fixed_point
    if motion.shape[0] < 3:
        raise ValueError("at least three states are needed")
    size = np.linalg.norm(motion[:-1], axis=1)
    if not (np.all(np.isfinite(motion)) and np.all(size > 0)):
        raise ValueError("the states hold no motion, or values that are not finite")
    before, after = (motion[:-1] / size[:, None]).T, (motion[1:] / size[:, None]).T
    left, singular, right = np.linalg.svd(before, full_matrices=False)
    kept = int(np.count_nonzero(singular > 1e-10 * singular[0]))
    kept = kept if rank is None else min(rank, kept)
    jacobian = left[:, :kept].T @ after @ right[:kept].T / singular[:kept]
    values = np.linalg.eigvals(jacobian)
    return values[np.lexsort((-values.imag, -np.round(np.abs(values), 12)))]


def mathieu_recording(motion: MathieuMotion) -> Recording:
    """The motion as a recording with a mark at the start of each delay, as the milling tools take it."""
    marks = np.arange(motion.periods + 1) * motion.tau
    return Recording({"displacement": motion.displacement, "velocity": motion.velocity}, motion.steps / motion.tau,
                     {"displacement": "m", "velocity": "m/s"}, "synthetic", marks=marks)
