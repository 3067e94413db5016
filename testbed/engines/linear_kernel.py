"""The fast engine where no effect touches the loop: the force is linear in the chip, so one table of coefficients is the cut.

    x'' + 2 zeta omega x' + omega^2 x = -kappa(phase) [h + x(t) - x(t - tau)]

kappa = sum over the edges in the cut of depth (K_t cos th + K_n sin th) sin th / m. Same scheme, grid and samples as the
general kernel; what is remembered of the surface is x at the grid's points, one tooth pass back.
"""

import math

import numpy as np

from testbed.engines.array_kernel import end_record
from testbed.engines.compiled import holding, inner
from testbed.engines.fast_kernel import CUT, IDLE, OUTCOME_DIVERGED, OUTCOME_OK, RING_DOWN, SEGMENTS, STEPS, TEETH
from testbed.engines.front_kernel import swing_before
from testbed.engines.loop_kernel import (
    CORNERS,
    DAMPING,
    ENTRY,
    FEED,
    HELD_UNTIL,
    KN,
    KT,
    MASS,
    OMEGA,
    PITCH,
    SLICE_DEPTH,
    SLICES,
    STIFFNESS,
    SWUNG_FRONT,
    piece_of_edge,
    weights_in_cut,
)
from testbed.engines.oscillator_kernel import oscillator_map
from testbed.engines.sampling_kernel import SENSED_A, SENSED_V, SENSED_X, fill_quintic, samples_until, skip_held
from testbed.system.kernel_cache import kept


@inner
def chip_stiffness(G, phase, teeth):
    """kappa at one phase of the tooth pitch, 1/s^2."""
    total = 0.0
    for edge in range(teeth * int(G[SLICES])):
        cover, turned = piece_of_edge(G, phase, edge)
        sine, cosine = math.sin(G[ENTRY] + turned), math.cos(G[ENTRY] + turned)
        total += cover * (G[KT] * cosine + G[KN] * sine) * sine
    return total * G[SLICE_DEPTH] / G[MASS]


@inner
def fill_swing(G, I, x, v, memory):  # noqa: E741
    """Into the memory what the structure's swing left one pitch before it came to (x, v), where the first tooth enters."""
    row0 = 0
    for segment in range(I[SEGMENTS]):
        steps, low, high = I[STEPS + segment], G[CORNERS + segment], G[CORNERS + segment + 1]
        for row in range(2 * steps + 1 if I[TEETH + segment] > 0 else 0):
            phase = low + (high - low) * row / (2.0 * steps)
            memory[row0 + row] = swing_before(G, x, v, (G[PITCH] - phase) / G[OMEGA])
        row0 += 2 * steps + 1


@inner
def cross(G, x, v, t0, dt, angle, span, steps, kappa, memory, row0, last, clock, out, position, limit):
    """Step through one segment in the cut, from row0 of kappa and memory on. `last` is what is left at its start.

    angle: at its start, rad after the start of the first pass; span: of a step, rad.

    Returns (x, v, next sample, what is left at its end, still bounded).
    """
    e00, e01, e10, e11 = oscillator_map(G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS], dt)
    f00, f01, f10, f11 = oscillator_map(G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS], 0.5 * dt)
    pull, drag = G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS]
    feed, count = G[FEED], out.shape[1]
    for step in range(steps):
        row, (at0, at_middle, at1) = row0 + 2 * step, weights_in_cut(G, angle + step * span, span)
        n1 = -at0 * kappa[row] * (feed + x - memory[row])
        hx = f00 * x + f01 * v
        ex, ev = e00 * x + e01 * v, e10 * x + e11 * v
        n2 = -at_middle * kappa[row + 1] * (feed + hx + 0.5 * dt * f01 * n1 - memory[row + 1])
        n3 = -at_middle * kappa[row + 1] * (feed + hx - memory[row + 1])
        n4 = -at1 * kappa[row + 2] * (feed + ex + dt * f01 * n3 - memory[row + 2])
        x1 = ex + dt * (e01 * n1 + 2.0 * f01 * (n2 + n3)) / 6.0
        v1 = ev + dt * (e11 * n1 + 2.0 * f11 * (n2 + n3) + n4) / 6.0
        if not abs(x1) < limit:
            return x, v, position, last, False
        if position < count and clock[0] + position / clock[1] <= t0 + dt:
            a0 = n1 - pull * x - drag * v
            a1 = -at1 * kappa[row + 2] * (feed + x1 - memory[row + 2]) - pull * x1 - drag * v1
            while position < count:
                u = (clock[0] + position / clock[1] - t0) / dt
                if u > 1.0:
                    break
                fill_quintic(out, SENSED_X, position, u, dt, x, v, a0, x1, v1, a1)
                position += 1
        memory[row] = last
        memory[row + 1] = 0.5 * (x + x1) + 0.125 * dt * (v - v1)
        last = x1
        x, v = x1, v1
        t0 += dt
    return x, v, position, last, True


@inner
def cross_pitch_linear(G, I, x, v, t0, angle, kappa, memory, flights, clock, limit, out, position):  # noqa: E741
    """One tooth pass in the cut. flights (segments, 4): exact maps over whole segments.

    Returns (x, v, next sample, still bounded).
    """
    row0, last = np.int64(0), x  # a literal 0 would be compiled for as a type of its own
    for segment in range(I[SEGMENTS]):
        steps, teeth = I[STEPS + segment], I[TEETH + segment]
        base, span = G[CORNERS + segment], G[CORNERS + segment + 1] - G[CORNERS + segment]
        duration = span / G[OMEGA]
        if teeth == 0:
            position = fly_linear(G, x, v, t0, duration, clock, out, position)
            x, v = (flights[segment, 0] * x + flights[segment, 1] * v, flights[segment, 2] * x + flights[segment, 3] * v)
        else:
            x, v, position, last, bounded = cross(G, x, v, t0, duration / steps, angle + base, span / steps, steps, kappa,
                                                  memory, row0, last, clock, out, position, limit)  # fmt: skip
            if not bounded:
                return x, v, position, False
            memory[row0 + 2 * steps] = last
        row0 += 2 * steps + 1
        t0 += duration
    return x, v, position, True


@holding
def run_linear(G, I, Y, clock, limit, out, pass_times, pass_states):  # noqa: E741
    """As the general kernel's run_one, for the base model. The forces and the angle are not sampled.

    out: with a single row the displacement alone is sampled.
    """
    tau, rows = G[PITCH] / G[OMEGA], 1
    pull, drag = G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS]
    flights = np.zeros((I[SEGMENTS], 4))
    for segment in range(I[SEGMENTS]):
        rows += 2 * I[STEPS + segment]
        duration = (G[CORNERS + segment + 1] - G[CORNERS + segment]) / G[OMEGA]
        p, q, r, s = oscillator_map(pull, drag, duration)
        flights[segment, 0], flights[segment, 1], flights[segment, 2], flights[segment, 3] = p, q, r, s
    # a corner belongs to two segments: where a straight tooth leaves, the force jumps, and each needs its own row
    kappa, memory = np.zeros(rows + I[SEGMENTS]), np.zeros(rows + I[SEGMENTS])
    row0 = 0
    for segment in range(I[SEGMENTS]):
        steps, low, high = I[STEPS + segment], G[CORNERS + segment], G[CORNERS + segment + 1]
        for row in range(2 * steps + 1 if I[TEETH + segment] > 0 else 0):
            kappa[row0 + row] = chip_stiffness(G, low + (high - low) * row / (2.0 * steps), I[TEETH + segment])
        row0 += 2 * steps + 1
    x, v, position = Y[0], Y[1], skip_held(G, clock, out)
    a, b, c, d = oscillator_map(pull, drag, tau)
    pass_times[0], pass_states[0, 0], pass_states[0, 1] = Y[2], x, v
    for number in range(I[IDLE] + I[CUT] + I[RING_DOWN]):
        t0 = Y[2] + number * tau
        if number < I[IDLE] and t0 < G[HELD_UNTIL]:
            begin = G[HELD_UNTIL]
            if begin < t0 + tau:
                position = fly_linear(G, x, v, begin, t0 + tau - begin, clock, out, position)
                p, q, r, s = oscillator_map(pull, drag, t0 + tau - begin)
                x, v = p * x + q * v, r * x + s * v
        elif not (I[IDLE] <= number < I[IDLE] + I[CUT]):
            position = fly_linear(G, x, v, t0, tau, clock, out, position)
            x, v = a * x + b * v, c * x + d * v
        else:
            if number == I[IDLE] and G[SWUNG_FRONT] != 0.0:
                fill_swing(G, I, x, v, memory)
            x, v, position, bounded = cross_pitch_linear(G, I, x, v, t0, (number - I[IDLE]) * G[PITCH], kappa, memory, flights,
                                                         clock, limit, out, position)  # fmt: skip
            if not bounded:
                end_record(out, pass_times, pass_states, position, number + 1)
                return OUTCOME_DIVERGED, t0
        pass_times[number + 1], pass_states[number + 1, 0], pass_states[number + 1, 1] = Y[2] + (number + 1) * tau, x, v
    Y[0], Y[1] = x, v
    end_record(out, pass_times, pass_states, position, I[IDLE] + I[CUT] + I[RING_DOWN] + 1)
    return OUTCOME_OK, np.nan


@inner
def fly_linear(G, x, v, t0, dt, clock, out, position):
    """Fill the samples of a free flight; return the next sample.

    Four neighbouring samples go forward together, each by four sample times: one chain would wait for itself.
    """
    start, rate, count = clock[0], clock[1], out.shape[1]
    first = start + position / rate
    if position >= count or first > t0 + dt:
        return position
    end = samples_until(start, rate, t0 + dt, position, count)
    pull, drag = G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS]
    a, b, c, d = oscillator_map(pull, drag, first - t0)
    x0, v0 = a * x + b * v, c * x + d * v
    a, b, c, d = oscillator_map(pull, drag, 1.0 / rate)
    x1, v1 = a * x0 + b * v0, c * x0 + d * v0
    x2, v2 = a * x1 + b * v1, c * x1 + d * v1
    x3, v3 = a * x2 + b * v2, c * x2 + d * v2
    a, b, c, d = oscillator_map(pull, drag, 4.0 / rate)
    rates = out.shape[0] > 1
    sensed_x, sensed_v, sensed_a = out[SENSED_X], out[SENSED_V if rates else 0], out[SENSED_A if rates else 0]
    while position + 4 <= end:
        sensed_x[position], sensed_x[position + 1], sensed_x[position + 2], sensed_x[position + 3] = x0, x1, x2, x3
        if rates:
            sensed_v[position], sensed_v[position + 1], sensed_v[position + 2], sensed_v[position + 3] = v0, v1, v2, v3
            sensed_a[position], sensed_a[position + 1] = -pull * x0 - drag * v0, -pull * x1 - drag * v1
            sensed_a[position + 2], sensed_a[position + 3] = -pull * x2 - drag * v2, -pull * x3 - drag * v3
        x0, v0 = a * x0 + b * v0, c * x0 + d * v0
        x1, v1 = a * x1 + b * v1, c * x1 + d * v1
        x2, v2 = a * x2 + b * v2, c * x2 + d * v2
        x3, v3 = a * x3 + b * v3, c * x3 + d * v3
        position += 4
    while position < end:
        sensed_x[position] = x0
        if rates:
            sensed_v[position], sensed_a[position] = v0, -pull * x0 - drag * v0
        x0, v0, x1, v1, x2, v2 = x1, v1, x2, v2, x3, v3
        position += 1
    return position


@kept(nogil=True)
def run_linear_batch(G, I, Y, clock, limit, out, pass_times, pass_states, outcome, outcome_time):  # noqa: E741
    """run_linear over the first axis of every array."""
    for run in range(G.shape[0]):
        outcome[run], outcome_time[run] = run_linear(
            G[run], I[run], Y[run], clock[run], limit, out[run], pass_times[run], pass_states[run]
        )
