"""Held-out residuals are judged in units of the noise and of what the other records leave open."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import sqrtm

from testbed.analysis.comparison.adequacy import less_open
from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.fit_state import Linearised
from testbed.analysis.fit.held_out import RecordError
from testbed.catalogue import catalogue
from testbed.engines import predict
from tests.validation.probable import campaign, machine

SIZES, NOISE = (40, 50, 60), 3e-6


@pytest.fixture
def slopes():
    """Slopes of three records by three shared unknowns, and by two of their own."""
    random = np.random.default_rng(7)
    loud = (5.0, 1.0, 1.0)  # the others know little of what the first shows
    return [Linearised(np.zeros(size), factor * random.standard_normal((size, 3)), random.standard_normal((size, 2)))
            for size, factor in zip(SIZES, loud, strict=True)]


def judged(slopes, residuals, conditions=("a", "b", "c")):
    records = [SimpleNamespace(name=name, condition=(name,), believed=None, scale=np.array([NOISE]), size=size,
                               on_samples=lambda rest: rest[None])
               for name, size in zip(conditions, SIZES, strict=True)]
    errors = [RecordError(one.name, 0.0, 0.0, NOISE * rest[None], 0.0, 1.0, 1.0)
              for one, rest in zip(records, residuals, strict=True)]
    found, tests = less_open(SimpleNamespace(records=records), SimpleNamespace(parts=slopes), errors)
    return [one.residual[0] / NOISE for one in found], tests


def without_own(slopes):
    return [part.shared - part.own @ np.linalg.lstsq(part.own, part.shared, rcond=None)[0] for part in slopes]


@pytest.mark.parametrize("conditions", [("a", "b", "c"), ("a", "b", "b")])
def test_residuals_are_whitened_by_what_noise_and_the_fit_of_the_others_make_of_them(slopes, conditions):
    by_hand = without_own(slopes)
    random = np.random.default_rng(1)
    residuals = [part.without_own(random.standard_normal(size) * 2.0) for part, size in zip(slopes, SIZES, strict=True)]
    found, tests = judged(slopes, residuals, conditions)
    assert [one.record for one in tests] == list(dict.fromkeys(conditions))
    for test in tests:
        group = [place for place, name in enumerate(conditions) if name == test.record]
        others = [place for place in range(3) if place not in group]
        own = np.vstack([by_hand[place] for place in group])
        covariance = np.linalg.inv(sum(by_hand[place].T @ by_hand[place] for place in others))
        spread = np.eye(len(own)) + own @ covariance @ own.T
        rest = np.concatenate([residuals[place] for place in group])
        whitened = np.linalg.inv(sqrtm(spread)) @ rest
        # the dense root is 1 on what own unknowns take, which the residual does not hold
        assert np.concatenate([found[place] for place in group]) == pytest.approx(whitened, abs=1e-9)
        along = own @ np.linalg.lstsq(own, rest, rcond=None)[0]
        assert test.statistic == pytest.approx(float(along @ np.linalg.solve(spread, along)), rel=1e-9)


def test_a_record_that_asks_for_other_parameters_is_told(slopes):
    random = np.random.default_rng(2)
    noise = [part.without_own(random.standard_normal(size)) for part, size in zip(slopes, SIZES, strict=True)]
    open_, other = without_own(slopes)[0] @ [0.1, -0.1, 0.05], without_own(slopes)[1] @ [0.0, 1.5, 0.0]
    assert all(test.p_value > 0.01 for test in judged(slopes, [noise[0] + open_, *noise[1:]])[1])
    asking = judged(slopes, [noise[0], noise[1] + other, noise[2]])[1]
    assert asking[1].p_value < 1e-6 and asking[2].p_value > 0.01


def test_of_one_condition_nothing_is_held_out_and_nothing_changed(slopes):
    residuals = [np.ones(size) for size in SIZES]
    found, tests = judged(slopes, residuals, ("a", "a", "a"))
    assert tests == [] and all(np.array_equal(one, NOISE * rest / NOISE) for one, rest in zip(found, residuals, strict=True))


def test_a_complete_model_is_adequate_where_the_other_cuts_leave_much_open():
    """Of the loudest of these cuts the others foretell so little that its residual recurs with the tooth."""
    random = np.random.default_rng([59, 5, False])
    truth, believed = machine(random)
    found = compare(predict, campaign(truth, random, 5), believed, catalogue())
    assert found.adequate
    assert {test.test for test in found.tests} == {"rms", "autocorrelation", "tooth angle", "parameters"}
    assert found.errors[0].squares > 1.05 * np.sum((found.fit.residuals[0] * found.fitter.records[0].scale) ** 2)
