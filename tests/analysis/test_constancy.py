"""Base parameters test by test: found where they were put, and trends told from chance."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.comparison.constancy import COVARIATES, PARAMETERS, TestFit, constancy, judged
from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.free_parameters import free_parameters
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import MARK_ANGLE, synthetic_record

CATALOGUE = catalogue()
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=CATALOGUE),
                        predict_driven=partial(predict.predict_driven, catalogue=CATALOGUE))


def fitted_at(values, errors, x, parameter="tangential_coefficient", covariate="feed per tooth"):
    """Tests already fitted: values with standard errors at x of one covariate, the others alike."""
    found = []
    for value, error, place in zip(values, errors, x, strict=True):
        conditions = dict.fromkeys(COVARIATES, 1.0) | {covariate: place}
        half = 1.959964 * error
        found.append(TestFit(f"t{place}", conditions, {parameter: Estimate(value, value - half, value + half, "1")}, True))
    return found


def test_a_trend_is_found_and_said():
    feed = np.linspace(0.05e-3, 0.3e-3, 8)
    values = 5e8 + 4e3 / feed  # an edge force as a chip force: K_t = K_tc + K_te / h
    found = judged(fitted_at(values, 0.002 * values, feed))
    trend = found.drift("tangential_coefficient")
    assert trend is not None and trend.covariate == "feed per tooth" and trend.change < 0
    assert found.verdict("tangential_coefficient").startswith("drifts: falls with feed per tooth")


def test_a_test_whose_interval_is_too_small_does_not_rule():
    x = np.linspace(1.0, 2.0, 8)
    values = 100.0 * (1 + 0.01 * np.random.default_rng(3).standard_normal(8))
    errors = np.full(8, 0.1)
    errors[0] = 1e-4
    found = judged(fitted_at(values, errors, x))
    assert found.drift("tangential_coefficient") is None
    assert "scatters by" in found.verdict("tangential_coefficient")


def test_chance_is_rarely_called_a_trend():
    random = np.random.default_rng(5)
    alarms = 0
    for _ in range(200):
        x = random.uniform(1.0, 2.0, 8)
        values = 100.0 + 3.0 * random.standard_normal(8)
        alarms += judged(fitted_at(values, np.full(8, 3.0), x)).drift("tangential_coefficient") is not None
    assert alarms <= 20  # 10 expected at the most
    still = judged(fitted_at(100.0 + 0.01 * np.arange(8), np.full(8, 1e-6), np.arange(1.0, 9.0)))
    assert still.drift("tangential_coefficient") is None  # certain, and too small to matter
    assert "too little to matter" in still.verdict("tangential_coefficient")


def test_nothing_is_called_constant_whose_intervals_exclude_each_other():
    random = np.random.default_rng(11)
    said = set()
    for _ in range(300):
        values = 100.0 + random.choice([0.01, 0.3, 3.0]) * random.standard_normal(20)
        tests = fitted_at(values, np.full(20, 0.3), np.arange(20.0))
        found, estimates = judged(tests), [test.parameters["tangential_coefficient"] for test in tests]
        apart = max(one.low for one in estimates) > min(one.high for one in estimates)
        verdict, short = found.verdict("tangential_coefficient"), found.short("tangential_coefficient")
        assert not (apart and ("is constant" in verdict or "not differ beyond its intervals" in verdict or short == "constant"))
        said.add(short)
    assert {"constant", "scatters", "differs as chance may have it"} <= said


def test_few_tests_scatter_but_show_no_trend():
    found = judged(fitted_at([1.0, 2.0, 3.0], [0.01] * 3, [1.0, 2.0, 3.0]))
    assert found.trends == () and "too few for a trend" in found.verdict("tangential_coefficient")
    assert "scatters by" in found.verdict("tangential_coefficient")
    alone = judged(fitted_at([1.0], [0.01], [1.0]))
    assert alone.verdict("tangential_coefficient") == "one test alone cannot say"


FEEDS = (0.05e-3, 0.08e-3, 0.14e-3, 0.25e-3)


def campaign(true):
    made = [synthetic_record(partial(fast.simulate, steps=37), true, 4300, 1.5e-3, 50 + place, feed=feed)
            for place, feed in enumerate(FEEDS)]
    records = [observe(replace(record, name=f"feed {feed}"), BELIEVED) for record, feed in zip(made, FEEDS, strict=True)]
    fitter = Fitter(ENGINE, records, free_parameters(records, TRUE))
    state = State(TRUE, MARK_ANGLE, tuple(first_nuisances(record, MARK_ANGLE) for record in records))
    return constancy(fitter, alternate_fit_and_passes(fitter, state, rounds=2, iterations=8), CATALOGUE)


def test_a_complete_model_has_constant_constants():
    found = campaign(TRUE)
    assert found.parameters == PARAMETERS and len(found.tests) == len(FEEDS)
    for parameter in PARAMETERS:
        assert found.drift(parameter) is None, found.verdict(parameter)
        for test in found.tests:
            one = test.parameters[parameter]
            assert one.value == pytest.approx(TRUE.value(parameter), abs=2.5 * (one.high - one.low), rel=0.005)


def test_an_edge_force_shows_as_a_coefficient_that_falls_with_feed():
    found = campaign(TRUE.with_effect("edge_force", tangential=1e3, normal=5e2))
    values = [test.parameters["normal_coefficient"].value for test in found.tests]
    assert values[0] > values[1] > 1.2 * values[2] > 1.44 * values[3]
    trend = found.drift("normal_coefficient")
    assert trend is not None and trend.covariate == "feed per tooth" and trend.change < -0.3
