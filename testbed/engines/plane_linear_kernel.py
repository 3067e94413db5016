"""The fast engine of any number of modes in the plane where no effect touches the loop: the force is linear in the chip.

    m_j (q_j'' + 2 zeta_j omega_j q_j' + omega_j^2 q_j) = s_j . F
    F = -kappa(phase) [h + r(t) - r(t - tau)],    r = sum of s_j q_j

Same scheme, grid and samples as the general kernel. All edges in the cut together are the 2 x 2 table kappa; what is
remembered of the surface is r at the grid's points, one tooth pass back. `modes` and Q are those of `modes_kernel`.
"""

import math

import numpy as np

from testbed.engines.array_kernel import fill, fill_columns, fill_rows
from testbed.engines.compiled import holding, inner
from testbed.engines.fast_kernel import CUT, IDLE, OUTCOME_DIVERGED, OUTCOME_OK, RING_DOWN, SEGMENTS, STEPS, TEETH
from testbed.engines.loop_kernel import (
    CORNERS,
    ENTRY,
    FEED,
    HELD_UNTIL,
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
    carry_modes,
    compliance,
    fill_mode_maps,
    in_the_plane,
    sample_free_modes,
    sample_modes,
)
from testbed.engines.plane_kernel import MODE_MASS, SHAPE_X, SHAPE_Y
from testbed.engines.sampling_kernel import skip_held
from testbed.system.kernel_cache import kept

XX, XY, YX, YY = range(4)  # places in a row of kappa, N/m: the force along the first under a chip along the second


@inner
def fill_chip_stiffness(G, phase, teeth, kappa, row):
    """The row of kappa at one phase of the tooth pitch."""
    for place in range(4):
        kappa[row, place] = 0.0
    for edge in range(teeth * int(G[SLICES])):
        cover, turned = piece_of_edge(G, phase, edge)
        sine, cosine = math.sin(G[ENTRY] + turned), math.cos(G[ENTRY] + turned)
        along = G[SLICE_DEPTH] * cover * (G[KT] * cosine + G[KN] * sine)
        across = G[SLICE_DEPTH] * cover * (G[KN] * cosine - G[KT] * sine)
        kappa[row, XX] += along * sine
        kappa[row, XY] += along * cosine
        kappa[row, YX] += across * sine
        kappa[row, YY] += across * cosine


@inner
def chip_force(kappa, row, memory, x, y, weight):
    """(F_x, F_y) on the workpiece, N, at a row of the grid with the workpiece at (x, y); x: the feed of a tooth included, m."""
    dx, dy = x - memory[row, 0], y - memory[row, 1]
    return -weight * (kappa[row, XX] * dx + kappa[row, XY] * dy), -weight * (kappa[row, YX] * dx + kappa[row, YY] * dy)


@inner
def step_modes(modes, kappa, memory, row, dt, weights, feed, E, F, spread, Q, Q1, x, y):
    """One step in the cut from Q, which is at (x, y), to Q1. Returns (x, y, force at its start, and at its end) of that."""
    x1, y1 = chip_force(kappa, row, memory, feed + x, y, weights[0])
    half_x, half_y = carried_on(modes, Q, F)
    kick_x, kick_y = spread[0] * x1 + spread[1] * y1, spread[1] * x1 + spread[2] * y1
    x2, y2 = chip_force(kappa, row + 1, memory, feed + half_x + 0.5 * dt * kick_x, half_y + 0.5 * dt * kick_y, weights[1])
    x3, y3 = chip_force(kappa, row + 1, memory, feed + half_x, half_y, weights[1])
    whole_x, whole_y = carried_on(modes, Q, E)
    kick_x, kick_y = spread[0] * x3 + spread[1] * y3, spread[1] * x3 + spread[2] * y3
    x4, y4 = chip_force(kappa, row + 2, memory, feed + whole_x + dt * kick_x, whole_y + dt * kick_y, weights[2])
    middle_x, middle_y = 2.0 * (x2 + x3), 2.0 * (y2 + y3)
    end_x, end_y = 0.0, 0.0
    for mode in range(modes.shape[0]):
        along, across, part = modes[mode, SHAPE_X], modes[mode, SHAPE_Y], dt / (6.0 * modes[mode, MODE_MASS])
        first, middle, last = along * x1 + across * y1, along * middle_x + across * middle_y, along * x4 + across * y4
        q, r = Q[mode, 0], Q[mode, 1]
        Q1[mode, 0] = E[mode, 0] * q + E[mode, 1] * r + part * (E[mode, 1] * first + F[mode, 1] * middle)
        Q1[mode, 1] = E[mode, 2] * q + E[mode, 3] * r + part * (E[mode, 3] * first + F[mode, 3] * middle + last)
        end_x += along * Q1[mode, 0]
        end_y += across * Q1[mode, 0]
    x4, y4 = chip_force(kappa, row + 2, memory, feed + end_x, end_y, weights[2])
    return end_x, end_y, x1, y1, x4, y4


@inner
def cross_modes(G, modes, kappa, memory, row0, steps, dt, angle, span, E, F, work, rows, clock, t0, limit, out, position, left):
    """Step through one segment in the cut from row0 of kappa and memory on. left (2,): r at its start, and then at its end.

    work (2, modes, 2): the state, and scratch. angle: at its start, rad after the first pass's; span: of a step, rad.
    Returns (next sample, still bounded).
    """
    Q, Q1, feed, spread = work[0], work[1], G[FEED], compliance(modes, F)
    x, y = in_the_plane(modes, Q, 0)
    vx, vy = in_the_plane(modes, Q, 1)
    for step in range(steps):
        row, weights = row0 + 2 * step, weights_in_cut(G, angle + step * span, span)
        x1, y1, fx0, fy0, fx1, fy1 = step_modes(modes, kappa, memory, row, dt, weights, feed, E, F, spread, Q, Q1, x, y)
        if not (abs(x1) < limit and abs(y1) < limit):
            return position, False
        position = sample_modes(modes, rows, clock, t0, dt, Q, Q1, fx0, fy0, fx1, fy1, out, position)
        vx1, vy1 = in_the_plane(modes, Q1, 1)
        memory[row, 0], memory[row, 1] = left[0], left[1]
        memory[row + 1, 0] = 0.5 * (x + x1) + 0.125 * dt * (vx - vx1)
        memory[row + 1, 1] = 0.5 * (y + y1) + 0.125 * dt * (vy - vy1)
        left[0], left[1] = x1, y1
        for mode in range(modes.shape[0]):
            Q[mode, 0], Q[mode, 1] = Q1[mode, 0], Q1[mode, 1]
        x, y, vx, vy = x1, y1, vx1, vy1
        t0 += dt
    memory[row0 + 2 * steps, 0], memory[row0 + 2 * steps, 1] = left[0], left[1]
    return position, True


@inner
def fill_swing_of_modes(G, I, modes, Q, E, memory):  # noqa: E741
    """Into the memory what the structure's swing left one pitch before it came to Q, where the first tooth enters."""
    row0 = 0
    for segment in range(I[SEGMENTS]):
        steps, low, high = I[STEPS + segment], G[CORNERS + segment], G[CORNERS + segment + 1]
        for row in range(2 * steps + 1 if I[TEETH + segment] > 0 else 0):
            phase = low + (high - low) * row / (2.0 * steps)
            fill_mode_maps(modes, -(G[PITCH] - phase) / G[OMEGA], E)
            memory[row0 + row, 0], memory[row0 + row, 1] = carried_on(modes, Q, E)
        row0 += 2 * steps + 1


@inner
def pass_in_cut(G, I, modes, kappa, memory, left, maps, work, free, rows, clock, t0, angle, limit, out, position):  # noqa: E741
    """One tooth pass in the cut; maps (segments, 3, modes, 4): over a step, half of it, the segment. (next sample, bounded)."""
    row0 = np.int64(0)  # a literal 0 would be compiled for as a type of its own
    left[0], left[1] = in_the_plane(modes, work[0], 0)
    for segment in range(I[SEGMENTS]):
        steps, base = I[STEPS + segment], G[CORNERS + segment]
        span = G[CORNERS + segment + 1] - base
        duration = span / G[OMEGA]
        if I[TEETH + segment] == 0:
            position = sample_free_modes(modes, rows, clock, t0, duration, work[0], work[1], free, out, position)
            carry_modes(work[0], maps[segment, 2])
            left[0], left[1] = in_the_plane(modes, work[0], 0)
        else:
            position, bounded = cross_modes(G, modes, kappa, memory, row0, steps, duration / steps, angle + base, span / steps,
                                            maps[segment, 0], maps[segment, 1], work, rows, clock, t0, limit, out, position,
                                            left)  # fmt: skip
            if not bounded:
                return position, False
        row0 += 2 * steps + 1
        t0 += duration
    return position, True


@inner
def keep_motion(modes, Q, pass_states, number):
    """The motion along the feed at the start of a pass, into its row."""
    pass_states[number, 0], pass_states[number, 1] = in_the_plane(modes, Q, 0)[0], in_the_plane(modes, Q, 1)[0]


@holding
def run_plane_linear(G, I, modes, Q, Y, rows, clock, limit, out, pass_times, pass_states):  # noqa: E741
    """As the general kernel's run_one, for the base model in the plane. Forces and angle are not sampled.

    Of Y the clock counts. rows: see `sample_modes`.
    """
    many, tau, size = modes.shape[0], G[PITCH] / G[OMEGA], 0
    for segment in range(I[SEGMENTS]):
        size += 2 * I[STEPS + segment] + 1  # a corner belongs to two segments: the force jumps there
    kappa, memory, left, maps = np.zeros((size, 4)), np.zeros((size, 2)), np.zeros(2), np.empty((I[SEGMENTS], 3, many, 4))
    whole, free, work = np.empty((many, 4)), np.empty((many, 4)), np.empty((2, many, 2))
    row0 = 0
    for segment in range(I[SEGMENTS]):
        steps, low, high = I[STEPS + segment], G[CORNERS + segment], G[CORNERS + segment + 1]
        duration = (high - low) / G[OMEGA]
        fill_mode_maps(modes, duration / steps, maps[segment, 0])
        fill_mode_maps(modes, 0.5 * duration / steps, maps[segment, 1])
        fill_mode_maps(modes, duration, maps[segment, 2])
        for row in range(2 * steps + 1 if I[TEETH + segment] > 0 else 0):
            fill_chip_stiffness(G, low + (high - low) * row / (2.0 * steps), I[TEETH + segment], kappa, row0 + row)
        row0 += 2 * steps + 1
    fill_mode_maps(modes, tau, whole)
    for mode in range(many):
        work[0, mode, 0], work[0, mode, 1] = Q[mode, 0], Q[mode, 1]
    position = skip_held(G, clock, out)
    pass_times[0] = Y[2]
    keep_motion(modes, work[0], pass_states, 0)
    for number in range(I[IDLE] + I[CUT] + I[RING_DOWN]):
        t0 = Y[2] + number * tau
        if number < I[IDLE] and t0 < G[HELD_UNTIL]:
            begin = G[HELD_UNTIL]
            if begin < t0 + tau:
                position = sample_free_modes(modes, rows, clock, begin, t0 + tau - begin, work[0], work[1], free, out, position)
                fill_mode_maps(modes, t0 + tau - begin, free)
                carry_modes(work[0], free)
        elif not (I[IDLE] <= number < I[IDLE] + I[CUT]):
            position = sample_free_modes(modes, rows, clock, t0, tau, work[0], work[1], free, out, position)
            carry_modes(work[0], whole)
        else:
            if number == I[IDLE] and G[SWUNG_FRONT] != 0.0:
                fill_swing_of_modes(G, I, modes, work[0], free, memory)
            position, bounded = pass_in_cut(G, I, modes, kappa, memory, left, maps, work, free, rows, clock, t0,
                                            (number - I[IDLE]) * G[PITCH], limit, out, position)  # fmt: skip
            if not bounded:
                fill_columns(out, position, np.nan)
                fill(pass_times, number + 1, np.nan)
                fill_rows(pass_states, number + 1, np.nan)
                return OUTCOME_DIVERGED, t0
        pass_times[number + 1] = Y[2] + (number + 1) * tau
        keep_motion(modes, work[0], pass_states, number + 1)
    last = I[IDLE] + I[CUT] + I[RING_DOWN] + 1
    fill_columns(out, position, np.nan)
    fill(pass_times, last, np.nan)
    fill_rows(pass_states, last, np.nan)
    return OUTCOME_OK, np.nan


@kept(nogil=True)
def run_plane_linear_batch(G, I, modes, counts, Q, Y, rows, clock, limit, out, pass_times, pass_states, outcome,  # noqa: E741
                           outcome_time):  # fmt: skip
    """run_plane_linear over the first axis of every array but `rows`; counts (runs,): how many modes are a run's."""
    for run in range(G.shape[0]):
        outcome[run], outcome_time[run] = run_plane_linear(
            G[run], I[run], modes[run, : counts[run]], Q[run, : counts[run]], Y[run], rows, clock[run], limit, out[run],
            pass_times[run], pass_states[run])  # fmt: skip
