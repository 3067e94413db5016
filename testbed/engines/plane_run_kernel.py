"""Runs of any number of modes in the plane that only the force at the edges moves, at a steady speed.

The modes are carried exactly, by `modes_kernel`, in whose terms `modes` and Q are. One of two files says what a step in the cut
is, by the names `widths_of_bench`, `fill_bench`, `meet_front` and `cross`: `plane_linear_kernel` for base models,
`plane_edge_kernel` where effects act at the edges.
"""

import numpy as np

from testbed.engines.array_kernel import end_record, fill
from testbed.engines.compiled import holding, inner
from testbed.engines.fast_kernel import CUT, IDLE, OUTCOME_DIVERGED, OUTCOME_OK, RING_DOWN, SEGMENTS, STEPS, TEETH
from testbed.engines.loop_kernel import CORNERS, HELD_UNTIL, OMEGA, PITCH
from testbed.engines.modes_kernel import FORCES, carry_modes, fill_mode_maps, in_the_plane, rows_of, sample_free_modes
from testbed.engines.plane_linear_kernel import cross, fill_bench, meet_front, widths_of_bench
from testbed.engines.sampling_kernel import skip_held
from testbed.system.kernel_cache import kept


@inner
def pass_in_cut(A, P, G, I, modes, bench, number, maps, work, ticks, rows, clock, t0, limit, out, position):  # noqa: E741
    """One tooth pass in the cut, the run's `number`; maps (segments, 4, modes, 4): see `cross`. (next sample, bounded)."""
    row0, angle = np.int64(0), (number - I[IDLE]) * G[PITCH]  # a literal 0 would be compiled for as a type of its own
    for segment in range(I[SEGMENTS]):
        steps, base = I[STEPS + segment], G[CORNERS + segment]
        span = G[CORNERS + segment + 1] - base
        duration = span / G[OMEGA]
        if I[TEETH + segment] == 0:
            position = sample_free_modes(modes, rows, clock, t0, duration, work[0], ticks, out, position)
            carry_modes(work[0], maps[segment, 2])
        else:
            position, bounded = cross(A, P, G, I, modes, bench, number, segment, row0, steps, duration / steps, angle + base,
                                      span / steps, maps[segment], work, rows, clock, t0, limit, out, position)  # fmt: skip
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
def run_plane(A, P, G, I, modes, Q, Y, rows, clock, limit, out, pass_times, pass_states):  # noqa: E741
    """As the general kernel's run_one. The angle is not sampled, forces by `plane_edge_kernel` alone. Of Y the clock counts.

    rows (5, 3): see `sample_modes` and FORCES.
    """
    many, tau, maps = modes.shape[0], G[PITCH] / G[OMEGA], np.empty((I[SEGMENTS], 4, modes.shape[0], 4))
    whole, free, ticks = np.empty((many, 4)), np.empty((many, 4)), np.empty((many, 4))
    work, size = np.empty((2, many, 2)), rows_of(I)
    edges, numbers, across = widths_of_bench(G, I)
    bench = (np.zeros((size, edges, numbers)), np.zeros((size, across)), np.zeros((6, across)), np.zeros(across, np.int64),
             np.zeros(5), np.zeros((4, 5)))  # fmt: skip
    fill_bench(G, I, bench)
    for segment in range(I[SEGMENTS]):
        duration = (G[CORNERS + segment + 1] - G[CORNERS + segment]) / G[OMEGA]
        fill_mode_maps(modes, duration / I[STEPS + segment], maps[segment, 0])
        fill_mode_maps(modes, 0.5 * duration / I[STEPS + segment], maps[segment, 1])
        fill_mode_maps(modes, duration, maps[segment, 2])
        fill_mode_maps(modes, 0.0, maps[segment, 3])
    fill_mode_maps(modes, tau, whole)
    fill_mode_maps(modes, 1.0 / clock[1], ticks)
    for mode in range(many):
        work[0, mode, 0], work[0, mode, 1] = Q[mode, 0], Q[mode, 1]
    position = skip_held(G, clock, out)
    for row in rows[FORCES, :2]:
        if row >= 0:
            fill(out[row], position, 0.0)
    pass_times[0] = Y[2]
    keep_motion(modes, work[0], pass_states, 0)
    for number in range(I[IDLE] + I[CUT] + I[RING_DOWN]):
        t0 = Y[2] + number * tau
        if number < I[IDLE] and t0 < G[HELD_UNTIL]:
            begin = G[HELD_UNTIL]
            if begin < t0 + tau:
                position = sample_free_modes(modes, rows, clock, begin, t0 + tau - begin, work[0], ticks, out, position)
                fill_mode_maps(modes, t0 + tau - begin, free)
                carry_modes(work[0], free)
        elif not (I[IDLE] <= number < I[IDLE] + I[CUT]):
            position = sample_free_modes(modes, rows, clock, t0, tau, work[0], ticks, out, position)
            carry_modes(work[0], whole)
        else:
            if number == I[IDLE]:
                meet_front(A, P, G, I, modes, work[0], free, bench, t0)
            position, bounded = pass_in_cut(A, P, G, I, modes, bench, number, maps, work, ticks, rows, clock, t0, limit, out,
                                            position)  # fmt: skip
            if not bounded:
                end_record(out, pass_times, pass_states, position, number + 1)
                return OUTCOME_DIVERGED, t0
        pass_times[number + 1] = Y[2] + (number + 1) * tau
        keep_motion(modes, work[0], pass_states, number + 1)
    end_record(out, pass_times, pass_states, position, I[IDLE] + I[CUT] + I[RING_DOWN] + 1)
    return OUTCOME_OK, np.nan


@kept(nogil=True)
def run_plane_batch(A, P, G, I, modes, counts, Q, Y, rows, clock, limit, out, pass_times, pass_states, outcome,  # noqa: E741
                    outcome_time):  # fmt: skip
    """run_plane over the first axis of every array but `rows`; counts (runs,): how many modes are a run's."""
    for run in range(G.shape[0]):
        outcome[run], outcome_time[run] = run_plane(
            A[run], P[run], G[run], I[run], modes[run, : counts[run]], Q[run, : counts[run]], Y[run], rows, clock[run], limit,
            out[run], pass_times[run], pass_states[run])  # fmt: skip
