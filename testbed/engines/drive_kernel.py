"""A structure driven by a measured force, without a cut: the excited and the ring-down records of a campaign.

The force is known at the samples and is taken as the cubic through its neighbours between them; oscillators are carried
by their exact maps (see `oscillator_kernel`), so the step is bounded by the other effects alone.
"""

import numpy as np
from numba import njit

from testbed.engines.compiled import inner
from testbed.engines.fast_kernel import CARRIED, PLAIN, PLAIN_COUNT
from testbed.engines.hooks import hook_sensed_displacement, hook_sensed_velocity
from testbed.engines.loop_kernel import derivative
from testbed.engines.oscillator_kernel import end_state, increment, set_half_and_whole, stage_state
from testbed.engines.sampling_kernel import SENSED_A, SENSED_V, SENSED_X


@inner
def force_between(force, index, u):
    """Cubic through four neighbouring samples at index + u, 0 <= u <= 1."""
    last = force.shape[0] - 1
    a, b = force[max(index - 1, 0)], force[min(index, last)]
    c, d = force[min(index + 1, last)], force[min(index + 2, last)]
    return b + 0.5 * u * (c - a + u * (2.0 * a - 5.0 * b + 4.0 * c - d + u * (3.0 * (b - c) + d - a)))


@njit(error_model="numpy")
def drive_one(A, P, G, I, O, Y, force, rate, substeps, limit, out):
    """March over the samples of `force` (N); fill out (channels, samples) from state Y at the first one.

    Returns True if the motion stayed below `limit`; behind the point where it did not, the samples are NaN.
    """
    size = Y.shape[0]
    K, W, D, Y1 = np.zeros((4, size)), np.zeros(size), np.zeros(size), np.zeros(size)
    H, E = np.zeros((O.shape[0], 4)), np.zeros((O.shape[0], 4))
    plain = I[PLAIN : PLAIN + I[PLAIN_COUNT]]
    more = O.shape[0] > 1 or plain.shape[0] > 0
    h = 1.0 / (rate * substeps)
    set_half_and_whole(O, h, H, E)
    for sample in range(out.shape[1]):
        derivative(A, P, G, Y, D, force[sample], 0.0)
        out[SENSED_X, sample] = Y[0] + hook_sensed_displacement(A, P, Y)
        out[SENSED_V, sample] = Y[1] + hook_sensed_velocity(A, P, Y)
        out[SENSED_A, sample] = D[1] + hook_sensed_velocity(A, P, D)
        for sub in range(substeps):
            u, du = sub / substeps, 1.0 / substeps
            for stage in range(4):
                if stage == 0:
                    for i in range(size):
                        W[i] = Y[i]
                else:
                    stage_state(O, plain, more, H, E, Y, K, stage, W)
                share = 0.0 if stage == 0 else (du if stage == 3 else 0.5 * du)
                derivative(A, P, G, W, D, force_between(force, sample, u + share), 0.0)
                increment(O, plain, more, W, D, h, h, K, stage)
            end_state(O, plain, more, H, E, Y, K, Y1)
            for i in range(size):
                Y[i] = Y1[i]
            if not abs(Y[0]) < limit:
                out[:, sample + 1 :] = np.nan
                return False
    return True


@njit(nogil=True, cache=True)
def drive_batch(A, P, G, I, O, Y, force, rate, substeps, limit, out, bounded):
    """drive_one over the first axis of the arrays (rate and substeps are shared)."""
    for run in range(G.shape[0]):
        bounded[run] = drive_one(A[run], P[run], G[run], I[run], O[run, : I[run, CARRIED]], Y[run], force[run], rate,
                                 substeps, limit, out[run])  # fmt: skip
