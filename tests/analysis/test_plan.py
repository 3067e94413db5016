"""The next cut: what it is expected to tell against a fit of such a record, and which explanations it separates."""

from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.probable.draws import Known
from testbed.analysis.probable.plan import Explanation, information, plan
from testbed.analysis.search.next_test import COURSE
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from testbed.workshop import RPM
from tests.support.campaign_files import TRUE
from tests.support.synthetic_campaign import synthetic_campaign

PATHS = ("natural_frequency", "damping_ratio", "tangential_coefficient", "normal_coefficient")
SIZES = np.array([0.02, 5e-5, 2e7, 2e7])
ANY = (-np.inf, np.inf)


def known(model, sizes=SIZES):
    return Known(model, PATHS, np.diag(sizes**2), (ANY,) * 4)


@pytest.fixture(scope="module")
def record():
    made = synthetic_campaign(fast.simulate, TRUE, seed=3, tests=((3810, 1.5),), rate=3200.0, course=COURSE, speed_error=0.0)
    return observe(made[0], TRUE)


def test_what_a_cut_tells_is_what_a_fit_of_its_record_tells(record):
    """Second road: the record that such a cut gave, and its slopes about the truth as a fit has them."""
    told = plan(predict, record, [Explanation("it", known(TRUE))], [(3810 * RPM, 1.5e-3, 1.0)])[0]
    _, fit = model_fit(predict, [record], TRUE, catalogue())
    assert fit.converged and fit.names[:4] == PATHS
    covariance = fit.covariance[:4, :4] / max(1.0, fit.variance)
    fitted = 0.5 * np.linalg.slogdet(np.eye(4) + np.diag(SIZES**2) @ np.linalg.inv(covariance))[1]
    assert told.information == pytest.approx(fitted, rel=0.1)


def test_information_is_that_of_normal_distributions():
    """1/2 log of how much the volume of what is known shrinks, by the covariance of the values seen instead of the slopes'."""
    slopes = np.random.default_rng(1).standard_normal((3, 40))
    seen = np.eye(40) + slopes.T @ slopes
    assert information(slopes) == pytest.approx(0.5 * np.log(np.linalg.eigvalsh(seen)).sum(), rel=1e-12)


def test_explanations_are_separated_where_they_differ(record):
    damped = TRUE.with_effect("process_damping", coefficient=2e5)
    cuts = [(3810 * RPM, depth, 1.0) for depth in (5e-4, 3e-3)]
    pair = [Explanation("plain", known(TRUE, SIZES * 1e-2)), Explanation("damped", known(damped, SIZES * 1e-2))]
    deep, shallow = plan(predict, record, pair, cuts)
    assert deep.axial_depth_of_cut == 3e-3 and deep.separates == ("plain", "damped")
    assert deep.difference > 3 * shallow.difference and deep.of_explanations == pytest.approx(np.log(2), rel=0.01)
    assert set(deep.expects) == {"plain", "damped"} and deep.expects["plain"]["displacement"] > 1e-5
    same = plan(predict, record, [pair[0], replace(pair[0], name="again")], cuts[1:])[0]
    assert same.separates == () and same.of_explanations == pytest.approx(0.0, abs=1e-9)
    loose = [Explanation("plain", known(TRUE, SIZES * 20)), Explanation("damped", known(damped, SIZES * 20))]
    assert plan(predict, record, loose, cuts[1:])[0].difference < deep.difference  # parameters make up for some of it


def test_noise_that_counts_more_tells_less_and_time_is_counted(record):
    cuts = [(speed * RPM, 1e-3, 1.0) for speed in (3000, 4200)]
    once, twice = (plan(predict, record, [Explanation("it", known(TRUE), wider)], cuts) for wider in (1.0, 2.0))
    by_speed = {one.spindle_speed: one for one in once}
    assert all(one.information < by_speed[one.spindle_speed].information for one in twice)
    assert all(one.minutes == pytest.approx(COURSE[1] * 2 * np.pi / one.spindle_speed / 60) for one in once)
    assert once[0].information_per_minute >= once[1].information_per_minute
