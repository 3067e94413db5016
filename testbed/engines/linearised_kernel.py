"""The regenerative loop as a delay equation in the spindle angle: rates of change, and their partial derivatives.

At a phase phi of the period the state Y obeys dY/dphi = f(Y(phi), Y(phi - delay), ...), one delay for every pitch there is: the
surface a tooth meets is the radial position that the one before it had then. The partial derivatives are central differences of
the very functions both engines integrate, so an effect's file is the only place where its law is written.
"""

import numpy as np

from testbed.engines.compiled import inner
from testbed.engines.hooks import hook_chip
from testbed.engines.loop_kernel import (
    ENTRY,
    FEED_SPEED,
    RADIUS,
    SLICES,
    T_ENTRY,
    derivative,
    force_of_edge,
    piece_of_tooth,
    radius_of_edge,
    spindle_speed,
)
from testbed.engines.plane_kernel import position_at_cut, velocity_at_cut
from testbed.system.kernel_cache import kept

LEAD, LANE, NUMBER, OLDER = range(4)
# Of a tooth in the cut: what its tip's angle after its entry is ahead of the phase (rad), which of the delays is its own, and
# the numbers, as a hook is told them, of it and of the tooth before it.


@inner
def rate_in_angle(A, P, G, Y, pasts, phase, teeth, D, f):
    """Write dY/dphi into f; returns (speed, rad/s; whether a law of the chip bends; edges in the cut; of them out of the work).

    pasts (lanes, size): the state a delay ago, for every delay. teeth (teeth in the cut, 4). Edges: by their share of a tooth.
    """
    bent, inside, out, force, across, torque = False, 0.0, 0.0, 0.0, 0.0, 0.0
    at, moving, feed = position_at_cut(A, P, Y), velocity_at_cut(A, P, Y), G[FEED_SPEED] * (Y[2] - G[T_ENTRY])
    for one in range(teeth.shape[0]):
        past = pasts[int(teeth[one, LANE])]
        x, y = position_at_cut(A, P, past)
        x += G[FEED_SPEED] * (past[2] - G[T_ENTRY])
        for point in range(int(G[SLICES])):
            cover, turned = piece_of_tooth(G, phase + teeth[one, LEAD], point)
            theta = G[ENTRY] + turned
            sine, cosine = np.sin(theta), np.cos(theta)
            met = radius_of_edge(A, P, G, past, x, y, theta, sine, cosine, teeth[one, OLDER])
            if cover > 0.0:
                penetration = radius_of_edge(A, P, G, Y, feed + at[0], at[1], theta, sine, cosine, teeth[one, NUMBER]) - met
                # rounding at a grazing edge is no loss of contact
                bent = bent or abs(hook_chip(A, P, penetration) - penetration) > 1e-12
                inside += cover
                out += cover if penetration < -1e-12 else 0.0
            tangential, normal, left = force_of_edge(A, P, G, Y, at, moving, feed, cover, turned, theta, sine, cosine, met,
                                                     teeth[one, NUMBER])  # fmt: skip
            force -= tangential * cosine + normal * sine
            across += tangential * sine - normal * cosine
            torque += tangential * G[RADIUS]
    derivative(A, P, G, Y, D, force, across, torque)
    speed = spindle_speed(A, P, G, Y)
    for place in range(Y.shape[0]):
        f[place] = D[place] / speed
    return speed, bent, inside, out


@inner
def differences(A, P, G, Y, pasts, phase, teeth, work, kept, scale, vector, matrix):
    """Fill `matrix` (K, K) with the derivatives of f by the places `kept` of `vector`, which is Y or one of the pasts."""
    D, low, high = work
    for j in range(kept.shape[0]):
        place, width = kept[j], scale[j]
        middle = vector[place]
        vector[place] = middle + width
        rate_in_angle(A, P, G, Y, pasts, phase, teeth, D, high)
        vector[place] = middle - width
        rate_in_angle(A, P, G, Y, pasts, phase, teeth, D, low)
        vector[place] = middle
        for i in range(kept.shape[0]):
            matrix[i, j] = (high[kept[i]] - low[kept[i]]) / (2.0 * width)


@kept(nogil=True)
def linearise(A, P, G, phases, teeth, states, pasts, kept, scale, f, now, before, speed, bent, contact):
    """Rates f (n, K), their derivatives by the state, `now` (n, K, K), and by what it was, `before` (n, lanes, K, K).

    states (n, size), pasts (n, lanes, size): whole states at the phases (n,) and a delay ago. kept (K,): the places of the
    state that are unknowns; scale (K,): half-width of the difference for each. `before` stays as it is where no tooth in the
    cut has that delay. speed (n,), bent (n,) and, of edges, contact (n, 2) are filled too: see `rate_in_angle`.
    """
    size = states.shape[1]
    work, base = (np.zeros(size), np.zeros(size), np.zeros(size)), np.zeros(size)
    for n in range(phases.shape[0]):
        Y, past = states[n], pasts[n]
        speed[n], bent[n], contact[n, 0], contact[n, 1] = rate_in_angle(A, P, G, Y, past, phases[n], teeth, work[0], base)
        for i in range(kept.shape[0]):
            f[n, i] = base[kept[i]]
        differences(A, P, G, Y, past, phases[n], teeth, work, kept, scale, Y, now[n])
        for lane in range(past.shape[0]):
            if np.any(teeth[:, LANE] == lane):
                differences(A, P, G, Y, past, phases[n], teeth, work, kept, scale, past[lane], before[n, lane])
