"""The fast engine where no effect touches the loop: the force is linear in the chip, so one table of coefficients is the cut.

    x'' + 2 zeta omega x' + omega^2 x = -kappa(phase) [h + x(t) - x(t - tau)]

kappa = sum over the edges in the cut of depth (K_t cos th + K_n sin th) sin th / m. Same scheme, grid and samples as the
general kernel; what is remembered of the surface is x at the grid's points, one tooth pass back.
"""

import math

import numpy as np
from numba import njit

from testbed.engines.fast_kernel import (
    CUT,
    IDLE,
    N_A,
    N_B,
    OUTCOME_DIVERGED,
    OUTCOME_OK,
    RING_DOWN,
    SENSED_A,
    SENSED_V,
    SENSED_X,
    TEETH_A,
    TEETH_B,
    free_map,
)
from testbed.engines.loop_kernel import (
    DAMPING,
    ENTRY,
    FEED,
    KN,
    KT,
    MASS,
    OMEGA,
    PITCH,
    SLICE_DEPTH,
    SLICES,
    SPLIT,
    STIFFNESS,
    piece_of_edge,
)


@njit(cache=True)
def chip_stiffness(G, phase, teeth):
    """kappa at one phase of the tooth pitch, 1/s^2."""
    total = 0.0
    for edge in range(teeth * int(G[SLICES])):
        cover, turned = piece_of_edge(G, phase, edge)
        sine, cosine = math.sin(G[ENTRY] + turned), math.cos(G[ENTRY] + turned)
        total += cover * (G[KT] * cosine + G[KN] * sine) * sine
    return total * G[SLICE_DEPTH] / G[MASS]


@njit(cache=True)
def cross(G, x, v, t0, dt, steps, kappa, memory, row0, first, last, clock, out, position, limit):
    """Step through one segment in the cut; kappa has 2 * steps + 1 rows. Returns (x, v, next sample, still bounded)."""
    e00, e01, e10, e11 = free_map(G, dt)
    f00, f01, f10, f11 = free_map(G, 0.5 * dt)
    pull, drag = G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS]
    feed, count = G[FEED], out.shape[1]
    pending = memory[row0] if first else last
    for step in range(steps):
        row = row0 + 2 * step
        n1 = -kappa[2 * step] * (feed + x - memory[row])
        hx = f00 * x + f01 * v
        ex, ev = e00 * x + e01 * v, e10 * x + e11 * v
        n2 = -kappa[2 * step + 1] * (feed + hx + 0.5 * dt * f01 * n1 - memory[row + 1])
        n3 = -kappa[2 * step + 1] * (feed + hx - memory[row + 1])
        n4 = -kappa[2 * step + 2] * (feed + ex + dt * f01 * n3 - memory[row + 2])
        x1 = ex + dt * (e01 * n1 + 2.0 * f01 * (n2 + n3)) / 6.0
        v1 = ev + dt * (e11 * n1 + 2.0 * f11 * (n2 + n3) + n4) / 6.0
        if not abs(x1) < limit:
            return x, v, position, pending, False
        if position < count and clock[0] + position / clock[1] <= t0 + dt:
            a0 = n1 - pull * x - drag * v
            a1 = -kappa[2 * step + 2] * (feed + x1 - memory[row + 2]) - pull * x1 - drag * v1
            while position < count:
                u = (clock[0] + position / clock[1] - t0) / dt
                if u > 1.0:
                    break
                h10, h01, h11 = u * (1.0 - u) ** 2, u * u * (3.0 - 2.0 * u), u * u * (u - 1.0)
                out[SENSED_X, position] = (1.0 - h01) * x + h01 * x1 + dt * (h10 * v + h11 * v1)
                out[SENSED_V, position] = (1.0 - h01) * v + h01 * v1 + dt * (h10 * a0 + h11 * a1)
                out[SENSED_A, position] = (
                    6.0 * u * (1.0 - u) * (v1 - v) / dt + (1.0 - u) * (1.0 - 3.0 * u) * a0 + u * (3.0 * u - 2.0) * a1
                )
                position += 1
        memory[row] = x if first and step == 0 else pending
        memory[row + 1] = 0.5 * (x + x1) + 0.125 * dt * (v - v1)
        pending = x1
        x, v = x1, v1
        t0 += dt
    return x, v, position, pending, True


@njit(cache=True)
def run_linear(G, I, Y, clock, limit, out, pass_times, pass_states):  # noqa: E741
    """As the general kernel's run_one, for the base model. The forces and the angle are not sampled."""
    n_a, n_b = I[N_A], I[N_B]
    tau = G[PITCH] / G[OMEGA]
    dt_a = G[SPLIT] / G[OMEGA] / n_a
    dt_b = (tau - G[SPLIT] / G[OMEGA]) / n_b if n_b > 0 else 0.0
    kappa_a, kappa_b = np.empty(2 * n_a + 1), np.zeros(2 * n_b + 1)
    for row in range(2 * n_a + 1):
        kappa_a[row] = chip_stiffness(G, 0.5 * row * G[SPLIT] / n_a, I[TEETH_A])
    if I[TEETH_B] > 0 and n_b > 0:
        for row in range(2 * n_b + 1):
            kappa_b[row] = chip_stiffness(G, G[SPLIT] + 0.5 * row * (G[PITCH] - G[SPLIT]) / n_b, I[TEETH_B])
    memory = np.zeros(2 * (n_a + n_b) + 1)
    x, v = Y[0], Y[1]
    position, last = 0, 0.0
    a, b, c, d = free_map(G, tau)
    p, q, r, s = free_map(G, n_b * dt_b)
    pass_times[0], pass_states[0, 0], pass_states[0, 1] = Y[2], x, v
    for number in range(I[IDLE] + I[CUT] + I[RING_DOWN]):
        t0 = Y[2] + number * tau
        if not (I[IDLE] <= number < I[IDLE] + I[CUT]):
            position = fly_linear(G, x, v, t0, tau, clock, out, position)
            x, v = a * x + b * v, c * x + d * v
        else:
            x, v, position, last, bounded = cross(
                G, x, v, t0, dt_a, n_a, kappa_a, memory, 0, True, last, clock, out, position, limit
            )
            if bounded and n_b > 0:
                if I[TEETH_B] > 0:
                    x, v, position, last, bounded = cross(
                        G, x, v, t0 + n_a * dt_a, dt_b, n_b, kappa_b, memory, 2 * n_a, False, last, clock, out, position, limit
                    )
                    memory[2 * (n_a + n_b)] = last
                else:
                    memory[2 * n_a] = last
                    position = fly_linear(G, x, v, t0 + n_a * dt_a, n_b * dt_b, clock, out, position)
                    x, v = p * x + q * v, r * x + s * v
            else:
                memory[2 * n_a] = last
            if not bounded:
                out[:, position:] = np.nan
                pass_times[number + 1 :] = np.nan
                pass_states[number + 1 :, :] = np.nan
                return OUTCOME_DIVERGED, t0
        pass_times[number + 1], pass_states[number + 1, 0], pass_states[number + 1, 1] = Y[2] + (number + 1) * tau, x, v
    Y[0], Y[1] = x, v
    out[:, position:] = np.nan
    return OUTCOME_OK, np.nan


@njit(cache=True)
def fly_linear(G, x, v, t0, dt, clock, out, position):
    """Fill the samples of a free flight; return the next sample.

    Four neighbouring samples go forward together, each by four sample times: one chain would wait for itself.
    """
    start, rate, count = clock[0], clock[1], out.shape[1]
    first = start + position / rate
    if position >= count or first > t0 + dt:
        return position
    end = min(count, position + int((t0 + dt - first) * rate) + 2)
    while start + (end - 1) / rate > t0 + dt:  # the same comparison as everywhere else decides
        end -= 1
    pull, drag = G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS]
    a, b, c, d = free_map(G, first - t0)
    x0, v0 = a * x + b * v, c * x + d * v
    a, b, c, d = free_map(G, 1.0 / rate)
    x1, v1 = a * x0 + b * v0, c * x0 + d * v0
    x2, v2 = a * x1 + b * v1, c * x1 + d * v1
    x3, v3 = a * x2 + b * v2, c * x2 + d * v2
    a, b, c, d = free_map(G, 4.0 / rate)
    sensed_x, sensed_v, sensed_a = out[SENSED_X], out[SENSED_V], out[SENSED_A]
    while position + 4 <= end:
        sensed_x[position], sensed_x[position + 1], sensed_x[position + 2], sensed_x[position + 3] = x0, x1, x2, x3
        sensed_v[position], sensed_v[position + 1], sensed_v[position + 2], sensed_v[position + 3] = v0, v1, v2, v3
        sensed_a[position], sensed_a[position + 1] = -pull * x0 - drag * v0, -pull * x1 - drag * v1
        sensed_a[position + 2], sensed_a[position + 3] = -pull * x2 - drag * v2, -pull * x3 - drag * v3
        x0, v0 = a * x0 + b * v0, c * x0 + d * v0
        x1, v1 = a * x1 + b * v1, c * x1 + d * v1
        x2, v2 = a * x2 + b * v2, c * x2 + d * v2
        x3, v3 = a * x3 + b * v3, c * x3 + d * v3
        position += 4
    while position < end:
        sensed_x[position], sensed_v[position], sensed_a[position] = x0, v0, -pull * x0 - drag * v0
        x0, v0, x1, v1, x2, v2 = x1, v1, x2, v2, x3, v3
        position += 1
    return position


@njit(cache=True, nogil=True)
def run_linear_batch(G, I, Y, clock, limit, out, pass_times, pass_states, outcome, outcome_time):  # noqa: E741
    """run_linear over the first axis of every array."""
    for run in range(G.shape[0]):
        outcome[run], outcome_time[run] = run_linear(
            G[run], I[run], Y[run], clock[run], limit, out[run], pass_times[run], pass_states[run]
        )
