"""What the first teeth of a cut meet: a straight front, or what the structure's swing before the entry would have left.

The front of a workpiece knows nothing of a structure that still rings. A delay equation does: in it the chip is measured from
where the tool was one pitch before, whether it cut there or not. A simulator that solves one has that in its first pass.
"""

import math

from testbed.engines.compiled import inner
from testbed.engines.hooks import PLANAR
from testbed.engines.loop_kernel import (
    DAMPING,
    ENTRY,
    FLUTES,
    MASS,
    PITCH,
    SLICES,
    STIFFNESS,
    SWUNG_FRONT,
    edge_radius,
    leave_surface,
    piece_of_edge,
    spindle_speed,
)
from testbed.engines.oscillator_kernel import oscillator_map
from testbed.engines.plane_kernel import (
    COUNT,
    FIRST_MODE,
    MODE_DAMPING,
    MODE_MASS,
    MODE_SIZE,
    MODE_STIFFNESS,
    mode_place,
)

FINE, COARSE = 16, 1  # steps a pitch of a clock that is turned back: for the last pitch, and for those before


@inner
def swing_before(G, x, v, time):
    """Displacement (m) that the structure had `time` (s) before the state (x, v), ringing freely."""
    a, b, c, d = oscillator_map(G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS], -time)
    return a * x + b * v


@inner
def plane_swing_before(P, Y, time):
    """(x, y) of that of all modes (m) before the state Y."""
    x, y = 0.0, 0.0
    for mode in range(int(P[COUNT])):
        at, place = FIRST_MODE + mode * MODE_SIZE, mode_place(mode)
        mass = P[at + MODE_MASS]
        a, b, c, d = oscillator_map(P[at + MODE_STIFFNESS] / mass, P[at + MODE_DAMPING] / mass, -time)
        moved = a * Y[place] + b * Y[place + 1]
        x, y = x + P[at] * moved, y + P[at + 1] * moved
    return x, y


@inner
def time_before(A, P, G, Y, steady, time, angle, steps):
    """Time (s) at which the spindle was `angle` (rad) before where it is at `time`. Y is scratch: its clock is turned back.

    steady: the speed is one and the same. Else the clock is followed by the rule of Runge and Kutta, so many steps a pitch.
    """
    Y[2] = time
    if steady:
        return time - angle / spindle_speed(A, P, G, Y)
    count = 1 + int(steps * abs(angle) / G[PITCH])
    part = angle / count
    for _ in range(count):
        Y[2] = time
        first = 1.0 / spindle_speed(A, P, G, Y)
        Y[2] = time - 0.5 * part * first
        second = 1.0 / spindle_speed(A, P, G, Y)
        Y[2] = time - 0.5 * part * second
        third = 1.0 / spindle_speed(A, P, G, Y)
        Y[2] = time - part * third
        time -= part * (first + 2.0 * (second + third) + 1.0 / spindle_speed(A, P, G, Y)) / 6.0
    return time


@inner
def first_surface(A, P, G, Y, entry, steady, phase, teeth, begun, new):
    """Surface before the first tooth: what rigid teeth would have left on the pitches before, and the swing. Y is scratch.

    entry: the state with which the first tooth enters, at the time `begun` (s); phase (rad): where the teeth will be then.
    Where contact can be lost, one of unequal teeth may fly over what others before it have cut: two turns settle that. Of the
    swing only the structure's own modes are followed back, as if nothing but their springs and dampers held them.
    """
    for place in range(Y.shape[0]):
        Y[place] = 0.0
    first = 2 * int(G[FLUTES])
    last = time_before(A, P, G, Y, steady, begun, G[PITCH] - phase, FINE)
    Y[2] = time_before(A, P, G, Y, steady, last, (first - 1) * G[PITCH], COARSE)
    for edge in range(teeth * int(G[SLICES])):
        cover, turned = piece_of_edge(G, phase, edge)
        new[edge] = edge_radius(A, P, G, Y, G[ENTRY] + turned, edge, -first)
    for back in range(first - 1, 0, -1):
        Y[2] = time_before(A, P, G, Y, steady, Y[2], -G[PITCH], COARSE) if back > 1 else last
        leave_surface(A, P, G, Y, phase, -back, teeth, new, new)
    if G[SWUNG_FRONT] != 0.0:
        across = 0.0
        if PLANAR:
            swing, across = plane_swing_before(P, entry, begun - last)
        else:
            swing = swing_before(G, entry[0], entry[1], begun - last)
        for edge in range(teeth * int(G[SLICES])):
            cover, turned = piece_of_edge(G, phase, edge)
            new[edge] += swing * math.sin(G[ENTRY] + turned)
            if PLANAR:
                new[edge] += across * math.cos(G[ENTRY] + turned)
