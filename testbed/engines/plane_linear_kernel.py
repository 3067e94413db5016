"""Any number of modes in the plane where no effect touches the loop, for `plane_run_kernel`: the force is linear in the chip.

    m_j (q_j'' + 2 zeta_j omega_j q_j' + omega_j^2 q_j) = s_j . F
    F = -kappa(phase) [h + r(t) - r(t - tau)],    r = sum of s_j q_j

Same scheme, grid and samples as the general kernel. All edges in the cut together are the 2 x 2 table kappa; what is
remembered of the surface is r at the grid's points, one tooth pass back. `modes` and Q are those of `modes_kernel`.
"""

import math

from testbed.engines.compiled import inner
from testbed.engines.fast_kernel import SEGMENTS, STEPS, TEETH
from testbed.engines.loop_kernel import (
    CORNERS,
    ENTRY,
    FEED,
    KN,
    KT,
    OMEGA,
    PITCH,
    SLICE_DEPTH,
    SLICES,
    SWUNG_FRONT,
    piece_of_edge,
    weights_in_cut,
)
from testbed.engines.modes_kernel import (
    carried_on,
    carry_under_force,
    compliance,
    fill_mode_maps,
    in_the_plane,
    sample_modes,
)

XX, XY, YX, YY = range(4)  # places in a row of kappa, N/m: the force along the first under a chip along the second


@inner
def fill_chip_stiffness(G, phase, teeth, kappa, row):
    """The row of kappa at one phase of the tooth pitch."""
    for place in range(4):
        kappa[row, 0, place] = 0.0
    for edge in range(teeth * int(G[SLICES])):
        cover, turned = piece_of_edge(G, phase, edge)
        sine, cosine = math.sin(G[ENTRY] + turned), math.cos(G[ENTRY] + turned)
        along = G[SLICE_DEPTH] * cover * (G[KT] * cosine + G[KN] * sine)
        across = G[SLICE_DEPTH] * cover * (G[KN] * cosine - G[KT] * sine)
        kappa[row, 0, XX] += along * sine
        kappa[row, 0, XY] += along * cosine
        kappa[row, 0, YX] += across * sine
        kappa[row, 0, YY] += across * cosine


@inner
def chip_force(kappa, row, memory, x, y, weight):
    """(F_x, F_y) on the workpiece, N, at a row of the grid with the workpiece at (x, y); x: the feed of a tooth included, m."""
    dx, dy = x - memory[row, 0], y - memory[row, 1]
    return (-weight * (kappa[row, 0, XX] * dx + kappa[row, 0, XY] * dy),
            -weight * (kappa[row, 0, YX] * dx + kappa[row, 0, YY] * dy))  # fmt: skip


@inner
def step_modes(modes, kappa, memory, row, dt, weights, feed, E, F, spread, Q, Q1, x, y):
    """One step in the cut from Q, which is at (x, y), to Q1. Returns (x, y, force at its start, and at its end) of that."""
    x1, y1 = chip_force(kappa, row, memory, feed + x, y, weights[0])
    half_x, half_y = carried_on(modes, Q, F, 0)
    kick_x, kick_y = spread[0] * x1 + spread[1] * y1, spread[1] * x1 + spread[2] * y1
    x2, y2 = chip_force(kappa, row + 1, memory, feed + half_x + 0.5 * dt * kick_x, half_y + 0.5 * dt * kick_y, weights[1])
    x3, y3 = chip_force(kappa, row + 1, memory, feed + half_x, half_y, weights[1])
    whole_x, whole_y = carried_on(modes, Q, E, 0)
    kick_x, kick_y = spread[0] * x3 + spread[1] * y3, spread[1] * x3 + spread[2] * y3
    x4, y4 = chip_force(kappa, row + 2, memory, feed + whole_x + dt * kick_x, whole_y + dt * kick_y, weights[2])
    carry_under_force(modes, E, F, dt, Q, Q1, x1, y1, 2.0 * (x2 + x3), 2.0 * (y2 + y3), x4, y4)
    end_x, end_y = in_the_plane(modes, Q1, 0)
    x4, y4 = chip_force(kappa, row + 2, memory, feed + end_x, end_y, weights[2])
    return end_x, end_y, x1, y1, x4, y4


@inner
def cross(A, P, G, I, modes, bench, number, segment, row0, steps, dt, angle, span, maps, work, rows, clock, t0, limit, out,  # noqa: E741
          position):  # fmt: skip
    """Step through one segment in the cut, from row0 of the bench on. angle: at its start, rad after the first pass's.

    span: of a step, rad; maps (4, modes, 4): over a step, half of it, the segment, no time; work (2, modes, 2): the state, and
    scratch. Returns (next sample, still bounded).
    """
    kappa, memory = bench[0], bench[1]
    Q, Q1, feed, E, F = work[0], work[1], G[FEED], maps[0], maps[1]
    spread = compliance(modes, F, 1)
    x, y = in_the_plane(modes, Q, 0)
    vx, vy = in_the_plane(modes, Q, 1)
    left_x, left_y = x, y
    for step in range(steps):
        row, weights = row0 + 2 * step, weights_in_cut(G, angle + step * span, span)
        x1, y1, fx0, fy0, fx1, fy1 = step_modes(modes, kappa, memory, row, dt, weights, feed, E, F, spread, Q, Q1, x, y)
        if not (abs(x1) < limit and abs(y1) < limit):
            return position, False
        position = sample_modes(modes, rows, clock, t0, dt, Q, Q1, fx0, fy0, fx1, fy1, out, position)
        vx1, vy1 = in_the_plane(modes, Q1, 1)
        memory[row, 0], memory[row, 1] = left_x, left_y
        memory[row + 1, 0] = 0.5 * (x + x1) + 0.125 * dt * (vx - vx1)
        memory[row + 1, 1] = 0.5 * (y + y1) + 0.125 * dt * (vy - vy1)
        left_x, left_y = x1, y1
        for mode in range(modes.shape[0]):
            Q[mode, 0], Q[mode, 1] = Q1[mode, 0], Q1[mode, 1]
        x, y, vx, vy = x1, y1, vx1, vy1
        t0 += dt
    memory[row0 + 2 * steps, 0], memory[row0 + 2 * steps, 1] = left_x, left_y
    return position, True


@inner
def widths_of_bench(G, I):  # noqa: E741
    """(columns of the table, numbers each, columns of the memory): one for all edges together, with kappa; r."""
    return 1, 4, 2


@inner
def fill_bench(G, I, bench):  # noqa: E741
    """The table kappa of every row: a corner belongs to two segments, since the force jumps there."""
    row0 = 0
    for segment in range(I[SEGMENTS]):
        steps, low, high = I[STEPS + segment], G[CORNERS + segment], G[CORNERS + segment + 1]
        for row in range(2 * steps + 1 if I[TEETH + segment] > 0 else 0):
            fill_chip_stiffness(G, low + (high - low) * row / (2.0 * steps), I[TEETH + segment], bench[0], row0 + row)
        row0 += 2 * steps + 1


@inner
def meet_front(A, P, G, I, modes, Q, E, bench, begun):  # noqa: E741
    """Into the memory: what the first teeth meet, with the structure at Q at the time `begun`, s. E: scratch.

    That is a straight front, or what the structure's swing left one pitch before.
    """
    memory, row0 = bench[1], 0
    for segment in range(I[SEGMENTS] if G[SWUNG_FRONT] != 0.0 else 0):
        steps, low, high = I[STEPS + segment], G[CORNERS + segment], G[CORNERS + segment + 1]
        for row in range(2 * steps + 1 if I[TEETH + segment] > 0 else 0):
            phase = low + (high - low) * row / (2.0 * steps)
            fill_mode_maps(modes, -(G[PITCH] - phase) / G[OMEGA], E)
            memory[row0 + row, 0], memory[row0 + row, 1] = carried_on(modes, Q, E, 0)
        row0 += 2 * steps + 1
