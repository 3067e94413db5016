"""The linear kernel for runs of which no record is kept: sixteen of them side by side, each what `run_linear` makes of it.

The innermost loops go over the lanes, at fixed places of arrays of one dimension, so that LLVM makes vector instructions of
them: a step of sixteen runs takes about as long as one of two. The operations of a lane, and their order, are those of
`cross`, so that the numbers are the same to the bit, whoever runs beside it.

A row of T is one step: the force's coefficients at its start, middle and end, and what was left there one tooth pass before. A
row of M is a segment: what a step of it takes. F has the exact maps of the segments, and of a whole pass behind them.
"""

import numpy as np

from testbed.engines.array_kernel import end_passes
from testbed.engines.compiled import holding, inner
from testbed.engines.fast_kernel import CUT, IDLE, OUTCOME_DIVERGED, OUTCOME_OK, RING_DOWN, SEGMENTS, STEPS, TEETH
from testbed.engines.linear_kernel import chip_stiffness
from testbed.engines.loop_kernel import CORNERS, DAMPING, FEED, MASS, OMEGA, PITCH, STIFFNESS, weights_in_cut
from testbed.engines.oscillator_kernel import oscillator_map
from testbed.system.kernel_cache import kept

LANES = 16
LANE_X, LANE_V, LANE_LEFT, LANE_WORST, LANE_FEED, LANE_SIZE = range(0, 6 * LANES, LANES)  # x (m), v (m/s); left behind, largest
K_FIRST, K_MIDDLE, K_LAST, LEFT_FIRST, LEFT_MIDDLE, LEFT_LAST, T_LANES = range(0, 7 * LANES, LANES)
E_XX, E_XV, E_VX, E_VV, H_XX, H_XV, DT, HALF_DT_H, DT_H, EIGHTH_DT, TWICE_H, TWICE_HV, M_LANES = range(0, 13 * LANES, LANES)
F_XX, F_XV, F_VX, F_VV, F_LANES = range(0, 5 * LANES, LANES)


@inner
def fill_segment(G, I, segment, block, lane, M, R):  # noqa: E741
    """A lane of M's row of a segment, and of the coefficients R, from row `block` on, of its steps."""
    steps, low, high = I[STEPS + segment], G[CORNERS + segment], G[CORNERS + segment + 1]
    dt = (high - low) / G[OMEGA] / steps
    e00, e01, e10, e11 = oscillator_map(G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS], dt)
    f00, f01, f10, f11 = oscillator_map(G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS], 0.5 * dt)
    M[segment, E_XX + lane], M[segment, E_XV + lane], M[segment, E_VX + lane], M[segment, E_VV + lane] = e00, e01, e10, e11
    M[segment, H_XX + lane], M[segment, H_XV + lane], M[segment, DT + lane] = f00, f01, dt
    M[segment, HALF_DT_H + lane], M[segment, DT_H + lane], M[segment, EIGHTH_DT + lane] = 0.5 * dt * f01, dt * f01, 0.125 * dt
    M[segment, TWICE_H + lane], M[segment, TWICE_HV + lane] = 2.0 * f01, 2.0 * f11
    for row in range(2 * steps + 1):
        kappa = chip_stiffness(G, low + (high - low) * row / (2.0 * steps), I[TEETH + segment])
        if row < 2 * steps:
            R[block + row // 2, (K_FIRST if row % 2 == 0 else K_MIDDLE) + lane] = kappa
        if row > 0 and row % 2 == 0:
            R[block + row // 2 - 1, K_LAST + lane] = kappa


@inner
def fill_coefficients(G, I, angle, lane, R, T):  # noqa: E741
    """A lane of the coefficients of T, of the pass that begins at `angle` (rad): R where it is cut. Whether all of R."""
    block, whole = 0, True
    for segment in range(I[SEGMENTS]):
        steps = I[STEPS + segment]
        span = (G[CORNERS + segment + 1] - G[CORNERS + segment]) / steps
        for step in range(steps if I[TEETH + segment] > 0 else 0):
            first, middle, last = weights_in_cut(G, angle + G[CORNERS + segment] + step * span, span)
            T[block, K_FIRST + lane] = -first * R[block, K_FIRST + lane]
            T[block, K_MIDDLE + lane] = -middle * R[block, K_MIDDLE + lane]
            T[block, K_LAST + lane] = -last * R[block, K_LAST + lane]
            whole = whole and first == 1.0 and middle == 1.0 and last == 1.0
            block += 1
    return whole


@inner
def fly_lanes(S, F, row):
    """All lanes by an exact map."""
    for lane in range(LANES):
        x, v = S[LANE_X + lane], S[LANE_V + lane]
        S[LANE_X + lane] = F[row, F_XX + lane] * x + F[row, F_XV + lane] * v
        S[LANE_V + lane] = F[row, F_VX + lane] * x + F[row, F_VV + lane] * v


@inner
def cross_lanes(S, M, segment, T, begin, end):
    """All lanes through the steps `begin` to `end` of one segment in the cut."""
    for step in range(begin, end):
        for lane in range(LANES):
            x, v, feed, met = S[LANE_X + lane], S[LANE_V + lane], S[LANE_FEED + lane], T[step, LEFT_MIDDLE + lane]
            ex = M[segment, E_XX + lane] * x + M[segment, E_XV + lane] * v
            ev = M[segment, E_VX + lane] * x + M[segment, E_VV + lane] * v
            hx = M[segment, H_XX + lane] * x + M[segment, H_XV + lane] * v
            kappa, dt = T[step, K_MIDDLE + lane], M[segment, DT + lane]
            n1 = T[step, K_FIRST + lane] * (feed + x - T[step, LEFT_FIRST + lane])
            n2 = kappa * (feed + hx + M[segment, HALF_DT_H + lane] * n1 - met)
            n3 = kappa * (feed + hx - met)
            n4 = T[step, K_LAST + lane] * (feed + ex + M[segment, DT_H + lane] * n3 - T[step, LEFT_LAST + lane])
            x1 = ex + dt * (M[segment, E_XV + lane] * n1 + M[segment, TWICE_H + lane] * (n2 + n3)) / 6.0
            v1 = ev + dt * (M[segment, E_VV + lane] * n1 + M[segment, TWICE_HV + lane] * (n2 + n3) + n4) / 6.0
            T[step, LEFT_FIRST + lane] = S[LANE_LEFT + lane]
            T[step, LEFT_MIDDLE + lane] = 0.5 * (x + x1) + M[segment, EIGHTH_DT + lane] * (v - v1)
            T[step, LEFT_LAST + lane] = x1
            S[LANE_LEFT + lane], S[LANE_X + lane], S[LANE_V + lane] = x1, x1, v1
            worst = S[LANE_WORST + lane]
            S[LANE_WORST + lane] = worst if abs(x1) <= worst else abs(x1)  # a NaN passes, and stays: all x after it are NaN


@inner
def cross_pitch_lanes(I, S, M, F, T):  # noqa: E741
    """All lanes through one tooth pass in the cut; I of any of them."""
    block = 0
    for lane in range(LANES):
        S[LANE_LEFT + lane] = S[LANE_X + lane]
    for segment in range(I[SEGMENTS]):
        if I[TEETH + segment] == 0:
            fly_lanes(S, F, segment)
        else:
            cross_lanes(S, M, segment, T, block, block + I[STEPS + segment])
            block += I[STEPS + segment]


@inner
def fill_lane(G, I, Y, lane, S, M, F, R):  # noqa: E741
    """What a lane of all tables is for one run."""
    block, pull, drag = 0, G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS]
    S[LANE_X + lane], S[LANE_V + lane], S[LANE_WORST + lane], S[LANE_FEED + lane] = Y[0], Y[1], 0.0, G[FEED]
    for segment in range(I[SEGMENTS] + 1):
        span = G[PITCH] if segment == I[SEGMENTS] else G[CORNERS + segment + 1] - G[CORNERS + segment]
        a, b, c, d = oscillator_map(pull, drag, span / G[OMEGA])
        F[segment, F_XX + lane], F[segment, F_XV + lane], F[segment, F_VX + lane], F[segment, F_VV + lane] = a, b, c, d
        if segment < I[SEGMENTS] and I[TEETH + segment] > 0:
            fill_segment(G, I, segment, block, lane, M, R)
            block += I[STEPS + segment]


@inner
def keep_pass(G, Y, S, lane, number, cutting, limit, pass_times, pass_states):
    """A lane's state after a pass. False where it has left all bounds in it: nothing is known of it any more."""
    tau = G[PITCH] / G[OMEGA]
    if cutting and not S[LANE_WORST + lane] < limit:
        end_passes(pass_times, pass_states, number + 1)
        return False
    pass_times[number + 1] = Y[2] + (number + 1) * tau
    pass_states[number + 1, 0], pass_states[number + 1, 1] = S[LANE_X + lane], S[LANE_V + lane]
    return True


@holding
def run_lanes(G, I, Y, runs, limit, pass_times, pass_states, outcome, outcome_time):  # noqa: E741
    """The runs of these LANES numbers (one may stand several times), of equal I, from the start to the end."""
    own, blocks = I[runs[0]], 0
    for segment in range(own[SEGMENTS]):
        blocks += own[STEPS + segment] if own[TEETH + segment] > 0 else 0
    S, M, F = np.zeros(LANE_SIZE), np.zeros((own[SEGMENTS], M_LANES)), np.zeros((own[SEGMENTS] + 1, F_LANES))
    R, T, whole, total = np.zeros((blocks, T_LANES)), np.zeros((blocks, T_LANES)), False, own[IDLE] + own[CUT] + own[RING_DOWN]
    for lane in range(LANES):
        run = runs[lane]
        fill_lane(G[run], own, Y[run], lane, S, M, F, R)
        outcome[run], outcome_time[run] = OUTCOME_OK, np.nan
        pass_times[run, 0], pass_states[run, 0, 0], pass_states[run, 0, 1] = Y[run, 2], Y[run, 0], Y[run, 1]
        end_passes(pass_times[run], pass_states[run], total + 1)
    for number in range(total):
        cutting = own[IDLE] <= number < own[IDLE] + own[CUT]
        if cutting:
            at = number - own[IDLE]
            if not whole or at >= own[CUT] - 2:  # between, no step reaches beyond the cut
                whole = True
                for lane in range(LANES):
                    whole = fill_coefficients(G[runs[lane]], own, at * G[runs[lane], PITCH], lane, R, T) and whole
            cross_pitch_lanes(own, S, M, F, T)
        else:
            fly_lanes(S, F, own[SEGMENTS])
        for lane in range(LANES):
            run = runs[lane]
            if outcome[run] == OUTCOME_OK and not keep_pass(G[run], Y[run], S, lane, number, cutting, limit, pass_times[run],
                                                            pass_states[run]):  # fmt: skip
                outcome[run], outcome_time[run] = OUTCOME_DIVERGED, Y[run, 2] + number * (G[run, PITCH] / G[run, OMEGA])


@kept(nogil=True)
def run_silent_batch(G, I, Y, groups, limit, pass_times, pass_states, outcome, outcome_time):  # noqa: E741
    """run_lanes for every row of `groups` (groups, LANES), numbers of runs, the first axis of every other array."""
    for group in range(groups.shape[0]):
        run_lanes(G, I, Y, groups[group], limit, pass_times, pass_states, outcome, outcome_time)
