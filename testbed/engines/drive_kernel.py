"""A structure driven by a measured force, without a cut: the excited and the ring-down records of a campaign.

The force is known at the samples and is taken as the cubic through its neighbours between them; oscillators are carried
by their exact maps (see `oscillator_kernel`), so the step is bounded by the other effects alone. A free decay in which all is
carried exactly is one flight.
"""

import numpy as np

from testbed.engines.array_kernel import copy, fill_columns
from testbed.engines.compiled import holding, inner
from testbed.engines.fast_kernel import CARRIED, EXACT_FLIGHT, PLAIN, PLAIN_COUNT
from testbed.engines.loop_kernel import derivative
from testbed.engines.oscillator_kernel import end_state, increment, set_half_and_whole, stage_state
from testbed.engines.plane_kernel import bounded
from testbed.engines.sampling_kernel import put_motion
from testbed.engines.slider_kernel import fly_exactly
from testbed.system.kernel_cache import kept


@inner
def force_between(force, index, u):
    """Cubic through four neighbouring samples at index + u, 0 <= u <= 1."""
    last = force.shape[0] - 1
    a, b = force[max(index - 1, 0)], force[min(index, last)]
    c, d = force[min(index + 1, last)], force[min(index + 2, last)]
    return b + 0.5 * u * (c - a + u * (2.0 * a - 5.0 * b + 4.0 * c - d + u * (3.0 * (b - c) + d - a)))


@inner
def decay_freely(A, P, G, O, Y, clock, W, D, E, out):
    """Fill out (channels, samples) with the free motion from state Y at the first sample, all of it carried exactly."""
    fly_exactly(A, P, G, O, clock, Y, (out.shape[1] - 0.5) / clock[1], 0.0, 0.0, 0.0, 0.0, W, D, E, out, 0)


@inner
def march(A, P, G, O, plain, Y, Y1, D, W, K, H, E, force, ahead, across, rate, substeps, limit, out):
    """Step from sample to sample under a force; True if it stayed below `limit`. The others are scratch.

    ahead, across: of the force, what acts along x and along y.
    """
    more = O.shape[0] > 1 or plain.shape[0] > 0
    h = 1.0 / (rate * substeps)
    set_half_and_whole(O, h, H, E)
    derivative(A, P, G, Y, D, ahead * force[0], across * force[0], 0.0)
    for sample in range(out.shape[1]):
        put_motion(A, P, Y, D, out, sample)
        for sub in range(substeps):
            u, du = sub / substeps, 1.0 / substeps
            middle, end = force_between(force, sample, u + 0.5 * du), force_between(force, sample, u + du)
            increment(O, plain, more, Y, D, h, h, K, 0)
            for stage in range(1, 4):
                stage_state(O, plain, more, H, E, Y, K, stage, W)
                now = end if stage == 3 else middle
                derivative(A, P, G, W, D, ahead * now, across * now, 0.0)
                increment(O, plain, more, W, D, h, h, K, stage)
            end_state(O, plain, more, H, E, Y, K, Y1)
            copy(Y1, Y)
            derivative(A, P, G, Y, D, ahead * end, across * end, 0.0)  # that at the start of the next step
            if not bounded(P, Y, limit):
                fill_columns(out, sample + 1, np.nan)
                return False
    return True


@holding
def drive_one(A, P, G, I, O, Y, force, ahead, across, rate, substeps, limit, out):
    """March over the samples of `force` (N), of which `ahead` acts along x and `across` along y.

    Fills out (channels, samples) from state Y at the first one.

    Returns True if the motion stayed below `limit`; behind the point where it did not, the samples are NaN.
    """
    work, K, maps = np.zeros((3, Y.shape[0])), np.zeros((4, Y.shape[0])), np.zeros((2, O.shape[0], 4))
    if I[EXACT_FLIGHT] and bounded(P, Y, limit) and not np.any(force):
        decay_freely(A, P, G, O, Y, np.array([0.0, rate]), work[0], work[1], maps[0], out)
        return True
    return march(A, P, G, O, I[PLAIN : PLAIN + I[PLAIN_COUNT]], Y, work[0], work[1], work[2], K, maps[0], maps[1], force, ahead,
                 across, rate, substeps, limit, out)


@kept(nogil=True)
def drive_batch(A, P, G, I, O, Y, force, ahead, across, rate, substeps, limit, out, within):
    """drive_one over the first axis of the arrays (what is no array is shared)."""
    for run in range(G.shape[0]):
        within[run] = drive_one(A[run], P[run], G[run], I[run], O[run, : I[run, CARRIED]], Y[run], force[run], ahead,
                                 across, rate, substeps, limit, out[run])  # fmt: skip
