"""The linear delay equation of a machine with any number of modes in x and y, on tool or workpiece, and teeth of any pitch.

    q'' + 2 zeta omega q' + omega^2 q = -b sum over teeth k of V^T G_k(t) V [q(t) - q(t - tau_k)]

q are the mass-normalised modes, y = V q is the motion of the workpiece against the tool: (x, y), or its one component where all
modes move along one line. A chip of unit length along x or y makes the force -b H on the workpiece, G = P^T H P (x the feed, y
its normal; Altintas and Budak 1995, CIRP Annals 44, 357). Each tooth cuts the surface of the tooth before it, tau_k ago. The
time is the spindle angle. A helix is an integral over the height, in closed form.

`lanes` are the delays of a principal period: all teeth together where their pitch is equal, and the period is a tooth
passing; each tooth alone where it is not, and the period is a revolution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from testbed.analysis.linear.spectral_elements import LONGEST, MOST_POINTS
from testbed.machine import Model
from testbed.system.kernel_cache import kept

CLOSE = 1e-9  # of a period: corners that are nearer are one
MOST_PHASE = 1200.0  # rad in the cuts of a period: about 190 oscillations
FEWEST, A_RADIAN = 1.5, 0.65  # points of an element, where the delayed motion is known at the same points: measured, for 1e-5
FEWEST_MET, A_RADIAN_MET = 2.0, 0.9  # and where it is interpolated
CHANGES = 2.0  # rad of phase in a rad: the law of the cut changes with twice the tooth's angle
ALONG = 1e-12  # sine of the angle between modes that move along one line


@dataclass(frozen=True)
class PlanarMachine:
    """A machine as its delay equation needs it, for any cut.

    axes (2, D): directions (x, y) of the components of y. shapes V (D, M), 1/sqrt(kg). frequencies (M,) rad/s, dampings (M,)
    ratios. entries, delays (L,): spindle angle (rad) at which a lane's first tooth enters, and to the tooth before it.
    law: K_t, K_n (N/m^2), the angle of entry and that from entry to exit (rad). period_passes: tooth passings in a period.
    """

    axes: np.ndarray
    shapes: np.ndarray
    frequencies: np.ndarray
    dampings: np.ndarray
    entries: np.ndarray
    delays: np.ndarray
    law: tuple[float, float, float, float]
    lag_per_depth: float
    period_passes: int

    def lag(self, depth: float) -> float:
        """Angle (rad) by which an edge's upper end follows its tip at an axial depth (m)."""
        return self.lag_per_depth * depth

    def corners(self, depth: float) -> tuple[np.ndarray, np.ndarray]:
        """Angles of a period (from 0 to its end) between which the equation is smooth, and whether a tooth cuts between them.

        A corner of one tooth's cut lies in the surface that the next one meets. That, too, is a corner of the equation; what
        it leaves there is smoother by two orders, and is not followed further.
        """
        period, window = float(self.delays.sum()), self.law[3] + self.lag(depth)
        own = {(entry + corner) % period for entry in self.entries for corner in (0.0, self.lag(depth), self.law[3], window)}
        met = {(corner + delay) % period for before, delay in zip(np.roll(self.entries, 1), self.delays, strict=True)
               for corner in own if (corner - before) % period < window}
        edges = [0.0]
        for corner in sorted(own | met):
            if corner - edges[-1] > CLOSE * period and period - corner > CLOSE * period:
                edges.append(corner)
        places = np.array([*edges, period])
        middles = 0.5 * (places[1:] + places[:-1])
        cut = ((middles[:, None] - self.entries) % period < window).any(axis=1)
        return places, cut


def planar_machine(model: Model, by_revolution: bool = False) -> PlanarMachine:
    """The machine of a model. by_revolution: a lane a tooth even where the pitch is equal. ValueError without a cutter."""
    if model.cutter is None or model.cutting is None:
        raise ValueError("the model has no cutter: nothing is cut")
    cutter, cutting, modes = model.cutter, model.cutting, model.structure.modes
    shapes = np.array([mode.shape for mode in modes]).T
    first = shapes[:, 0]
    one_line = np.all(np.abs(first[0] * shapes[1] - first[1] * shapes[0]) < ALONG)
    axes = first[:, None] if one_line else np.eye(2)
    each = by_revolution or bool(cutter.pitch_angles)
    delays = np.array(cutter.pitches) if each else np.array([cutter.pitch])
    return PlanarMachine(
        axes, axes.T @ shapes / np.sqrt([mode.mass for mode in modes]),
        np.array([mode.natural_frequency_rad for mode in modes]), np.array([mode.damping_ratio for mode in modes]),
        np.cumsum(delays) - delays[0], delays,
        (cutting.tangential_coefficient, cutting.normal_coefficient, cutting.entry_angle, cutting.engagement_angle),
        abs(2.0 * math.tan(cutter.helix_angle) / cutter.diameter), cutter.flutes if each else 1)


@kept
def _integrals(theta):
    """Integrals of sin cos, sin^2 and cos^2 up to an angle."""
    wave = 0.25 * math.sin(2.0 * theta)
    return 0.5 * math.sin(theta) ** 2, 0.5 * theta - wave, 0.5 * theta + wave


@kept
def chip_stiffness(turned, period, lag, law, h):
    """H of one lane whose first tooth turned by an angle since its tip's entry: mean over the depth, N/m^2, into `h` (2, 2).

    The lane's other teeth follow at whole periods. True where one of them cuts.
    """
    tangential, normal, entry, engagement = law
    sc, ss, cc, cuts = 0.0, 0.0, 0.0, False
    while turned < engagement + lag:
        if lag == 0.0:
            sine, cosine = math.sin(entry + turned), math.cos(entry + turned)
            sc, ss, cc = sc + sine * cosine, ss + sine * sine, cc + cosine * cosine
        else:
            high = _integrals(entry + min(turned, engagement))
            low = _integrals(entry + max(turned - lag, 0.0))
            sc, ss, cc = sc + (high[0] - low[0]) / lag, ss + (high[1] - low[1]) / lag, cc + (high[2] - low[2]) / lag
        cuts = True
        turned += period
    h[0, 0], h[0, 1] = tangential * sc + normal * ss, tangential * cc + normal * sc
    h[1, 0], h[1, 1] = normal * sc - tangential * ss, normal * cc - tangential * sc
    return cuts


@kept
def divide(places, cut, swing, longest, more, met):
    """(starts, lengths, points) of the elements between corners; no points: free flight.

    None at all: more oscillations than can be resolved. swing: rad by which the motion turns in a rad; longest: rad in an
    element; more: points beyond the usual; met: whether delayed motion is interpolated.
    """
    fewest, a_radian = (FEWEST_MET, A_RADIAN_MET) if met else (FEWEST, A_RADIAN)
    parts, total = np.ones(cut.size, dtype=np.int64), 0.0
    for k in range(cut.size):
        if cut[k]:
            phase = (places[k + 1] - places[k]) * (swing + CHANGES)
            total += phase
            if not total < MOST_PHASE:
                return np.empty(0), np.empty(0), np.empty(0, dtype=np.int64)
            parts[k] = max(1, math.ceil(phase / LONGEST), math.ceil((places[k + 1] - places[k]) / longest - 1e-9))
    starts, lengths, points = np.empty(parts.sum()), np.empty(parts.sum()), np.zeros(parts.sum(), dtype=np.int64)
    e = 0
    for k in range(cut.size):
        length = (places[k + 1] - places[k]) / parts[k]
        for part in range(parts[k]):
            starts[e], lengths[e] = places[k] + part * length, length
            if cut[k]:
                usual = math.ceil(fewest + a_radian * length * (swing + CHANGES))
                points[e] = min(usual + more, MOST_POINTS)
            e += 1
    return starts, lengths, points
