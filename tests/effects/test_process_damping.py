"""Process damping against a direct integration and against the damping ratio it must add."""

import math

import numpy as np
import pytest

from testbed.cut import whole_cut_sampling
from testbed.engines import fast
from tests.effects.direct import KN, KT, MODEL, RADIUS, WINDOW, cut, engine, error, integrate

B = 2.0e5
DAMPED = MODEL.with_effect("process_damping", coefficient=B)


def test_matches_a_direct_integration_with_the_law_written_out():
    course = cut(2500.0, 2.5e-3)

    def force(number, theta, x, v, past):
        chip = (course.feed_per_tooth + x - past(number - 1, theta)) * math.sin(theta)
        rubbing = B * course.axial_depth_of_cut * v * math.sin(theta) / (RADIUS * course.spindle_speed)
        tangential, normal = KT * course.axial_depth_of_cut * chip, KN * course.axial_depth_of_cut * chip + rubbing
        return -(tangential * math.cos(theta) + normal * math.sin(theta))

    expected = integrate(MODEL, course, force, (WINDOW,))
    assert error(engine(DAMPED, course, 160), expected) < 3e-8
    assert error(engine(MODEL, course), expected) > 1e-3


def test_without_a_chip_the_decay_is_the_structures_plus_the_mean_rubbing():
    # no cutting coefficients: over many passes the mean of sin^2 over the cut acts as viscous damping
    silent = DAMPED.with_values({"tangential_coefficient": 0.0, "normal_coefficient": 0.0,
                                 "process_damping.coefficient": 5e5})
    course = cut(7003.0, 1.0e-3, passes=400, initial_displacement=1e-4)
    sampling = whole_cut_sampling(course, 1, 20000.0)
    x = fast.simulate(silent, course, sampling).channels["displacement"]
    peaks = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:]) & (x[1:-1] > 0)) + 1
    decay = -np.polyfit(peaks / sampling.rate, np.log(x[peaks]), 1)[0]
    mean_square = (WINDOW / 2 - math.sin(2 * WINDOW) / 4) / (2 * math.pi)
    added = 5e5 * course.axial_depth_of_cut * mean_square / (RADIUS * course.spindle_speed)
    own = MODEL.structure.damping
    assert decay == pytest.approx((own + added) / (2 * MODEL.structure.mass), rel=3e-3)
    assert added > 0.1 * own
