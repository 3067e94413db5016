"""What a fit tells, as machines are drawn from it: its intervals, and a deviation of the file joined to them."""

from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.estimates import estimates
from testbed.analysis.fit.identifiable import DOUBT
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.information import Z_95
from testbed.analysis.probable.posterior import posterior
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from testbed.files.campaign import Record
from testbed.recording import Recording
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import COURSE, synthetic_campaign

EVERY = catalogue()
HELD = "normal_coefficient"


@pytest.fixture(scope="module")
def fitted():
    made = synthetic_campaign(fast.simulate, TRUE, seed=5, tests=((3810, 2.0), (2850, 1.5)), rate=3200.0, course=COURSE)
    return model_fit(predict, [observe(record, TRUE) for record in made], BELIEVED, EVERY)


def test_the_deviations_are_those_of_the_intervals(fitted):
    fitter, fit = fitted
    found = estimates(fitter, fit, EVERY)
    told = posterior(fitter, fit, found, BELIEVED, EVERY)
    half = [(found[path].high - found[path].low) / (2 * Z_95) for path in told.known.paths]
    assert told.known.deviations == pytest.approx(half, rel=1e-6) and told.given == ()
    scale = np.sqrt(np.outer(np.diag(fit.covariance), np.diag(fit.covariance)))[:4, :4]
    drawn = told.known.covariance / np.outer(told.known.deviations, told.known.deviations)
    assert np.allclose(drawn, fit.covariance[:4, :4] / scale, atol=1e-9)  # and so are the correlations
    assert abs(drawn[2, 3]) > 0.5


@pytest.mark.parametrize("share", [0.02, 1.0, 50.0])
def test_a_deviation_of_the_file_is_one_more_measurement(fitted, share):
    """Held, with a deviation of so many times what the records tell: joined as Gauss joins them, and what it pulls along."""
    fitter, fit = fitted
    whole = posterior(fitter, fit, estimates(fitter, fit, EVERY), BELIEVED, EVERY).known
    place = whole.paths.index(HELD)
    deviation = share * float(whole.deviations[place])
    without = fitter.without(HELD)
    again = without.fit(fit.state, iterations=3)
    values = {**estimates(without, again, EVERY), HELD: Estimate(2e8, 2e8, 2e8, "N/m^2", bounded=False)}
    told = posterior(without, again, values, replace(BELIEVED, spreads=((HELD, deviation),)), EVERY)
    joined = np.linalg.inv(whole.covariance)
    joined[place, place] += deviation**-2
    exact = np.linalg.inv(joined)
    order = [whole.paths.index(path) for path in told.known.paths]
    assert told.given == () and HELD in told.known.paths
    assert told.known.deviations == pytest.approx(np.sqrt(np.diag(exact))[order], rel=0.05)
    guess = posterior(without, again, values, BELIEVED, EVERY)  # without one: as beliefs may be off
    size = again.state.model.cutting.tangential_coefficient
    assert guess.given == (HELD,) and guess.assumed == {HELD: pytest.approx(DOUBT[HELD] * 0.2 * size)}  # 30 % of the larger
    joined[place, place] += guess.assumed[HELD] ** -2 - deviation**-2
    assert guess.known.deviations == pytest.approx(np.sqrt(np.diag(np.linalg.inv(joined)))[order], rel=0.05)


def test_an_immersion_with_a_deviation_is_joined_and_pulls_the_coefficients_along(fitted):
    fitter, fit = fitted
    found = estimates(fitter, fit, EVERY)
    plain = posterior(fitter, fit, found, BELIEVED, EVERY).known
    known = posterior(fitter, fit, found, replace(BELIEVED, spreads=(("immersion", 0.004),)), EVERY).known
    assert known.paths == (*plain.paths, "immersion")
    assert known.deviations[-1] < 0.004 * (1 + 1e-9) and np.all(known.deviations[:-1] >= plain.deviations * (1 - 1e-6))
    place = known.paths.index("tangential_coefficient")
    assert known.deviations[place] > 1.5 * plain.deviations[place]


def test_where_nothing_cuts_the_file_alone_speaks_of_the_coefficients():
    clean = predict.predict_driven([TRUE], [(6e-5, 0.0)], np.zeros(3000), 3200.0, ("displacement",))[0, 0]
    measured = clean + 5e-7 * np.random.default_rng(3).standard_normal(clean.size)
    recording = Recording({"displacement": measured}, 3200.0, {"displacement": "m"}, "measured")
    decay = Record("tap", "ring-down", recording, {})
    believed = replace(TRUE, spreads=(("tangential_coefficient", 5e7), ("mass", 0.1)))
    fitter, fit = model_fit(predict, [observe(decay, TRUE)], TRUE, EVERY)
    known = posterior(fitter, fit, estimates(fitter, fit, EVERY), believed, EVERY).known
    assert known.paths == ("natural_frequency", "damping_ratio", "tangential_coefficient", "mass")
    assert known.deviations[2:] == pytest.approx([5e7, 0.1]) and np.all(known.covariance[2:, :2] == 0.0)
    assert known.deviations[0] < 0.1 and np.all(known.drawn(200, 1)[:, 2] > 0.0)
