"""A sampling rate that is written down half a per cent wrong looks like a spindle that slips: intervals hold both."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest

from testbed.analysis.fit.estimates import clock_factor, clock_note, estimates
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

KNOWN = catalogue()
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=KNOWN),
                        predict_driven=partial(predict.predict_driven, catalogue=KNOWN))


def fitted(off, seed):
    """The fit of four cuts whose stated sampling rate is `off` times the true one."""
    records = synthetic_campaign(partial(fast.simulate, steps=37), TRUE, seed=seed, rate=6400.0)[:4]
    wrong = []
    for record in records:
        was = record.recording
        marks = was.start + (was.marks - was.start) / off
        wrong.append(replace(record, recording=replace(was, sampling_rate=was.sampling_rate * off, marks=marks)))
    return model_fit(ENGINE, [observe(record, BELIEVED) for record in wrong], BELIEVED, KNOWN)


@pytest.mark.parametrize(("off", "seed"), [(1.005, 1), (0.995, 2)])
def test_the_interval_of_a_frequency_holds_the_truth_where_the_clock_may_be_off(off, seed):
    fitter, fit = fitted(off, seed)
    found, true = estimates(fitter, fit, KNOWN)["natural_frequency"], TRUE.structure.natural_frequency
    assert found.value == pytest.approx(true * off, rel=5e-4)
    assert found.low <= true <= found.high and found.high - found.low < 0.012 * true
    for name in ("tangential_coefficient", "normal_coefficient"):  # forces by the mass, which is held, go by its square
        assert (one := estimates(fitter, fit, KNOWN)[name]).low <= TRUE.value(name) <= one.high
    assert clock_factor(fitter, fit) == pytest.approx(off, rel=1e-3)
    assert "sampling rate may be off" in clock_note(fitter, fit)[0]


def test_a_clock_that_is_right_leaves_the_interval_narrow():
    fitter, fit = fitted(1.0, 3)
    found = estimates(fitter, fit, KNOWN)["natural_frequency"]
    assert clock_note(fitter, fit) == [] and found.high - found.low < 1e-3 * found.value
