"""A second road to the motion of a planar machine in a cut, which shares no code with the engines.

The delay equation by the method of steps: scipy's DOP853 from corner to corner of the force, the past read from its dense
output. Equal or unequal teeth, straight or helical, at a steady speed and without effects; for any number of modes.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp

POINTS = 10  # of Gauss, over the part of a helical edge that is in the cut


class Road:
    """One machine in one cut, solved from the entry (time 0, angle 0) for so many radians of spindle angle."""

    def __init__(self, model, speed, depth, feed, turned, start=None, rtol=1e-10):
        modes, cutter, cutting = model.structure.modes, model.cutter, model.cutting
        self.shapes = np.array([(math.cos(mode.direction), math.sin(mode.direction)) for mode in modes])
        self.mass = np.array([mode.mass for mode in modes])
        self.omega = 2.0 * math.pi * np.array([mode.natural_frequency for mode in modes])
        self.zeta = np.array([mode.damping_ratio for mode in modes])
        self.speed, self.depth, self.count = speed, depth, len(modes)
        self.feed_speed = feed * cutter.flutes * speed / (2.0 * math.pi)
        self.engaged, self.entry = cutting.engagement_angle, cutting.entry_angle
        self.kt, self.kn = cutting.tangential_coefficient, cutting.normal_coefficient
        self.lag = 2.0 * depth * math.tan(abs(cutter.helix_angle)) / cutter.diameter
        pitches = list(cutter.pitch_angles) or [2.0 * math.pi / cutter.flutes] * cutter.flutes
        enters = np.cumsum([0.0, *pitches[1:]])
        self.teeth = []  # (angle at which the tooth enters, the angle by which it follows another)
        for turn in range(-2, math.ceil(turned / (2.0 * math.pi)) + 1):
            self.teeth += [(2.0 * math.pi * turn + enter, pitch) for enter, pitch in zip(enters, pitches, strict=True)]
        corners = [angle + end for angle, _ in self.teeth for end in (0.0, self.lag, self.engaged, self.engaged + self.lag)]
        corners += [corner + pitch for corner in corners for pitch in set(pitches)]
        corners = sorted({0.0, turned, *(round(one, 12) for one in corners if 0.0 < one < turned)})
        self.times, self.pieces = [0.0], []
        state = np.zeros(2 * self.count) if start is None else np.asarray(start, float)
        self.nodes, self.weights = np.polynomial.legendre.leggauss(POINTS)
        for low, high in zip(corners[:-1], corners[1:], strict=True):
            if high - low < 1e-11:
                continue
            middle = 0.5 * (low + high)
            cutting_now = [one for one in self.teeth if 0.0 < middle - one[0] < self.engaged + self.lag]
            found = solve_ivp(lambda t, y, teeth=cutting_now: self.rate(t, y, teeth), (low / speed, high / speed), state,
                              method="DOP853", rtol=rtol, atol=1e-16, dense_output=True)  # fmt: skip
            state = found.y[:, -1]
            self.times.append(high / speed)
            self.pieces.append(found.sol)

    def state(self, time):
        """Coordinates, then their rates, at a time in the past; the front is straight before the entry."""
        if time < 0.0:
            return np.zeros(2 * self.count)
        piece = min(max(int(np.searchsorted(self.times, time, "right")) - 1, 0), len(self.pieces) - 1)
        return self.pieces[piece](time)

    def force(self, time, here, teeth):
        """(F_x, F_y) on the workpiece where the motion is `here` (x, y)."""
        total, angle = np.zeros(2), self.speed * time
        for enter, pitch in teeth:
            leading = angle - enter
            if self.lag:
                low, high = max(leading - self.lag, 0.0), min(leading, self.engaged)
                turns = 0.5 * (low + high + (high - low) * self.nodes)
                depths = 0.5 * self.weights * (high - low) * self.depth / self.lag
            else:
                turns, depths = np.array([leading]), np.array([self.depth])
            delay = pitch / self.speed
            past = self.shapes.T @ self.state(time - delay)[: self.count]
            moved = here - past
            theta = self.entry + turns
            sine, cosine = np.sin(theta), np.cos(theta)
            chip = (self.feed_speed * delay + moved[0]) * sine + moved[1] * cosine
            tangential, normal = self.kt * depths * chip, self.kn * depths * chip
            total += [-np.sum(tangential * cosine + normal * sine), np.sum(tangential * sine - normal * cosine)]
        return total

    def rate(self, time, state, teeth):
        """Time derivative of coordinates and rates."""
        place, rate = state[: self.count], state[self.count :]
        pushed = self.shapes @ self.force(time, self.shapes.T @ place, teeth) if teeth else np.zeros(self.count)
        return np.concatenate([rate, pushed / self.mass - 2.0 * self.zeta * self.omega * rate - self.omega**2 * place])

    def motion(self, times):
        """(x, y) of the workpiece against the tool at times from 0 on, shape (2, times)."""
        return np.array([self.shapes.T @ self.state(time)[: self.count] for time in times]).T
