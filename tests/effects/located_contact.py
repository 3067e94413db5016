"""A cut with loss of contact by one flute, in plain Python, with every kink in its place: a second road and a study of order.

The surface is kept in pieces: within a step of the grid a piece ends where a tooth lost contact or touched again, in this
pass or in one before. Steps are split there, so that each part is smooth and the classical Runge-Kutta scheme keeps its
fourth order. `located=False` splits steps at loss and return but keeps the surface at the grid's points alone. Free flight
is exact. Shares no code with the engines.
"""

from __future__ import annotations

import math

from testbed.cut import Cut
from tests.effects.direct import KN, KT, MODEL, WINDOW

Triple = tuple[float, float, float]
MASS, DAMPING, STIFFNESS = MODEL.structure.mass, MODEL.structure.damping, MODEL.structure.stiffness
TINY = 1e-9  # share of a piece below which two kinks count as one


def parabola(values: Triple, u: float) -> float:
    """Through the values at the start, middle and end of a piece, at its share u."""
    return values[0] * (1 - u) * (1 - 2 * u) + values[1] * 4 * u * (1 - u) + values[2] * u * (2 * u - 1)


def part(values: Triple, first: float, last: float) -> Triple:
    return parabola(values, first), parabola(values, 0.5 * (first + last)), parabola(values, last)


class Pass:
    """One tooth in the cut: the state x, v, the feed travelled, and whether the edge touches."""

    def __init__(self, course: Cut, x: float, v: float, feed: float, met: float) -> None:
        self.course, self.x, self.v, self.feed = course, x, v, feed
        self.touches = feed + x >= met

    def rate(self, theta: float, x: float, v: float, met: float) -> tuple[float, float]:
        chip = self.feed + x - met if self.touches else 0.0
        load = -self.course.axial_depth_of_cut * (KT * math.cos(theta) + KN * math.sin(theta)) * math.sin(theta) * chip
        return v / self.course.spindle_speed, (load - DAMPING * v - STIFFNESS * x) / MASS / self.course.spindle_speed

    def moved(self, theta: float, span: float, met: Triple) -> tuple[float, float]:
        """State after `span` rad, contact as it is."""
        x, v = self.x, self.v
        a = self.rate(theta, x, v, met[0])
        b = self.rate(theta + span / 2, x + span / 2 * a[0], v + span / 2 * a[1], met[1])
        c = self.rate(theta + span / 2, x + span / 2 * b[0], v + span / 2 * b[1], met[1])
        d = self.rate(theta + span, x + span * c[0], v + span * c[1], met[2])
        return x + span * (a[0] + 2 * b[0] + 2 * c[0] + d[0]) / 6, v + span * (a[1] + 2 * b[1] + 2 * c[1] + d[1]) / 6

    def between(self, x1: float, v1: float, span: float, u: float) -> float:
        """Feed position of the edge at the share u of a part that ends in x1, v1."""
        time = span / self.course.spindle_speed
        hermite = self.x * (1 + 2 * u) * (1 - u) ** 2 + x1 * u * u * (3 - 2 * u)
        return self.feed + hermite + time * u * (1 - u) * (self.v * (1 - u) - v1 * u)

    def change_of_contact(self, x1: float, v1: float, span: float, met: Triple) -> float | None:
        """Share of the part at which the edge lets go or touches; None where it does not."""
        if (self.feed + x1 < met[2]) != self.touches:
            return None
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            if (self.between(x1, v1, span, middle) < parabola(met, middle)) == self.touches:
                high = middle
            else:
                low = middle
        return 0.5 * (low + high)

    def cross(self, theta: float, step: float, surface: list[tuple[float, float, Triple]]) -> list[tuple[float, float, Triple]]:
        """Cross one step of the grid; the surface it leaves, in pieces (first share, last share, values)."""
        left, ahead = [], list(surface)
        while ahead:
            first, last, met = ahead.pop(0)
            span = (last - first) * step
            x1, v1 = self.moved(theta + first * step, span, met)
            share = self.change_of_contact(x1, v1, span, met) if last - first > TINY else None
            if share is not None:
                middle = first + share * (last - first)
                if share < 1 - TINY:
                    ahead.insert(0, (middle, last, part(met, share, 1.0)))
                if share <= TINY:
                    self.touches = not self.touches
                    continue
                last, met, span = middle, part(met, 0.0, share), share * span
                x1, v1 = self.moved(theta + first * step, span, met)
            cut = (self.feed + self.x, self.between(x1, v1, span, 0.5), self.feed + x1)
            left.append((first, last, cut if self.touches else met))
            self.x, self.v = x1, v1
            if share is not None:
                self.touches = not self.touches
        return left


def at_grid(pieces: list[tuple[float, float, Triple]]) -> list[tuple[float, float, Triple]]:
    """The same surface kept at the step's start, middle and end alone, as both engines keep it."""
    def at(u: float) -> float:
        first, last, values = next(piece for piece in pieces if u <= piece[1] + 1e-12)
        return parabola(values, min(1.0, (u - first) / (last - first)))

    return [(0.0, 1.0, (at(0.0), at(0.5), at(1.0)))]


def simulate(course: Cut, steps: int, located: bool = True) -> list[float]:
    """Displacements at the start of each pass, with `steps` of the grid in each cut."""
    h, step = course.feed_per_tooth, WINDOW / steps
    surface = [[(0.0, 1.0, (-h, -h, -h))] for _ in range(steps)]
    x, v, found = course.initial_displacement, course.initial_velocity, [course.initial_displacement]
    decay, own = 0.5 * DAMPING / MASS, math.sqrt(STIFFNESS / MASS - (0.5 * DAMPING / MASS) ** 2)
    flight = (2 * math.pi - WINDOW) / course.spindle_speed
    c, s, e = math.cos(own * flight), math.sin(own * flight) / own, math.exp(-decay * flight)
    for number in range(course.passes):
        tooth = Pass(course, x, v, number * h, surface[0][0][2][0])
        for place in range(steps):
            left = tooth.cross(place * step, step, surface[place])
            surface[place] = left if located else at_grid(left)
        x, v = tooth.x, tooth.v
        x, v = e * ((c + decay * s) * x + s * v), e * (-STIFFNESS / MASS * s * x + (c - decay * s) * v)
        found.append(x)
    return found
