"""The machine and the cuts the effects are checked on."""

import math

import numpy as np

from testbed.cut import Cut, Sampling
from testbed.machine import Cutter, Cutting, Model, Structure

RPM = 2.0 * math.pi / 60.0
MASS, FREQUENCY, ZETA = 2.573, 146.4, 0.0032
STIFFNESS = MASS * (2.0 * math.pi * FREQUENCY) ** 2
FEED = 0.1016e-3


def flexure(damping_ratio: float = ZETA, mass: float = MASS, **effects: dict) -> Model:
    return Model(Structure(mass, FREQUENCY, damping_ratio), Cutter(), Cutting(), effects)


def stable_cut(passes: int = 60, **course) -> Cut:
    return Cut(3810 * RPM, 2.9e-3, FEED, passes=passes, **course)


def free(initial_displacement: float, passes: int = 20) -> Cut:
    """Nothing cuts: released from rest."""
    return Cut(3000 * RPM, 0.0, passes=0, ring_down_passes=passes, initial_displacement=initial_displacement)


def samples(cut: Cut, rate: float) -> Sampling:
    return Sampling(rate, int(cut.total_passes * cut.tooth_passing_period(1) * rate) - 1)


def turning_points(time: np.ndarray, displacement: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and displacements where the velocity changes sign, from the straight line between two fine samples."""
    k = np.flatnonzero(velocity[:-1] * velocity[1:] < 0)
    u = velocity[k] / (velocity[k] - velocity[k + 1])
    dt = time[k + 1] - time[k]
    return time[k] + u * dt, displacement[k] + 0.5 * velocity[k] * u * dt
