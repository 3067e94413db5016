"""The fast engine's integration: fourth order in the spindle angle, on a grid that holds every corner of the force.

A tooth pitch is cut into segments at the angles where an edge enters or leaves; each has equal steps in angle, so all that
depends on the angle alone (sines, the share of an edge in the cut) is a table made once a run. The scheme is Lawson's
exponential Runge-Kutta (`oscillator_kernel`): the structure and what else is an oscillator are carried by their exact maps
and only the rest is integrated. At a varying speed the maps are those of the speed at the step's start. Where no tooth cuts
and nothing but oscillators moves, one exact map replaces the steps; beside a spring and slider, one map an event.
"""

import numpy as np

from testbed.engines.array_kernel import copy, end_record
from testbed.engines.compiled import holding, inner
from testbed.engines.front_kernel import first_surface
from testbed.engines.glide_kernel import glide
from testbed.engines.hooks import hook_chip
from testbed.engines.loop_kernel import (
    CORNERS,
    COSINE,
    FEED_SPEED,
    FLUTES,
    HELD_UNTIL,
    OMEGA,
    PITCH,
    SINE,
    SLICES,
    T_ENTRY,
    T_SIZE,
    THETA,
    derivative,
    fill_row,
    force_at_row,
    radius_of_edge,
    spindle_speed,
    weights_in_cut,
)
from testbed.engines.oscillator_kernel import end_state, increment, set_half_and_whole, stage_state
from testbed.engines.plane_kernel import bounded, position_at_cut, structure_vx, structure_x, velocity_at_cut
from testbed.engines.sampling_kernel import FORCE_X, FORCE_Y, keep_met, sample_forces, sample_step, skip_held
from testbed.engines.slider_kernel import fly_exactly
from testbed.system.kernel_cache import kept

# integer settings of one run; STEPS and TEETH hold one number a segment, PLAIN the places of the states not carried exactly
IDLE, CUT, RING_DOWN, EXACT_FLIGHT, STEADY_SPEED, SEGMENTS, CARRIED, PLAIN_COUNT, STEPS, TEETH, PLAIN = (*range(9), 12, 16)
OUTCOME_OK, OUTCOME_DIVERGED = 0, 1


@inner
def row_phase(G, I, row):
    """Phase of a row of the grid: rows 2k are the steps' ends, rows between their middles."""
    first = 0
    for segment in range(I[SEGMENTS]):
        steps = I[STEPS + segment]
        if row <= first + 2 * steps:
            low, high = G[CORNERS + segment], G[CORNERS + segment + 1]
            return low + (high - low) * (row - first) / (2.0 * steps)
        first += 2 * steps
    return G[PITCH]


@inner
def fill_table(G, I, T):
    """`fill_row` of every row."""
    for row in range(T.shape[0]):
        fill_row(G, T, row, row_phase(G, I, row))


@inner
def slope(A, P, G, Y, D, T, row, S, left, left_row, tooth, edges, weight):
    """Time derivative D of the state at a row; left[left_row]: the surface left there. Returns the spindle speed.

    weight: what the force counts, see `weights_in_cut`.
    """
    at, moving = position_at_cut(A, P, Y), velocity_at_cut(A, P, Y)
    force, across, torque = force_at_row(A, P, G, Y, at, moving, T, row, S, left, left_row, tooth, edges)
    derivative(A, P, G, Y, D, weight * force, weight * across, weight * torque)
    return spindle_speed(A, P, G, Y)


@inner
def fly(A, P, G, I, O, Y, given, W, D, E, clock, segment, angle, out, position):
    """Cross a segment in which nothing cuts and all is carried exactly; return the next sample.

    given: the state with which it is let go, if it is held until some time within.
    """
    span = G[CORNERS + segment + 1] - G[CORNERS + segment]
    parts = 1 if I[STEADY_SPEED] else I[STEPS + segment]
    turn = span / parts
    for part in range(parts):
        w0 = spindle_speed(A, P, G, Y)
        w1 = w0
        dt = turn / w0
        if not I[STEADY_SPEED]:  # only the time it takes is integrated
            copy(Y, W)
            W[2] = Y[2] + 0.5 * dt
            k2 = turn / spindle_speed(A, P, G, W)
            W[2] = Y[2] + 0.5 * k2
            k3 = turn / spindle_speed(A, P, G, W)
            W[2] = Y[2] + k3
            k4 = turn / spindle_speed(A, P, G, W)
            dt = (dt + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
            W[2] = Y[2] + dt
            w1 = spindle_speed(A, P, G, W)
        held = 0.0
        if Y[2] < G[HELD_UNTIL]:
            held = min(1.0, (G[HELD_UNTIL] - Y[2]) / dt)
            let_go = Y[2] + held * dt
            copy(given, Y)
            Y[2] = let_go
        if held < 1.0:
            free, first = 1.0 - held, w0 + held * (w1 - w0)
            position = fly_exactly(A, P, G, O, clock, Y, free * dt, angle + (part + held) * turn, free * turn, first, w1, W, D,
                                   E, out, position)  # fmt: skip
    return position


@inner
def keep_surface(A, P, G, Y, D0, Y1, D1, ends, W, T, S, row, left, now, tooth, edges):
    """What the step leaves at its start (left[now]) and, by the cubic in the angle, at its middle: into S.

    ends: (span over the speed) at both ends. The row at the step's end is still to be read by the next step.
    """
    for i in range(Y.shape[0]):
        W[i] = 0.5 * (Y[i] + Y1[i]) + 0.125 * (D0[i] * ends[0] - D1[i] * ends[1])
    x, y = position_at_cut(A, P, W)
    keep_middle(A, P, G, W, x, y, T, S, row, left, now, tooth, edges)


@inner
def keep_middle(A, P, G, W, x, y, T, S, row, left, now, tooth, edges):
    """`keep_surface` where the state at the step's middle is W, and the workpiece at (x, y)."""
    x += G[FEED_SPEED] * (W[2] - G[T_ENTRY])
    for edge in range(edges):
        met = S[row + 1, edge]
        radial = radius_of_edge(A, P, G, W, x, y, T[row + 1, edge, THETA], T[row + 1, edge, SINE], T[row + 1, edge, COSINE],
                                tooth[edge])  # fmt: skip
        chip = hook_chip(A, P, radial - met)
        S[row, edge] = left[now, edge]
        S[row + 1, edge] = radial if chip == radial - met else met + chip


@inner
def advance(A, P, G, O, plain, steady, work, maps, T, row, S, left, now, tooth, edges, span, speed0, weights):
    """One step of `span` rad from work[0] to work[1]; work[2] and speed0 belong to its start. Returns the speed at its end.

    weights: those of the force, see `weights_in_cut`.
    work (11, size): the state and that at the end, their slopes, state and slope of a stage, what the four stages add, and the
    state that is given to begin with.
    """
    Y, Y1, D0, D1, W, D, K = work[0], work[1], work[2], work[3], work[4], work[5], work[6:10]
    H, E = maps[0], maps[1]
    more = O.shape[0] > 1 or plain.shape[0] > 0
    h = span / speed0
    if not steady:
        set_half_and_whole(O, h, H, E)
    increment(O, plain, more, Y, D0, h, h, K, 0)
    speed = speed0
    for stage in range(1, 5):  # the fourth is the end of the step, whose slope begins the next
        at, rates = (Y1, D1) if stage == 4 else (W, D)
        if stage == 4:
            end_state(O, plain, more, H, E, Y, K, at)
        else:
            stage_state(O, plain, more, H, E, Y, K, stage, at)
        speed = slope(A, P, G, at, rates, T, row + (1 if stage < 3 else 2), S, left, 1 - now if stage == 4 else 2, tooth, edges,
                      weights[1] if stage < 3 else weights[2])  # fmt: skip
        if stage < 4:
            increment(O, plain, more, at, rates, span / speed, h, K, stage)
    return speed


@inner
def cross_segment(A, P, G, I, O, T, S, row0, segment, angle, pass_number, maps, work, left, tooth, clock, wanted, limit, out,
                  position):  # fmt: skip
    """Step through one segment of a pass, reading the surface S and leaving a new one behind.

    Row 2k of S is the surface at step k, row 2k + 1 at its middle. What was left at a step's end waits in left[0].
    Returns (next sample, still bounded).
    """
    Y, Y1, D0, D1, W = work[0], work[1], work[2], work[3], work[4]
    plain = I[PLAIN : PLAIN + I[PLAIN_COUNT]]
    steps, teeth, steady = I[STEPS + segment], I[TEETH + segment], I[STEADY_SPEED] != 0
    if not 0 <= pass_number < I[CUT]:
        teeth = 0
    edges, base = teeth * int(G[SLICES]), G[CORNERS + segment]
    span = (G[CORNERS + segment + 1] - base) / steps
    if edges == 0:
        return glide(A, P, G, O, plain, steady, work, maps[segment], base, span, steps, angle, clock, limit, out, position)
    now, speed0, before = 0, 0.0, -1.0
    for step in range(steps):
        row, phase = row0 + 2 * step, base + step * span
        weights = weights_in_cut(G, angle + phase, span)
        if weights[0] != before:  # else the slope at the last step's end is that at this one's start
            speed0 = slope(A, P, G, Y, D0, T, row, S, left, now, tooth, edges, weights[0])
        before = weights[2]
        speed1 = advance(A, P, G, O, plain, steady, work, maps[segment], T, row, S, left, now, tooth, edges, span, speed0,
                         weights)  # fmt: skip
        if not bounded(P, Y1, limit):
            return position, False
        if position < out.shape[1] and clock[0] + position / clock[1] <= Y1[2]:
            first = position
            position = sample_step(A, P, G, clock, Y, D0, Y1, D1, angle + phase, angle + phase + span, speed0, speed1, out,
                                   position)  # fmt: skip
            if wanted:
                share = (weights[0] + 4.0 * weights[1] + weights[2]) / 6.0
                sample_forces(A, P, G, clock, Y, D0, Y1, D1, phase, phase + span, pass_number, teeth, S, row, step, steps, left,
                              W, share, out, FORCE_X, FORCE_Y, first)  # fmt: skip
        if wanted:
            keep_met(S, row, left, edges)
        keep_surface(A, P, G, Y, D0, Y1, D1, (span / speed0, span / speed1), W, T, S, row, left, now, tooth, edges)
        for i in range(Y.shape[0]):
            Y[i], D0[i] = Y1[i], D1[i]
        speed0, now = speed1, 1 - now
    if now == 1:
        copy(left[1], left[0])
    return position, True


@inner
def enter_cut(A, P, G, I, Y, W, S):
    """The first tooth enters: the feed starts, and there is a surface that it meets."""
    G[T_ENTRY] = Y[2]
    G[HELD_UNTIL] = min(G[HELD_UNTIL], Y[2])  # whatever the speed was, it is let go by now
    for row in range(S.shape[0]):
        first_surface(A, P, G, W, Y, I[STEADY_SPEED] != 0, row_phase(G, I, row), S.shape[1] // int(G[SLICES]), Y[2], S[row])


@inner
def cross_pitch(A, P, G, I, O, T, S, pass_number, maps, work, left, tooth, clock, wanted, limit, out, position):
    """One tooth pass, segment by segment. Returns (next sample, still bounded)."""
    row0, angle = np.int64(0), pass_number * G[PITCH]  # a literal 0 would be compiled for as a type of its own
    cutting = 0 <= pass_number < I[CUT]
    for segment in range(I[SEGMENTS]):
        base, last = G[CORNERS + segment], row0 + 2 * I[STEPS + segment]
        if I[EXACT_FLIGHT] and not (cutting and I[TEETH + segment] > 0):
            position = fly(A, P, G, I, O, work[0], work[10], work[4], work[5], maps[I[SEGMENTS], 0], clock, segment,
                           angle + base, out, position)  # fmt: skip
        else:
            position, within = cross_segment(A, P, G, I, O, T, S, row0, segment, angle, pass_number, maps, work, left, tooth,
                                             clock, wanted, limit, out, position)  # fmt: skip
            if not within:
                return position, False
            staying = I[TEETH + segment + 1] if segment + 1 < I[SEGMENTS] else 0
            if cutting:  # what the teeth that leave here have left; the others' the next segment's first step keeps
                for edge in range(staying * int(G[SLICES]), I[TEETH + segment] * int(G[SLICES])):
                    S[last, edge] = left[0, edge]
        row0 = last
    return position, True


@holding
def run_one(A, P, G, I, O, Y, durations, clock, wanted, limit, out, pass_times, pass_states):
    """Integrate one test. Y is the state at time 0, or when the structure is let go.

    durations (passes,) are the measured times of the tooth passes, or empty at the nominal speed. out (channels, samples),
    pass_times (passes + 1,) and pass_states (passes + 1, 2) are filled; samples before it is let go are NaN; a diverged run
    leaves NaN behind the point where it stopped. wanted: the forces are sampled too. Returns (outcome, time it stopped).
    """
    rows, teeth = 1, 1
    for segment in range(I[SEGMENTS]):
        rows += 2 * I[STEPS + segment]
        teeth = max(teeth, I[TEETH + segment])
    edges = teeth * int(G[SLICES])
    T, S, left = np.zeros((rows, edges, T_SIZE)), np.zeros((rows, edges)), np.zeros((6, edges))
    tooth = np.zeros(edges, np.int64)
    work, maps = np.zeros((11, Y.shape[0])), np.zeros((I[SEGMENTS] + 1, 2, O.shape[0], 4))
    copy(Y, work[0])
    copy(Y, work[10])
    Y = work[0]
    fill_table(G, I, T)
    position, start = skip_held(G, clock, out), Y[2]
    pass_times[0], pass_states[0, 0], pass_states[0, 1] = Y[2], structure_x(P, Y), structure_vx(P, Y)
    for number in range(I[IDLE] + I[CUT] + I[RING_DOWN]):
        pass_number = number - I[IDLE]
        if durations.shape[0] > 0:
            G[OMEGA] = G[PITCH] / durations[number]
        if I[STEADY_SPEED] and (number == 0 or durations.shape[0] > 0):
            for segment in range(I[SEGMENTS]):
                span = (G[CORNERS + segment + 1] - G[CORNERS + segment]) / I[STEPS + segment]
                set_half_and_whole(O, span / G[OMEGA], maps[segment, 0], maps[segment, 1])
        for edge in range(edges):
            tooth[edge] = (number - edge // int(G[SLICES])) % int(G[FLUTES])
        if pass_number == 0 and I[CUT] > 0:
            enter_cut(A, P, G, I, Y, work[4], S)
        position, within = cross_pitch(A, P, G, I, O, T, S, pass_number, maps, work, left, tooth, clock, wanted, limit, out,
                                        position)  # fmt: skip
        if not within:
            end_record(out, pass_times, pass_states, position, number + 1)
            return OUTCOME_DIVERGED, Y[2]
        if durations.shape[0] > 0:
            Y[2] = pass_times[number] + durations[number]
        elif I[STEADY_SPEED]:  # the clock does not gather rounding
            Y[2] = start + (number + 1) * G[PITCH] / G[OMEGA]
        pass_times[number + 1] = Y[2]
        pass_states[number + 1, 0], pass_states[number + 1, 1] = structure_x(P, Y), structure_vx(P, Y)
    end_record(out, pass_times, pass_states, position, I[IDLE] + I[CUT] + I[RING_DOWN] + 1)
    return OUTCOME_OK, np.nan


@kept(nogil=True)
def run_batch(A, P, G, I, O, Y, durations, clock, wanted, limit, out, pass_times, pass_states, outcome, outcome_time):
    """run_one over the first axis of every array."""
    for run in range(G.shape[0]):
        outcome[run], outcome_time[run] = run_one(
            A[run], P[run], G[run], I[run], O[run, : I[run, CARRIED]], Y[run], durations[run], clock[run], wanted, limit,
            out[run], pass_times[run], pass_states[run])  # fmt: skip
