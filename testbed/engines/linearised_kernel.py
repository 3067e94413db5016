"""The regenerative loop as a delay equation in the spindle angle: rates of change, and their partial derivatives.

At a phase phi of the tooth pitch the state Y obeys dY/dphi = f(Y(phi), Y(phi - pitch)): the surface a tooth meets is
the radial position it had one pitch before. The partial derivatives are central differences of the very functions both
engines integrate, so an effect's file is the only place where its law is written.
"""

import numpy as np

from testbed.engines.compiled import inner
from testbed.engines.hooks import hook_chip
from testbed.engines.loop_kernel import (
    ENTRY,
    SLICES,
    cutting_force,
    derivative,
    edge_radius,
    piece_of_edge,
    spindle_speed,
)
from testbed.system.kernel_cache import kept


@inner
def rate_in_angle(A, P, G, Y, past, phase, pass_number, teeth, surface, D, f):
    """Write dY/dphi into f; returns (speed, rad/s; whether an edge in the cut has lost contact)."""
    lost = False
    for edge in range(teeth * int(G[SLICES])):
        cover, turned = piece_of_edge(G, phase, edge)
        theta = G[ENTRY] + turned
        surface[edge] = edge_radius(A, P, G, past, theta, edge, pass_number - 1)
        if cover > 0.0:
            penetration = edge_radius(A, P, G, Y, theta, edge, pass_number) - surface[edge]
            # rounding at a grazing edge is no loss of contact
            lost = lost or abs(hook_chip(A, P, penetration) - penetration) > 1e-12
    force, across, torque = 0.0, 0.0, 0.0
    if teeth > 0:
        force, across, torque = cutting_force(A, P, G, Y, phase, pass_number, teeth, surface)
    derivative(A, P, G, Y, D, force, across, torque)
    speed = spindle_speed(A, P, G, Y)
    for place in range(Y.shape[0]):
        f[place] = D[place] / speed
    return speed, lost


@kept(nogil=True)
def linearise(A, P, G, phases, pass_number, teeth, states, pasts, kept, scale, f, now, before, speed, lost):
    """Rates f (n, K), their derivatives by the state `now` and by the state one pitch ago `before`, both (n, K, K).

    states, pasts: (n, size) whole states at the phases (n,). kept (K,): the places of the state that are unknowns;
    scale (K,): half-width of the difference for each. speed (n,) and lost (n,) are filled too.
    """
    size = states.shape[1]
    surface = np.empty(max(1, teeth * int(G[SLICES])))
    D, low, high, base = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    for n in range(phases.shape[0]):
        speed[n], lost[n] = rate_in_angle(A, P, G, states[n], pasts[n], phases[n], pass_number, teeth, surface, D, base)
        for i in range(kept.shape[0]):
            f[n, i] = base[kept[i]]
        for j in range(kept.shape[0]):
            place, width = kept[j], scale[j]
            for which in range(2):
                matrix, vector = (now, states[n]) if which == 0 else (before, pasts[n])
                middle = vector[place]
                vector[place] = middle + width
                rate_in_angle(A, P, G, states[n], pasts[n], phases[n], pass_number, teeth, surface, D, high)
                vector[place] = middle - width
                rate_in_angle(A, P, G, states[n], pasts[n], phases[n], pass_number, teeth, surface, D, low)
                vector[place] = middle
                for i in range(kept.shape[0]):
                    matrix[n, i, j] = (high[kept[i]] - low[kept[i]]) / (2.0 * width)
