"""The fast engine for teeth of unequal pitch: a grid over the whole revolution, each tooth with a memory of its own.

A tooth meets what the one before it has left one pitch of its own before, at an angle that is no point of the grid there: it is
read by the cubic through four neighbouring rows. The grid holds the corners of all teeth and, for every tooth in the cut, the
corners of the motion one pitch before, so that what is read is smooth within four rows. A segment's first and last row are
its own: at a corner that two of them share they hold the force of either side. `turn_kernel` has the tables.
"""

import math

import numpy as np

from testbed.engines.array_kernel import copy, end_record
from testbed.engines.compiled import holding, inner
from testbed.engines.fast_kernel import (
    CUT,
    EXACT_FLIGHT,
    IDLE,
    OUTCOME_DIVERGED,
    OUTCOME_OK,
    PLAIN,
    PLAIN_COUNT,
    RING_DOWN,
    STEADY_SPEED,
    advance,
    keep_surface,
    slope,
)
from testbed.engines.glide_kernel import glide
from testbed.engines.loop_kernel import (
    ENTRY,
    FEED_SPEED,
    HELD_UNTIL,
    OMEGA,
    PITCH,
    SLICES,
    T_ENTRY,
    T_SIZE,
    force_of_edge,
    piece_of_tooth,
    weights_in_cut,
)
from testbed.engines.oscillator_kernel import set_half_and_whole
from testbed.engines.plane_kernel import bounded, position_at_cut, structure_vx, structure_x, velocity_at_cut
from testbed.engines.sampling_kernel import FORCE_X, FORCE_Y, keep_met, met_between, rows_between, sample_step, skip_held
from testbed.engines.slider_kernel import fly_exactly
from testbed.engines.turn_kernel import fill_grid, leading_angle, meet, straight_front
from testbed.system.kernel_cache import kept


@inner
def sample_uneven(A, P, G, V, clock, Y0, D0, Y1, D1, phase0, phase1, middle, where, tooth, S, row, step, steps, left, W,
                  share, out, position, stop):  # fmt: skip
    """Fill the forces of the samples from `position` to `stop`, which fall into one step; step: see `sample_forces`."""
    dt, slices = Y1[2] - Y0[2], int(G[SLICES])
    for sample in range(position, stop):
        t = clock[0] + sample / clock[1]
        u = (t - Y0[2]) / dt
        h10, h01, h11 = u * (1.0 - u) ** 2, u * u * (3.0 - 2.0 * u), u * u * (u - 1.0)
        for place in range(Y0.shape[0]):
            W[place] = (1.0 - h01) * Y0[place] + h01 * Y1[place] + dt * (h10 * D0[place] + h11 * D1[place])
        W[2] = t
        between = rows_between(u, step, steps)
        at, moving, feed = position_at_cut(A, P, W), velocity_at_cut(A, P, W), G[FEED_SPEED] * (t - G[T_ENTRY])
        force_x, force_y = 0.0, 0.0
        for one in range(V.shape[0]):
            place = where[one]
            for point in range(slices if place >= 0 else 0):
                edge = place * slices + point
                cover, turned = piece_of_tooth(G, leading_angle(V, one, phase0 + u * (phase1 - phase0), middle), point)
                theta = G[ENTRY] + turned
                sine, cosine = math.sin(theta), math.cos(theta)
                met = met_between(S, row, left, edge, steps, between)
                tangential, normal, remains = force_of_edge(A, P, G, W, at, moving, feed, cover, turned, theta, sine, cosine,
                                                            met, tooth[edge])  # fmt: skip
                force_x -= tangential * cosine + normal * sine
                force_y += tangential * sine - normal * cosine
        out[FORCE_X, sample], out[FORCE_Y, sample] = share * force_x, share * force_y


@inner
def cross_uneven(A, P, G, V, O, plain, steady, work, maps, low, span, steps, angle, first_row, teeth, where, tooth, old, T,
                 base, weight, S, M, left, clock, wanted, limit, out, position):  # fmt: skip
    """`cross_segment` of teeth of unequal pitch: what is met comes from the memory M, what is left goes there.

    angle: of the revolution's start, rad after the cut's.
    """
    Y, Y1, D0, D1, W, edges = work[0], work[1], work[2], work[3], work[4], teeth * int(G[SLICES])
    now, speed0, before = 0, 0.0, -1.0
    for step in range(steps):
        row, phase = first_row + 2 * step, low + step * span
        for ahead in range(min(5, 2 * (steps - step) + 1) if wanted else 3):
            meet(G, M, base, weight, old, row + ahead, teeth, S)
        weights = weights_in_cut(G, angle + phase, span)
        if weights[0] != before:  # else the slope at the last step's end is that at this one's start
            speed0 = slope(A, P, G, Y, D0, T, row, S, left, now, tooth, edges, weights[0])
        before = weights[2]
        speed1 = advance(A, P, G, O, plain, steady, work, maps, T, row, S, left, now, tooth, edges, span, speed0, weights)
        if not bounded(P, Y1, limit):
            return position, False
        begun = position
        position = sample_step(A, P, G, clock, Y, D0, Y1, D1, angle + phase, angle + phase + span, speed0, speed1, out,
                               position)  # fmt: skip
        if wanted:
            sample_uneven(A, P, G, V, clock, Y, D0, Y1, D1, phase, phase + span, low + 0.5 * steps * span, where, tooth, S, row,
                          step, steps, left, W, (weights[0] + 4.0 * weights[1] + weights[2]) / 6.0, out, begun,
                          position)  # fmt: skip
            keep_met(S, row, left, edges)
        keep_surface(A, P, G, Y, D0, Y1, D1, (span / speed0, span / speed1), W, T, S, row, left, now, tooth, edges)
        for edge in range(edges):
            M[row, edge], M[row + 1, edge], M[row + 2, edge] = S[row, edge], S[row + 1, edge], left[1 - now, edge]
        for i in range(Y.shape[0]):
            Y[i], D0[i] = Y1[i], D1[i]
        speed0, now = speed1, 1 - now
    return position, True


@holding
def run_one_uneven(A, P, G, I, O, Y, C, steps, firsts, V, durations, clock, wanted, limit, out, pass_times,
               pass_states):  # fmt: skip
    """`run_one` of teeth of unequal pitch; a pass is a mean pitch.

    C (segments + 1,): corners of the revolution, rad; steps (segments,); firsts (flutes + 1,): the first segment of each pass.
    """
    segments, slices = steps.shape[0], int(G[SLICES])
    rows, count = np.zeros(segments, np.int64), 0
    for segment in range(segments):
        rows[segment] = count
        count += 2 * steps[segment] + 1
    edges = V.shape[0] * slices
    teeth, where = np.zeros(segments, np.int64), np.zeros((segments, V.shape[0]), np.int64)
    T, tooth = np.zeros((count, edges, T_SIZE)), np.zeros((segments, edges))
    base, weight = np.zeros((count, V.shape[0]), np.int64), np.zeros((count, V.shape[0], 4))
    S, M, left, old = np.zeros((count, edges)), np.zeros((count, edges)), np.zeros((6, edges)), np.zeros_like(base)
    fill_grid(G, C, V, steps, rows, teeth, where, T, base, old, weight, tooth)
    work, maps = np.zeros((11, Y.shape[0])), np.zeros((segments + 1, 2, O.shape[0], 4))
    copy(Y, work[0])
    copy(Y, work[10])
    Y, plain, steady = work[0], I[PLAIN : PLAIN + I[PLAIN_COUNT]], I[STEADY_SPEED] != 0
    position, start = skip_held(G, clock, out), Y[2]
    pass_times[0], pass_states[0, 0], pass_states[0, 1] = Y[2], structure_x(P, Y), structure_vx(P, Y)
    last = I[IDLE] + I[CUT] + I[RING_DOWN] + 1
    for number in range(last - 1):
        pass_number = number - I[IDLE]
        cutting, part = 0 <= pass_number < I[CUT], pass_number % V.shape[0]
        angle = (pass_number - part) * G[PITCH]
        if durations.shape[0] > 0:
            G[OMEGA] = G[PITCH] / durations[number]
        if steady and (number == 0 or durations.shape[0] > 0):
            for segment in range(segments):
                set_half_and_whole(O, (C[segment + 1] - C[segment]) / steps[segment] / G[OMEGA], maps[segment, 0],
                                   maps[segment, 1])  # fmt: skip
        if pass_number == 0 and I[CUT] > 0:
            G[T_ENTRY], G[HELD_UNTIL] = Y[2], min(G[HELD_UNTIL], Y[2])
            straight_front(A, P, G, C, steps, rows, teeth, tooth, old, T, base, weight, Y, steady, work[4], S, M)
        within = True
        for segment in range(firsts[part], firsts[part + 1]):
            low, whole = C[segment], C[segment + 1] - C[segment]
            span = whole / steps[segment]
            if cutting and teeth[segment] > 0:
                position, within = cross_uneven(A, P, G, V, O, plain, steady, work, maps[segment], low, span, steps[segment],
                                                angle, rows[segment], teeth[segment], where[segment], tooth[segment],
                                                old, T, base, weight, S, M, left, clock, wanted, limit, out,
                                                position)  # fmt: skip
            elif I[EXACT_FLIGHT] and steady and Y[2] >= G[HELD_UNTIL]:
                position = fly_exactly(A, P, G, O, clock, Y, whole / G[OMEGA], angle + low, whole, G[OMEGA], G[OMEGA], work[4],
                                       work[5], maps[segments, 0], out, position)  # fmt: skip
            else:
                position, within = glide(A, P, G, O, plain, steady, work, maps[segment], low, span, steps[segment], angle,
                                         clock, limit, out, position)  # fmt: skip
            if not within:
                break
        if not within:
            last = number + 1
            break
        if durations.shape[0] > 0:
            Y[2] = pass_times[number] + durations[number]
        elif steady:  # the clock does not gather rounding
            Y[2] = start + (number + 1) * G[PITCH] / G[OMEGA]
        pass_times[number + 1] = Y[2]
        pass_states[number + 1, 0], pass_states[number + 1, 1] = structure_x(P, Y), structure_vx(P, Y)
    end_record(out, pass_times, pass_states, position, last)
    if last <= I[IDLE] + I[CUT] + I[RING_DOWN]:
        return OUTCOME_DIVERGED, Y[2]
    return OUTCOME_OK, np.nan


@kept(nogil=True)
def run_uneven(A, P, G, I, O, Y, C, steps, firsts, V, durations, clock, wanted, limit, out, pass_times,
               pass_states):  # fmt: skip
    """`run_one_uneven`, as an entry."""
    return run_one_uneven(A, P, G, I, O, Y, C, steps, firsts, V, durations, clock, wanted, limit, out, pass_times, pass_states)
