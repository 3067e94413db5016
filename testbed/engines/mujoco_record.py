"""Samples at the recording's rate from the steps MuJoCo took."""


from testbed.engines.mujoco_kernel import (
    R_ANGLE0,
    R_ANGLE1,
    R_FX0,
    R_FX1,
    R_FXM,
    R_FY0,
    R_FY1,
    R_FYM,
    R_MOTION,
    R_T0,
    R_T1,
    R_X0,
)
from testbed.system.kernel_cache import kept


@kept
def sample_record(R, start, rate, out):
    """Fill out (6 or 15, samples): displacement, velocity, acceleration, forces, spindle angle, then motion of the other kinds
    (see `mujoco_kernel`). Samples beyond R stay NaN.

    Motion by the cubic through both ends of a step, forces by the parabola through its three points.
    """
    sample, count = 0, out.shape[1]
    for k in range(R.shape[0]):
        row = R[k]
        dt = row[R_T1] - row[R_T0]
        while sample < count:
            t = start + sample / rate
            if t > row[R_T1]:
                break
            u = (t - row[R_T0]) / dt
            low, high, middle = (1.0 - u) * (1.0 - 2.0 * u), u * (2.0 * u - 1.0), 4.0 * u * (1.0 - u)
            for first in range(0, out.shape[0], 3):
                if first == 3:
                    continue
                begin = R_X0 if first == 0 else R_MOTION + 2 * (first - 6)
                for order in range(2):
                    at = begin + order
                    y0, s0, y1, s1 = row[at], row[at + 1], row[at + 3], row[at + 4]
                    out[first + order, sample] = y0 + u * u * (3.0 - 2.0 * u) * (y1 - y0) \
                        + dt * u * (1.0 - u) * ((1.0 - u) * s0 - u * s1)
                out[first + 2, sample] = 6.0 * u * (1.0 - u) * (row[begin + 4] - row[begin + 1]) / dt \
                    + (1.0 - u) * (1.0 - 3.0 * u) * row[begin + 2] + u * (3.0 * u - 2.0) * row[begin + 5]
            out[3, sample] = low * row[R_FX0] + middle * row[R_FXM] + high * row[R_FX1]
            out[4, sample] = low * row[R_FY0] + middle * row[R_FYM] + high * row[R_FY1]
            out[5, sample] = row[R_ANGLE0] + u * (row[R_ANGLE1] - row[R_ANGLE0])
            sample += 1
