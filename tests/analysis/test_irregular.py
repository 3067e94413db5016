"""Cuts that no model foretells are recognised, left out of the search, and told; those that a model follows are not."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest

from analysis.fit.fit_state import State
from analysis.fit.model_fit import model_fit
from analysis.fit.observed import observe
from analysis.search.diagnose import diagnose
from analysis.search.irregular import followed, irregular, parts
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.campaign_files import BELIEVED, TRUE
from tests.synthetic_campaign import synthetic_campaign

STIFF = TRUE.with_effect("cubic_stiffness", coefficient=1.5e14)
KNOWN = {name: catalogue()[name] for name in ("cubic_stiffness", "edge_force")}
PLANT = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=KNOWN),
                        predict_driven=partial(predict.predict_driven, catalogue=KNOWN))
REPEATING = ((4300, 2.5), (2700, 1.5), (3900, 2.2), (4200, 1.5))
CHAOTIC = (2700, 2.6)


@pytest.fixture(scope="module")
def observed():
    records = synthetic_campaign(partial(fast.simulate, steps=97), STIFF, seed=6, tests=(*REPEATING, CHAOTIC),
                                 course=(10, 60, 20), rate=3200.0)
    return [observe(record, BELIEVED) for record in records]


def test_the_cut_that_never_repeats_is_recognised_where_enough_others_do(observed):
    assert irregular(observed) == [4]
    assert irregular(observed[1:]) == []  # three others are too few
    assert irregular([replace(one, noise=one.noise * 1e3) for one in observed]) == []


def test_the_search_is_made_on_the_others_and_the_record_left_out_is_told(observed):
    found = diagnose(PLANT, observed, BELIEVED, KNOWN)
    assert (found.verdict, found.effects) == ("missing_effect", ("cubic_stiffness",))
    assert found.best.parameters["cubic_stiffness.coefficient"] == pytest.approx(1.5e14, rel=0.01)
    assert "Left out: 2700rpm_2.6mm" in found.sentence and "chaotic" in found.sentence
    assert len(found.best.fitter.records) == 4
    assert found.with_effects <= 1.05 * found.noise_floor  # which is read from ten short turns of idling


def test_motions_part_where_the_machine_is_chaotic_and_nowhere_else(observed):
    fitter, fit = model_fit(PLANT, observed[:4], STIFF, KNOWN)
    seen = followed(fitter, fit.state, observed, [4])
    assert seen.strange == seen.parting == (4,)
    for place in range(4):
        own = State(fit.state.model, fit.state.angle, (fit.state.nuisances[place],))
        assert not parts(fitter.of_records([place]), own)


def test_a_record_left_out_that_the_machine_follows_is_fitted_with_the_others(observed):
    fitter, fit = model_fit(PLANT, [*observed[:3]], STIFF, KNOWN)
    seen = followed(fitter, fit.state, observed[:4], [3])
    assert seen.strange == seen.parting == ()
    assert seen.fitted().mean_squares.max() < 1.15
