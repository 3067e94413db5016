"""Samples at the recording's rate: within a step by the quintic through displacement, velocity and acceleration at both
ends, in free flight by the exact map. `out` holds the first channel alone, or the first three: the motion along the feed of
a sensor on the workpiece, or the first six, or all: the motion across the feed too, and what a sensor on the tool sees."""

import numpy as np

from testbed.engines.array_kernel import copy
from testbed.engines.compiled import inner
from testbed.engines.hooks import PLANAR, hook_sensed_displacement, hook_sensed_velocity
from testbed.engines.loop_kernel import HELD_UNTIL, SLICES, cutting_force
from testbed.engines.oscillator_kernel import add_course, carry, free_slope, oscillator_map, set_maps
from testbed.engines.plane_kernel import (
    COUNT,
    FIRST_MODE,
    MODE_DAMPING,
    MODE_MASS,
    MODE_SIZE,
    MODE_STIFFNESS,
    ON_TOOL,
    mode_place,
    sensed,
    sensed_across,
    sensed_on_tool,
)

SENSED_X, SENSED_V, SENSED_A, FORCE_X, FORCE_Y, ANGLE, N_CHANNELS = range(7)
N_MOTION = 3  # the first of them
CLOCK = 2  # numbers of a clock; behind them, where the structure's own motion is all that is asked for, 1 or 0 for each row
ACROSS, TOOL_X, TOOL_Y, N_PLANE = 6, 9, 12, 15  # each the first of displacement, velocity, acceleration


@inner
def samples_until(start, rate, end, position, count):
    """The first sample from `position` on that lies behind the time `end`, or `count`."""
    found = min(count, max(position, int((end - start) * rate) + 2))
    while found > position and start + (found - 1) / rate > end:  # the same comparison as everywhere else decides
        found -= 1
    return found


@inner
def skip_held(G, clock, out):
    """Fill the samples before the structure is let go, of which nothing is known; return the next."""
    position = np.int64(0)  # a literal 0 would be compiled for as a type of its own
    while position < out.shape[1] and clock[0] + position / clock[1] < G[HELD_UNTIL]:
        for row in range(out.shape[0]):
            out[row, position] = np.nan
        position += 1
    return position


@inner
def quintic(u, dt, x0, v0, a0, x1, v1, a1):
    """(displacement, velocity, acceleration) at the share u of a step of dt, from those at its ends."""
    rise = (x1 - x0) / dt - v0 - 0.5 * a0 * dt  # what the three powers above the second must make up
    gain = v1 - v0 - a0 * dt
    bend = (a1 - a0) * dt
    c3 = 10.0 * rise - 4.0 * gain + 0.5 * bend
    c4 = -15.0 * rise + 7.0 * gain - bend
    c5 = 6.0 * rise - 3.0 * gain + 0.5 * bend
    return (x0 + dt * u * (v0 + u * (0.5 * a0 * dt + u * (c3 + u * (c4 + u * c5)))),
            v0 + u * (a0 * dt + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5))),
            a0 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5)) / dt)  # fmt: skip


@inner
def fill_quintic(out, row, position, u, dt, x0, v0, a0, x1, v1, a1):
    """One sample of displacement, velocity and acceleration, from `row` on, at the share u of a step of dt."""
    moved, rising, bent = quintic(u, dt, x0, v0, a0, x1, v1, a1)
    out[row, position] = moved
    if out.shape[0] > 1:
        out[row + 1, position], out[row + 2, position] = rising, bent


@inner
def angle_between(u, dt, angle0, angle1, w0, w1):
    """Spindle angle at the share u of a step of dt, by the cubic through angle and speed at both ends, rad."""
    h01 = u * u * (3.0 - 2.0 * u)
    return angle0 + h01 * (angle1 - angle0) + dt * u * (1.0 - u) * ((1.0 - u) * w0 - u * w1)


@inner
def wanted(clock, row):
    """Whether anybody asks for a row of `out`: any but some motions of the structure alone, see CLOCK."""
    return clock.shape[0] == CLOCK or clock[CLOCK + row] != 0.0


@inner
def sample_plane(A, P, clock, Y0, D0, Y1, D1, out, position, stop):
    """The samples from `position` to `stop` of one step, across the feed and on the tool."""
    dt = Y1[2] - Y0[2]
    for row in (ACROSS, TOOL_X, TOOL_Y):
        if wanted(clock, row) or wanted(clock, row + 1) or wanted(clock, row + 2):
            if row == ACROSS:
                (x0, v0, a0), (x1, v1, a1) = sensed_across(A, P, Y0, D0), sensed_across(A, P, Y1, D1)
            else:
                axis = 0 if row == TOOL_X else 1
                (x0, v0, a0), (x1, v1, a1) = sensed_on_tool(P, Y0, D0, axis), sensed_on_tool(P, Y1, D1, axis)
            for place in range(position, stop):
                u = (clock[0] + place / clock[1] - Y0[2]) / dt
                fill_quintic(out, row, place, u, dt, x0, v0, a0, x1, v1, a1)


@inner
def fill_free_motion(P, clock, Y, out, position, stop):
    """The samples from `position` to `stop` of the structure's own motion from the state Y on: those that are asked for."""
    for row in range(min(out.shape[0], N_PLANE)):
        if wanted(clock, row):
            for place in range(position, stop):
                out[row, place] = 0.0
    begun = clock[0] + position / clock[1] - Y[2]
    for mode in range(int(P[COUNT])):
        at, from_ = FIRST_MODE + mode * MODE_SIZE, mode_place(mode)
        pull, drag = P[at + MODE_STIFFNESS] / P[at + MODE_MASS], P[at + MODE_DAMPING] / P[at + MODE_MASS]
        a, b, c, d = oscillator_map(pull, drag, begun)
        q0, r0 = a * Y[from_] + b * Y[from_ + 1], c * Y[from_] + d * Y[from_ + 1]
        tick, on_tool = oscillator_map(pull, drag, 1.0 / clock[1]), P[at + ON_TOOL] == 1.0
        for axis in range(2):
            shape = -P[at + axis] if on_tool else P[at + axis]
            first = TOOL_X + N_MOTION * axis if on_tool else ACROSS * axis
            for order in range(N_MOTION if first < out.shape[0] else 0):
                if first + order < out.shape[0] and wanted(clock, first + order):
                    of_q = shape if order == 0 else 0.0 if order == 1 else -shape * pull
                    of_r = 0.0 if order == 0 else shape if order == 1 else -shape * drag
                    add_course(out, first + order, position, stop, q0, r0, tick, of_q, of_r)


@inner
def put_motion(A, P, Y, D, out, position):
    """One sample of the motion of state Y, whose slope is D: all that `out` holds of it."""
    x, v, a = sensed(A, P, Y, D)
    out[SENSED_X, position] = x
    if out.shape[0] > 1:
        out[SENSED_V, position], out[SENSED_A, position] = v, a
    if PLANAR and out.shape[0] > N_CHANNELS:
        out[ACROSS, position], out[ACROSS + 1, position], out[ACROSS + 2, position] = sensed_across(A, P, Y, D)
        out[TOOL_X, position], out[TOOL_X + 1, position], out[TOOL_X + 2, position] = sensed_on_tool(P, Y, D, 0)
        out[TOOL_Y, position], out[TOOL_Y + 1, position], out[TOOL_Y + 2, position] = sensed_on_tool(P, Y, D, 1)


@inner
def sample_step(A, P, G, clock, Y0, D0, Y1, D1, angle0, angle1, w0, w1, out, position):
    """Fill the samples of the motion that fall into one step; return the next sample."""
    start, rate = clock[0], clock[1]
    dt = Y1[2] - Y0[2]
    count = out.shape[1]
    if position >= count or start + position / rate > Y1[2]:
        return position
    x0, v0, a0 = sensed(A, P, Y0, D0)
    x1, v1, a1 = sensed(A, P, Y1, D1)
    stop = samples_until(start, rate, Y1[2], position, count)
    if PLANAR and out.shape[0] > N_CHANNELS:
        sample_plane(A, P, clock, Y0, D0, Y1, D1, out, position, stop)
    while position < stop:
        u = (start + position / rate - Y0[2]) / dt
        fill_quintic(out, SENSED_X, position, u, dt, x0, v0, a0, x1, v1, a1)
        if out.shape[0] >= N_CHANNELS:
            out[ANGLE, position] = angle_between(u, dt, angle0, angle1, w0, w1)
            out[FORCE_X, position] = 0.0
            out[FORCE_Y, position] = 0.0
        position += 1
    return position


@inner
def rows_between(u, step, steps):
    """Weights of five rows of a surface a share u into a step, and how many of them lie before the step.

    Two rows are a step. The surface is a quartic through five that were met, where the segment of `steps` steps has as many;
    a parabola, which is all that one step holds, shows in a force after a thousandth of it.
    """
    if steps == 1:
        return (1.0 - u) * (1.0 - 2.0 * u), 4.0 * u * (1.0 - u), u * (2.0 * u - 1.0), 0.0, 0.0, 0
    before = 2 if step + 1 == steps else 0
    a = 2.0 * u + before
    b, c, d, e = a - 1.0, a - 2.0, a - 3.0, a - 4.0
    return b * c * d * e / 24.0, -a * c * d * e / 6.0, a * b * d * e / 4.0, -a * b * c * e / 6.0, a * b * c * d / 24.0, before


@inner
def keep_met(S, row, left, edges):
    """Keep what the edges met in this step, before its rows hold what they leave: the next one may ask, see `rows_between`."""
    for edge in range(edges):
        left[4, edge], left[5, edge] = S[row, edge], S[row + 1, edge]


@inner
def met_between(S, row, left, edge, steps, between):
    """What an edge meets within a step from `row` on: rows of S, or what `keep_met` kept, by the weights of `rows_between`."""
    w0, w1, w2, w3, w4, before = between
    if before:
        return (w0 * left[4, edge] + w1 * left[5, edge] + w2 * S[row, edge] + w3 * S[row + 1, edge]
                + w4 * S[row + 2, edge])  # fmt: skip
    if steps == 1:
        return w0 * S[row, edge] + w1 * S[row + 1, edge] + w2 * S[row + 2, edge]
    return (w0 * S[row, edge] + w1 * S[row + 1, edge] + w2 * S[row + 2, edge] + w3 * S[row + 3, edge]
            + w4 * S[row + 4, edge])  # fmt: skip


@inner
def sample_forces(A, P, G, clock, Y0, D0, Y1, D1, phase0, phase1, pass_number, teeth, S, row, step, steps, left, W, share, out,
                  along, across, position):  # fmt: skip
    """Fill the forces of the samples that fall into one step, into rows of `out`, -1 where nobody asks for one.

    S still holds what its edges met from this step on, the last rows of `left` what they met in the step before it. step:
    its number among the segment's. share: of the step that is in the cut.
    """
    start, rate, surface = clock[0], clock[1], left[3]
    dt = Y1[2] - Y0[2]
    while position < out.shape[1]:
        t = start + position / rate
        if t > Y1[2]:
            break
        u = (t - Y0[2]) / dt
        h10, h01, h11 = u * (1.0 - u) ** 2, u * u * (3.0 - 2.0 * u), u * u * (u - 1.0)
        for place in range(Y0.shape[0]):
            W[place] = (1.0 - h01) * Y0[place] + h01 * Y1[place] + dt * (h10 * D0[place] + h11 * D1[place])
        W[2] = t
        between = rows_between(u, step, steps)
        for edge in range(teeth * int(G[SLICES])):
            surface[edge] = met_between(S, row, left, edge, steps, between)
        fx, fy, torque = cutting_force(A, P, G, W, phase0 + u * (phase1 - phase0), pass_number, teeth, surface)
        if along >= 0:
            out[along, position] = share * fx
        if across >= 0:
            out[across, position] = share * fy
        position += 1


@inner
def fill_flight(A, P, E, W, middle, out, position, stop):
    """The displacement from W on, where the structure alone moves: what is carried on stays out of memory."""
    x, v, a, b, c, d = W[0], W[1], E[0, 0], E[0, 1], E[0, 2], E[0, 3]
    for place in range(position, stop):
        W[0], W[1] = x, v
        out[SENSED_X, place] = middle + x + hook_sensed_displacement(A, P, W)
        x, v = a * x + b * v, c * x + d * v


@inner
def sample_flight(A, P, G, O, clock, Y, middle, dt, angle0, span, w0, w1, W, D, E, out, position):
    """Fill the samples of an exact free flight of length dt that starts in state Y; return the next sample.

    The structure vibrates about `middle`, from which Y counts its displacement. The spindle turns by `span` from angle0, at
    the speed w0 first and w1 last. W, D, E are scratch.
    """
    start, rate = clock[0], clock[1]
    count = out.shape[1]
    first = start + position / rate
    if position >= count or first > Y[2] + dt:
        return position
    stop = samples_until(start, rate, Y[2] + dt, position, count)
    if PLANAR and clock.shape[0] > CLOCK:
        fill_free_motion(P, clock, Y, out, position, stop)
        return max(position, stop)
    copy(Y, W)
    for place in range(D.shape[0]):
        D[place] = 0.0
    set_maps(O, first - Y[2], E)
    carry(O, E, W)
    set_maps(O, 1.0 / rate, E)
    if O.shape[0] == 1 and out.shape[0] == 1 and not PLANAR:
        fill_flight(A, P, E, W, middle, out, position, stop)
        return max(position, stop)
    while position < stop:
        if out.shape[0] > 1:
            free_slope(O, W, D)
        if PLANAR:
            put_motion(A, P, W, D, out, position)
        else:
            out[SENSED_X, position] = middle + W[0] + hook_sensed_displacement(A, P, W)
            if out.shape[0] > 1:
                out[SENSED_V, position] = W[1] + hook_sensed_velocity(A, P, W)
                out[SENSED_A, position] = D[1] + hook_sensed_velocity(A, P, D)
        if out.shape[0] >= N_CHANNELS:
            out[FORCE_X, position] = 0.0
            out[FORCE_Y, position] = 0.0
            t = start + position / rate
            out[ANGLE, position] = angle_between((t - Y[2]) / dt if dt > 0.0 else 0.0, dt, angle0, angle0 + span, w0, w1)
        carry(O, E, W)
        position += 1
    return position
