"""Samples at the recording's rate from the steps MuJoCo took."""


from testbed.engines.mujoco_kernel import (
    R_A0,
    R_A1,
    R_ANGLE0,
    R_ANGLE1,
    R_FX0,
    R_FX1,
    R_FXM,
    R_FY0,
    R_FY1,
    R_FYM,
    R_T0,
    R_T1,
    R_V0,
    R_V1,
    R_X0,
)
from testbed.kernel_cache import kept


@kept
def sample_record(R, start, rate, out):
    """Fill out (6, samples): displacement, velocity, acceleration, forces, spindle angle. Samples beyond R stay NaN.

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
            for place, at in ((0, R_X0), (1, R_V0)):
                y0, s0, y1, s1 = row[at], row[at + 1], row[at + 3], row[at + 4]
                out[place, sample] = y0 + u * u * (3.0 - 2.0 * u) * (y1 - y0) \
                    + dt * u * (1.0 - u) * ((1.0 - u) * s0 - u * s1)
            out[2, sample] = 6.0 * u * (1.0 - u) * (row[R_V1] - row[R_V0]) / dt \
                + (1.0 - u) * (1.0 - 3.0 * u) * row[R_A0] + u * (3.0 * u - 2.0) * row[R_A1]
            out[3, sample] = low * row[R_FX0] + middle * row[R_FXM] + high * row[R_FX1]
            out[4, sample] = low * row[R_FY0] + middle * row[R_FYM] + high * row[R_FY1]
            out[5, sample] = row[R_ANGLE0] + u * (row[R_ANGLE1] - row[R_ANGLE0])
            sample += 1
