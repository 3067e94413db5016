"""What the first teeth of a cut meet: a straight front, or what the structure's swing before the entry would have left.

The front of a workpiece knows nothing of a structure that still rings. A delay equation does: in it the chip is measured from
where the tool was one pitch before, whether it cut there or not. A simulator that solves one has that in its first pass.
"""

import math

from testbed.engines.compiled import inner
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
)
from testbed.engines.oscillator_kernel import oscillator_map


@inner
def swing_before(G, x, v, time):
    """Displacement (m) that the structure had `time` (s) before the state (x, v), ringing freely."""
    a, b, c, d = oscillator_map(G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS], -time)
    return a * x + b * v


@inner
def first_surface(A, P, G, Y, entry, speed, phase, teeth, time, new):
    """Surface before the first tooth: what rigid teeth would have left on the pitches before, and the swing. Y is scratch.

    entry: the state with which the first tooth enters; speed: of the spindle then, rad/s; time (s): when the teeth come to the
    phase (rad). Where contact can be lost, one of unequal teeth may fly over what others before it have cut: two turns settle
    that. Of the swing only the structure's own mode is followed back, as if nothing but its spring and damper held it.
    """
    for place in range(Y.shape[0]):
        Y[place] = 0.0
    first = 2 * int(G[FLUTES])
    Y[2] = time - first * G[PITCH] / speed
    for edge in range(teeth * int(G[SLICES])):
        cover, turned = piece_of_edge(G, phase, edge)
        new[edge] = edge_radius(A, P, G, Y, G[ENTRY] + turned, edge, -first)
    for back in range(first - 1, 0, -1):
        Y[2] = time - back * G[PITCH] / speed
        leave_surface(A, P, G, Y, phase, -back, teeth, new, new)
    if G[SWUNG_FRONT] != 0.0:
        swing = swing_before(G, entry[0], entry[1], (G[PITCH] - phase) / speed)
        for edge in range(teeth * int(G[SLICES])):
            cover, turned = piece_of_edge(G, phase, edge)
            new[edge] += swing * math.sin(G[ENTRY] + turned)
