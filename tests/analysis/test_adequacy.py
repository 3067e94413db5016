"""Held-out residuals are judged in units of the noise and of what the other records leave open."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import sqrtm

from testbed.analysis.comparison.adequacy import less_open
from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.fit_state import Jacobian
from testbed.analysis.fit.held_out import RecordError
from testbed.catalogue import catalogue
from testbed.engines import predict
from tests.validation.probable import campaign, machine

SIZES, NOISE = (40, 50, 60), 3e-6


class Linear:
    """Three records that go with three shared and two own unknowns each as slopes say, and their fits by least squares."""

    def __init__(self, seed, conditions=("a", "b", "c"), beside=0.0):
        random = np.random.default_rng(seed)
        self.conditions = conditions
        self.shared = [factor * random.standard_normal((size, 3)) for size, factor in zip(SIZES, (5.0, 1.0, 1.0), strict=True)]
        self.own = [random.standard_normal((size, 2)) for size in SIZES]
        self.data = [random.standard_normal(size) for size in SIZES]
        self.data[1] = self.data[1] + self.shared[1] @ [0.0, beside, 0.0]

    def residuals(self, places, of):
        """Of the records `of` after a fit of the shared unknowns to those at places, each with its own refitted."""
        bare = [part - own @ np.linalg.lstsq(own, part, rcond=None)[0] for part, own in zip(self.shared, self.own, strict=True)]
        data = [part - own @ np.linalg.lstsq(own, part, rcond=None)[0] for part, own in zip(self.data, self.own, strict=True)]
        stacked = np.vstack([bare[place] for place in places])
        found = np.linalg.lstsq(stacked, np.concatenate([data[place] for place in places]), rcond=None)[0]
        self.bare = bare
        return np.concatenate([data[place] - bare[place] @ found for place in of])

    def judged(self, off=0.0):
        """The residuals as they are judged, over the noise, and the tests; off: how far the joint fit is from its optimum."""
        joint = np.split(self.residuals(range(3), range(3)), np.cumsum(SIZES)[:-1])
        rests = [rest + bare @ np.full(3, off) for rest, bare in zip(joint, self.bare, strict=True)]
        parts = [Jacobian(rest, shared, own) for rest, shared, own in zip(rests, self.shared, self.own, strict=True)]
        records = [SimpleNamespace(name=name, condition=(name,), believed=None, scale=np.array([NOISE]), size=size,
                                   on_samples=lambda rest: rest[None])
                   for name, size in zip(self.conditions, SIZES, strict=True)]
        errors = [RecordError(one.name, 0.0, 0.0, np.ones((1, one.size)), 0.0, 1.0, 1.0) for one in records]
        found, tests = less_open(SimpleNamespace(records=records), SimpleNamespace(parts=parts, residuals=rests), errors)
        return [one.residual[0] / NOISE for one in found], tests


@pytest.mark.parametrize("off", [0.0, 0.02])
@pytest.mark.parametrize("conditions", [("a", "b", "c"), ("a", "b", "b")])
def test_residuals_are_whitened_by_what_noise_and_the_fit_of_the_others_make_of_them(conditions, off):
    """Second road: every group truly left out of a fit, and the dense root of I + J C J^T; the joint fit may be unsettled."""
    linear = Linear(7, conditions)
    found, tests = linear.judged(off)
    assert [one.record for one in tests] == list(dict.fromkeys(conditions))
    for test in tests:
        group = [place for place, name in enumerate(conditions) if name == test.record]
        others = [place for place in range(3) if place not in group]
        rest = linear.residuals(others, group)
        slopes = np.vstack([linear.bare[place] for place in group])
        covariance = np.linalg.inv(sum(linear.bare[place].T @ linear.bare[place] for place in others))
        spread = np.eye(len(slopes)) + slopes @ covariance @ slopes.T
        whitened = np.linalg.inv(sqrtm(spread)) @ rest
        assert np.concatenate([found[place] for place in group]) == pytest.approx(whitened, abs=1e-8)
        along = slopes @ np.linalg.lstsq(slopes, rest, rcond=None)[0]
        assert test.statistic == pytest.approx(float(along @ np.linalg.solve(spread, along)), rel=1e-6)


def test_a_record_that_asks_for_other_parameters_is_told():
    assert all(test.p_value > 0.01 for test in Linear(7).judged()[1])
    asking = Linear(7, beside=1.5).judged()[1]
    assert asking[1].p_value < 1e-6


def test_of_one_condition_nothing_is_held_out_and_nothing_changed():
    found, tests = Linear(7, ("a", "a", "a")).judged()
    assert tests == [] and all(np.array_equal(one, np.ones(size) / NOISE) for one, size in zip(found, SIZES, strict=True))


def test_a_complete_model_is_adequate_where_the_other_cuts_leave_much_open():
    """Of the loudest of these cuts the others foretell so little that its residual recurs with the tooth."""
    random = np.random.default_rng([59, 5, False])
    truth, believed = machine(random)
    found = compare(predict, campaign(truth, random, 5), believed, catalogue())
    assert found.adequate
    assert {test.test for test in found.tests} == {"rms", "autocorrelation", "tooth angle", "parameters"}
    assert found.errors[0].squares > 1.05 * np.sum((found.fit.residuals[0] * found.fitter.records[0].scale) ** 2)
