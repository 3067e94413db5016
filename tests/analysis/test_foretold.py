"""A condition that shows what no other does: explained in the fit, foretold badly, and no reason to call the law wrong."""

from functools import partial
from types import SimpleNamespace

import pytest

from testbed.analysis.fit.held_out import NOTABLE, SUSPECT, pooled
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.diagnosis import verdict_of
from testbed.analysis.search.refit_from_prior import from_believed
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_record

KNOWN = catalogue()
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=KNOWN),
                        predict_driven=partial(predict.predict_driven, catalogue=KNOWN))
LAW = "cubic_stiffness"


def campaign(feed):
    """Three cuts at a small feed, in which the stiffness is as good as linear, and one at a large one."""
    true, simulate = TRUE.with_effect(LAW, coefficient=2e12), partial(fast.simulate, steps=37)
    feeds = ((3500, 0.8, 0.01e-3), (2850, 2.9, 0.01e-3), (3900, 2.2, 0.01e-3), (3810, 2.9, feed))
    records = [synthetic_record(simulate, true, rpm, depth * 1e-3, 40 + number, feed=feed, course=(10, 40, 15))
               for number, (rpm, depth, feed) in enumerate(feeds)]
    return [observe(record, BELIEVED) for record in records]


@pytest.fixture(scope="module")
def observed():
    return campaign(0.2e-3)


def fitted(observed, *names):
    return from_believed(ENGINE, observed, BELIEVED, names, KNOWN)


@pytest.mark.long
def test_what_one_condition_alone_shows_is_judged_in_the_fit(observed):
    base, right = fitted(observed), fitted(observed, LAW)
    noise = pooled(base.errors)[1]
    assert [one.squares_in_fit is not None for one in right.errors] == [False, False, False, True]
    assert right.error_held_out > 1.3 * noise  # the others do not know the law's strength
    assert right.error_where_known == pytest.approx(right.error_fit, rel=0.01)
    found = verdict_of(base, right, [base, right], (), noise, ())
    assert found.verdict == "missing_effect" and "cannot foretell" in found.sentence
    assert found.with_effects == right.error_held_out  # the error that is told stays the one on what was left out


def test_a_condition_foretold_a_little_worse_than_it_is_explained_is_judged_in_the_fit_as_well():
    right = fitted(campaign(0.1e-3), LAW)
    *others, loud = right.errors
    assert NOTABLE < loud.squares / loud.squares_in_fit < SUSPECT and all(one.squares_in_fit is None for one in others)
    assert right.error_where_known == pytest.approx(right.error_fit, rel=0.01)
    assert right.error_held_out > 1.02 * right.error_fit


def test_a_model_that_the_others_contradict_is_judged_on_what_was_left_out(observed):
    base = fitted(observed)
    assert base.errors[3].squares_in_fit is None
    assert base.error_where_known == base.error_held_out
