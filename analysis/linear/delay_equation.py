"""Linear delay equations of machining: milling and the damped, delayed Mathieu equation.

All have the form, with the principal period T equal to the delay tau,

    x'' + [damping + c(t)] x' + [stiffness + k(t)] x = d(t) x(t - tau) - f(t)

where c, k, d and f are tau-periodic and vanish outside `breaks[0] <= t mod tau < breaks[-1]` (the cut). In free flight
the oscillator moves with its constants alone. Milling has k = d = b K_s(t), f = h b K_s(t) (theory: Mann and Young
2006, Proc. R. Soc. A 462, 2145, equations 4.1-4.12). This module states problems; solving them is elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbed.cut import Cut
from testbed.machine import Model

Coefficient = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Constant:
    """A coefficient that does not change with time."""

    value: float = 0.0

    def __call__(self, time: np.ndarray) -> np.ndarray:
        return np.full(np.shape(time), self.value)


@dataclass(frozen=True)
class Cosine:
    """amplitude * cos(2 pi t / period)."""

    amplitude: float
    period: float

    def __call__(self, time: np.ndarray) -> np.ndarray:
        return self.amplitude * np.cos(2.0 * math.pi * np.asarray(time) / self.period)


@dataclass(frozen=True)
class CuttingStiffness:
    """scale * b * K_s(t): the cutting force per chip along the structure, over the modal mass (1/s^2 when scale is 1).

    K_s = sum over the teeth in the cut of (Gamma_t cos th + Gamma_n sin th) sin th, th measured at the tooth. An edge
    of helix angle beta lags by 2 z tan(beta) / D at height z: the sum becomes an integral over the engaged height,
    taken here in closed form. `lag` is the lag over the whole depth, rad; `engagement` the angle each point of the
    edge spends in the cut, rad. Time 0 is the instant at which a tooth's tip enters the cut.
    """

    tangential: float  # Gamma_t = K_t / m, N m^-2 kg^-1
    normal: float  # Gamma_n = K_n / m
    depth: float  # b, m
    spindle_speed: float  # rad/s
    pitch: float  # rad
    entry_angle: float  # rad
    engagement: float  # rad
    lag: float = 0.0  # rad
    scale: float = 1.0

    def __call__(self, time: np.ndarray) -> np.ndarray:
        turned = self.spindle_speed * np.asarray(time, dtype=float)
        teeth = math.ceil((self.engagement + self.lag) / self.pitch - 1e-12)
        total = np.zeros_like(turned)
        for tooth in range(max(1, teeth)):
            total += self._of_one_tooth(turned + tooth * self.pitch)
        return self.scale * self.depth * total

    def _of_one_tooth(self, turned: np.ndarray) -> np.ndarray:
        """Mean over the depth of the coefficient of one tooth that has turned by this angle since its tip's entry."""
        if self.lag == 0.0:
            theta = self.entry_angle + turned
            value = (self.tangential * np.cos(theta) + self.normal * np.sin(theta)) * np.sin(theta)
            return np.where((turned >= 0.0) & (turned < self.engagement), value, 0.0)
        last = np.clip(turned, 0.0, self.engagement)
        first = np.clip(turned - self.lag, 0.0, self.engagement)
        return (self._integral(last) - self._integral(first)) / self.lag

    def _integral(self, turned: np.ndarray) -> np.ndarray:
        theta = self.entry_angle + turned
        return 0.5 * self.tangential * np.sin(theta) ** 2 + self.normal * (0.5 * theta - 0.25 * np.sin(2.0 * theta))

    def breaks(self) -> tuple[float, ...]:
        """Times (s) within one tooth passing period between which the coefficient is smooth; the last ends the cut."""
        window = self.engagement + self.lag
        corners = {0.0, min(window, self.pitch)}
        for tooth in range(math.ceil(window / self.pitch - 1e-12)):
            corners |= {corner - tooth * self.pitch for corner in (self.lag, self.engagement, window)}
        end = min(window, self.pitch)
        smallest = 1e-9 * self.pitch
        inside = [0.0]
        for corner in sorted(corners):
            if inside[-1] + smallest < corner < end - smallest:
                inside.append(corner)
        return tuple(angle / self.spindle_speed for angle in (*inside, end))


@dataclass(frozen=True)
class DelayEquation:
    """The coefficients of the equation in the module's head.

    damping (1/s), stiffness (1/s^2): constants. delay tau (s), also the principal period. breaks: times (s), rising
    from 0 to the end of the cut (at most tau), between which c, k, d and f are smooth. periodic_damping c (1/s),
    periodic_stiffness k (1/s^2), delayed d (1/s^2), forcing f (m/s^2): functions of an array of times in [0, tau).
    """

    damping: float
    stiffness: float
    delay: float
    breaks: tuple[float, ...]
    periodic_stiffness: Coefficient = Constant()
    delayed: Coefficient = Constant()
    periodic_damping: Coefficient = Constant()
    forcing: Coefficient = Constant()

    def __post_init__(self) -> None:
        if not (math.isfinite(self.delay) and self.delay > 0):
            raise ValueError("delay must be above 0")
        rising = all(low < high for low, high in zip(self.breaks, self.breaks[1:], strict=False))
        if len(self.breaks) < 2 or self.breaks[0] != 0.0 or not rising:
            raise ValueError("breaks must rise from 0 to the end of the cut")
        if self.breaks[-1] > self.delay * (1 + 1e-12):
            raise ValueError("the cut cannot outlast the delay")

    @property
    def free_flight(self) -> float:
        """Time of a period outside the cut, s; exactly 0 where the cut tiles the whole delay."""
        rest = self.delay - self.breaks[-1]
        return rest if rest > 1e-9 * self.delay else 0.0


def milling_equation(model: Model, cut: Cut, *, added_damping: Coefficient | None = None) -> DelayEquation:
    """The linear milling equation of this machine at this cut, tooth after tooth (runout-free).

    Any number of flutes, up- or down-milling, helix. Principal period and delay are the tooth passing period.
    added_damping: further damping c(t) over the modal mass (1/s) at times after a tooth's entry, such as process
    damping; it acts during the cut only. Raises ValueError when the model has no cutter, or more than one mode along the feed.
    """
    if model.cutter is None or model.cutting is None:
        raise ValueError("the model has no cutter: nothing is cut")
    if model.planar:
        raise ValueError("the machine has modes beyond one of the workpiece along x, or a pitch for each tooth: "
                         "this takes one mode along x")
    structure, cutter, cutting = model.structure, model.cutter, model.cutting
    lag = abs(2.0 * cut.axial_depth_of_cut * math.tan(cutter.helix_angle) / cutter.diameter)
    coefficient = CuttingStiffness(
        tangential=cutting.tangential_coefficient / structure.mass,
        normal=cutting.normal_coefficient / structure.mass,
        depth=cut.axial_depth_of_cut, spindle_speed=cut.spindle_speed, pitch=cutter.pitch,
        entry_angle=cutting.entry_angle, engagement=cutting.engagement_angle, lag=lag,
    )
    omega = structure.natural_frequency_rad
    return DelayEquation(
        damping=2.0 * structure.damping_ratio * omega, stiffness=omega**2,
        delay=cut.tooth_passing_period(cutter.flutes), breaks=coefficient.breaks(),
        periodic_stiffness=coefficient, delayed=coefficient, periodic_damping=added_damping or Constant(),
        forcing=CuttingStiffness(**{**vars(coefficient), "scale": cut.feed_per_tooth}),
    )


def mathieu_equation(kappa: float, delta: float, eps: float, b: float, tau: float = 2.0 * math.pi) -> DelayEquation:
    """x'' + kappa x' + [delta + eps cos(2 pi t / tau)] x = b x(t - tau) (Insperger and Stepan 2002)."""
    return DelayEquation(damping=kappa, stiffness=delta, delay=tau, breaks=(0.0, tau),
                         periodic_stiffness=Cosine(eps, tau), delayed=Constant(b))
