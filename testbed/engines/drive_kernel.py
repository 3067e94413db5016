"""A structure driven by a measured force, without a cut: the excited and the ring-down records of a campaign.

The force is known at the samples and is taken as the cubic through its neighbours between them; the oscillator is carried
by its exact map (see `fast_kernel`), so the step is bounded by the effects alone.
"""

import numpy as np
from numba import njit

from testbed.engines.fast_kernel import SENSED_A, SENSED_V, SENSED_X, STATES_ON, free_map
from testbed.engines.hooks import N_STATES, hook_sensed_displacement, hook_sensed_velocity
from testbed.engines.loop_kernel import DAMPING, MASS, STIFFNESS, derivative


@njit
def force_between(force, index, u):
    """Cubic through four neighbouring samples at index + u, 0 <= u <= 1."""
    last = force.shape[0] - 1
    a, b = force[max(index - 1, 0)], force[min(index, last)]
    c, d = force[min(index + 1, last)], force[min(index + 2, last)]
    return b + 0.5 * u * (c - a + u * (2.0 * a - 5.0 * b + 4.0 * c - d + u * (3.0 * (b - c) + d - a)))


@njit
def nonlinear(A, P, G, Y, N, force):
    """The derivative less the linear oscillator's, into N."""
    derivative(A, P, G, Y, N, force, 0.0)
    N[0] = 0.0
    N[1] += G[STIFFNESS] / G[MASS] * Y[0] + G[DAMPING] / G[MASS] * Y[1]


@njit
def drive_one(A, P, G, I, Y, force, rate, substeps, limit, out):
    """March over the samples of `force` (N); fill out (channels, samples) from state Y at the first one.

    Returns True if the motion stayed below `limit`; behind the point where it did not, the samples are NaN.
    """
    used = 3 + (N_STATES if I[STATES_ON] else 0)
    size = Y.shape[0]
    N1, N2, N3, N4 = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    W, D = np.zeros(size), np.zeros(size)
    h = 1.0 / (rate * substeps)
    e00, e01, e10, e11 = free_map(G, h)
    f00, f01, f10, f11 = free_map(G, 0.5 * h)
    for sample in range(out.shape[1]):
        derivative(A, P, G, Y, D, force[sample], 0.0)
        out[SENSED_X, sample] = Y[0] + hook_sensed_displacement(A, P, Y)
        out[SENSED_V, sample] = Y[1] + hook_sensed_velocity(A, P, Y)
        out[SENSED_A, sample] = D[1] + hook_sensed_velocity(A, P, D)
        for sub in range(substeps):
            u, du = sub / substeps, 1.0 / substeps
            nonlinear(A, P, G, Y, N1, force_between(force, sample, u))
            for i in range(2, used):
                W[i] = Y[i] + 0.5 * h * N1[i]
            W[0] = f00 * Y[0] + f01 * (Y[1] + 0.5 * h * N1[1])
            W[1] = f10 * Y[0] + f11 * (Y[1] + 0.5 * h * N1[1])
            middle = force_between(force, sample, u + 0.5 * du)
            nonlinear(A, P, G, W, N2, middle)
            for i in range(2, used):
                W[i] = Y[i] + 0.5 * h * N2[i]
            W[0], W[1] = f00 * Y[0] + f01 * Y[1], f10 * Y[0] + f11 * Y[1] + 0.5 * h * N2[1]
            nonlinear(A, P, G, W, N3, middle)
            for i in range(2, used):
                W[i] = Y[i] + h * N3[i]
            W[0] = e00 * Y[0] + e01 * Y[1] + h * f01 * N3[1]
            W[1] = e10 * Y[0] + e11 * Y[1] + h * f11 * N3[1]
            nonlinear(A, P, G, W, N4, force_between(force, sample, u + du))
            for i in range(2, used):
                Y[i] += h * (N1[i] + 2.0 * (N2[i] + N3[i]) + N4[i]) / 6.0
            x, v = Y[0], Y[1] + h * N1[1] / 6.0
            kick = h * (N2[1] + N3[1]) / 3.0
            Y[0] = e00 * x + e01 * v + f01 * kick
            Y[1] = e10 * x + e11 * v + f11 * kick + h * N4[1] / 6.0
            if not abs(Y[0]) < limit:
                out[:, sample + 1 :] = np.nan
                return False
    return True


@njit(nogil=True, cache=True)
def drive_batch(A, P, G, I, Y, force, rate, substeps, limit, out, bounded):
    """drive_one over the first axis of the arrays (rate and substeps are shared)."""
    for run in range(G.shape[0]):
        bounded[run] = drive_one(A[run], P[run], G[run], I[run], Y[run], force[run], rate, substeps, limit, out[run])
