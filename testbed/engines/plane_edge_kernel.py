"""Any number of modes in the plane where effects touch only what happens at an edge, for `plane_run_kernel`.

Same scheme, grid, surface and samples as the general kernel, whose state, modes and all, is an array that every stage writes
and every law reads. Here the modes stay aside: a stage needs no more of them than where the structure is, and how fast, which
the maps and a 2 x 2 compliance tell. Y is that alone: [x, x', time, y, y'].
"""

from testbed.engines.compiled import inner
from testbed.engines.fast_kernel import IDLE, SEGMENTS, STEPS, TEETH, keep_middle
from testbed.engines.front_kernel import first_surface
from testbed.engines.loop_kernel import (
    CORNERS,
    COSINE,
    FLUTES,
    OMEGA,
    PITCH,
    SINE,
    SLICES,
    SWUNG_FRONT,
    T_ENTRY,
    T_SIZE,
    fill_row,
    force_at_row,
    weights_in_cut,
)
from testbed.engines.modes_kernel import (
    FORCES,
    acceleration_in_the_plane,
    carried_on,
    carry_under_force,
    compliance,
    fill_mode_maps,
    in_the_plane,
    sample_modes,
)
from testbed.engines.plane_kernel import position_at_cut, velocity_at_cut
from testbed.engines.sampling_kernel import keep_met, sample_forces


@inner
def put(Y, x, y, vx, vy, time):
    """A state of position (m), velocity (m/s) and time (s)."""
    Y[0], Y[1], Y[2], Y[3], Y[4] = x, vx, time, y, vy


@inner
def force_in(A, P, G, Y, T, row, S, left, left_row, tooth, edges, weight):
    """(F_x, F_y) on the workpiece, N, in the state Y; left[left_row]: the surface left there."""
    at, moving = position_at_cut(A, P, Y), velocity_at_cut(A, P, Y)
    fx, fy, torque = force_at_row(A, P, G, Y, at, moving, T, row, S, left, left_row, tooth, edges)
    return weight * fx, weight * fy


@inner
def step_under_edges(A, P, G, modes, bench, row, now, edges, t0, dt, weights, E, F, spread, Q, Q1, x1, y1):
    """One step in the cut from Q at t0 to Q1, where the bench's Y then is; (x1, y1): the force at its start. Returns its last.

    spread: what `compliance` makes of position and velocity over half a step, and of velocity at once.
    """
    T, S, left, tooth, Y = bench[:5]
    moves, kicks, at_once = spread
    x, y = carried_on(modes, Q, F, 0)
    vx, vy = carried_on(modes, Q, F, 1)
    half = 0.5 * dt
    put(Y, x + half * (moves[0] * x1 + moves[1] * y1), y + half * (moves[1] * x1 + moves[2] * y1),
        vx + half * (kicks[0] * x1 + kicks[1] * y1), vy + half * (kicks[1] * x1 + kicks[2] * y1), t0 + half)  # fmt: skip
    x2, y2 = force_in(A, P, G, Y, T, row + 1, S, left, 2, tooth, edges, weights[1])
    put(Y, x, y, vx + half * (at_once[0] * x2 + at_once[1] * y2), vy + half * (at_once[1] * x2 + at_once[2] * y2), t0 + half)
    x3, y3 = force_in(A, P, G, Y, T, row + 1, S, left, 2, tooth, edges, weights[1])
    x, y = carried_on(modes, Q, E, 0)
    vx, vy = carried_on(modes, Q, E, 1)
    put(Y, x + dt * (moves[0] * x3 + moves[1] * y3), y + dt * (moves[1] * x3 + moves[2] * y3),
        vx + dt * (kicks[0] * x3 + kicks[1] * y3), vy + dt * (kicks[1] * x3 + kicks[2] * y3), t0 + dt)  # fmt: skip
    x4, y4 = force_in(A, P, G, Y, T, row + 2, S, left, 2, tooth, edges, weights[2])
    carry_under_force(modes, E, F, dt, Q, Q1, x1, y1, 2.0 * (x2 + x3), 2.0 * (y2 + y3), x4, y4)
    x, y = in_the_plane(modes, Q1, 0)
    vx, vy = in_the_plane(modes, Q1, 1)
    put(Y, x, y, vx, vy, t0 + dt)
    return force_in(A, P, G, Y, T, row + 2, S, left, 1 - now, tooth, edges, weights[2])


@inner
def cross(A, P, G, I, modes, bench, number, segment, row0, steps, dt, angle, span, maps, work, rows, clock, t0, limit, out,  # noqa: E741
          position):  # fmt: skip
    """As that of `plane_linear_kernel`. number: of the pass, from the run's first on."""
    T, S, left, tooth, Y, ends = bench
    Q, Q1, E, F = work[0], work[1], maps[0], maps[1]
    edges = I[TEETH + segment] * int(G[SLICES])
    for edge in range(edges):
        tooth[edge] = (number - edge // int(G[SLICES])) % int(G[FLUTES])
    spread = (compliance(modes, F, 1), compliance(modes, F, 3), compliance(modes, maps[3], 3))
    now, before, fx0, fy0, forces = 0, -1.0, 0.0, 0.0, max(rows[FORCES, 0], rows[FORCES, 1]) >= 0
    x, y = in_the_plane(modes, Q, 0)
    vx, vy = in_the_plane(modes, Q, 1)
    for step in range(steps):
        row, weights = row0 + 2 * step, weights_in_cut(G, angle + step * span, span)
        if weights[0] != before:  # else the force at the last step's end is that at this one's start
            put(Y, x, y, vx, vy, t0)
            fx0, fy0 = force_in(A, P, G, Y, T, row, S, left, now, tooth, edges, weights[0])
        before = weights[2]
        fx1, fy1 = step_under_edges(A, P, G, modes, bench, row, now, edges, t0, dt, weights, E, F, spread, Q, Q1, fx0, fy0)
        x1, vx1, y1, vy1 = Y[0], Y[1], Y[3], Y[4]
        if not (abs(x1) < limit and abs(y1) < limit):
            return position, False
        first = position
        position = sample_modes(modes, rows, clock, t0, dt, Q, Q1, fx0, fy0, fx1, fy1, out, position)
        if forces and position > first:
            put(ends[0], x, y, vx, vy, t0)
            put(ends[2], x1, y1, vx1, vy1, t0 + dt)
            (ax0, ay0), (ax1, ay1) = (acceleration_in_the_plane(modes, Q, fx0, fy0),
                                      acceleration_in_the_plane(modes, Q1, fx1, fy1))  # fmt: skip
            put(ends[1], vx, vy, ax0, ay0, 1.0)
            put(ends[3], vx1, vy1, ax1, ay1, 1.0)
            share, phase = (weights[0] + 4.0 * weights[1] + weights[2]) / 6.0, G[CORNERS + segment] + step * span
            sample_forces(A, P, G, clock, ends[0], ends[1], ends[2], ends[3], phase, phase + span, number - I[IDLE],
                          I[TEETH + segment], S, row, step, steps, left, Y, share, out, rows[FORCES, 0], rows[FORCES, 1],
                          first)  # fmt: skip
        if forces:
            keep_met(S, row, left, edges)
        middle_x, middle_y = 0.5 * (x + x1) + 0.125 * dt * (vx - vx1), 0.5 * (y + y1) + 0.125 * dt * (vy - vy1)
        put(Y, middle_x, middle_y, 1.5 * (x1 - x) / dt - 0.25 * (vx + vx1), 1.5 * (y1 - y) / dt - 0.25 * (vy + vy1),
            t0 + 0.5 * dt)  # fmt: skip
        keep_middle(A, P, G, Y, middle_x, middle_y, T, S, row, left, now, tooth, edges)
        for mode in range(modes.shape[0]):
            Q[mode, 0], Q[mode, 1] = Q1[mode, 0], Q1[mode, 1]
        x, y, vx, vy, fx0, fy0, now = x1, y1, vx1, vy1, fx1, fy1, 1 - now
        t0 += dt
    for edge in range(edges):
        S[row0 + 2 * steps, edge] = left[now, edge]
    return position, True


@inner
def widths_of_bench(G, I):  # noqa: E741
    """(columns of the table, numbers each, columns of the memory): one for each edge, what its angle tells; its surface."""
    teeth = 1
    for segment in range(I[SEGMENTS]):
        teeth = max(teeth, I[TEETH + segment])
    return teeth * int(G[SLICES]), T_SIZE, teeth * int(G[SLICES])


@inner
def fill_bench(G, I, bench):  # noqa: E741
    """The table of the angles, rows as in `plane_linear_kernel`."""
    row0 = 0
    for segment in range(I[SEGMENTS]):
        steps, low, high = I[STEPS + segment], G[CORNERS + segment], G[CORNERS + segment + 1]
        for row in range(2 * steps + 1):
            fill_row(G, bench[0], row0 + row, low + (high - low) * row / (2.0 * steps))
        row0 += 2 * steps + 1


@inner
def meet_front(A, P, G, I, modes, Q, E, bench, begun):  # noqa: E741
    """As that of `plane_linear_kernel`; here the feed starts, too."""
    T, S, left, tooth, Y = bench[:5]
    row0, G[T_ENTRY] = 0, begun
    for segment in range(I[SEGMENTS]):
        steps, low, high = I[STEPS + segment], G[CORNERS + segment], G[CORNERS + segment + 1]
        for row in range(row0, row0 + 2 * steps + 1):
            phase = low + (high - low) * (row - row0) / (2.0 * steps)
            first_surface(A, P, G, Y, Y, True, phase, S.shape[1] // int(G[SLICES]), begun, S[row])
            if G[SWUNG_FRONT] != 0.0:
                fill_mode_maps(modes, -(G[PITCH] - phase) / G[OMEGA], E)
                x, y = carried_on(modes, Q, E, 0)
                for edge in range(S.shape[1]):
                    S[row, edge] += x * T[row, edge, SINE] + y * T[row, edge, COSINE]
        row0 += 2 * steps + 1
