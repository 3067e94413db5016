"""Cuts that no model foretells are recognised, left out of the search, and told; those that a model follows are not."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest

from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.chaos_check import followed, irregular, parts
from testbed.analysis.search.diagnose import diagnose
from testbed.analysis.search.diagnosis import OtherForm, verdict_of
from testbed.analysis.search.refit_from_prior import from_believed
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

STIFF = TRUE.with_effect("cubic_stiffness", coefficient=1.5e14)
KNOWN = {name: catalogue()[name] for name in ("cubic_stiffness", "edge_force")}
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=KNOWN),
                        predict_driven=partial(predict.predict_driven, catalogue=KNOWN))
REPEATING = ((4300, 2.5), (2700, 1.5), (3900, 2.2), (4200, 1.5))
CHAOTIC = (2700, 2.6)


@pytest.fixture(scope="module")
def observed():
    records = synthetic_campaign(partial(fast.simulate, steps=97), STIFF, seed=6, tests=(*REPEATING, CHAOTIC),
                                 course=(10, 60, 20), rate=3200.0)
    return [observe(record, BELIEVED) for record in records]


@pytest.fixture(scope="module")
def believed(observed):
    """The base fit, a rough one, to all records."""
    return from_believed(ENGINE, observed, BELIEVED, (), KNOWN)


def test_the_cut_that_never_repeats_is_recognised_where_enough_others_do(observed):
    assert irregular(observed) == [4]
    assert irregular(observed[1:]) == []  # three others are too few
    assert irregular([replace(one, noise=one.noise * 1e3) for one in observed]) == []


@pytest.mark.long
def test_the_search_is_made_on_the_others_and_the_record_left_out_is_told(observed):
    found = diagnose(ENGINE, observed, BELIEVED, KNOWN)
    assert (found.verdict, found.effects) == ("missing_effect", ("cubic_stiffness",))
    assert found.best.parameters["cubic_stiffness.coefficient"] == pytest.approx(1.5e14, rel=0.01)
    assert "Left out: 2700rpm_2.6mm" in found.sentence and "chaotic" in found.sentence
    assert len(found.best.fitter.records) == 4
    assert found.with_effects <= 1.05 * found.noise_floor  # which is read from ten short turns of idling


def test_motions_part_where_the_machine_is_chaotic_and_nowhere_else(observed):
    fitter, fit = model_fit(ENGINE, observed[:4], STIFF, KNOWN)
    seen = followed(fitter, fit.state, observed, [4])
    assert seen.strange == seen.parting == (4,)
    assert not seen.state.nuisances[4].ends_in_arc()  # no beginning explains it: none within an arc was looked for
    for place in range(4):
        own = State(fit.state.model, fit.state.angle, (fit.state.nuisances[place],))
        assert not parts(fitter.of_records([place]), own)


def test_a_record_left_out_that_the_machine_follows_is_fitted_with_the_others(observed):
    fitter, fit = model_fit(ENGINE, [*observed[:3]], STIFF, KNOWN)
    seen = followed(fitter, fit.state, observed[:4], [3])
    assert seen.strange == seen.parting == ()
    assert seen.fitted().mean_squares.max() < 1.15


@pytest.mark.parametrize(("left_out", "model", "told"), [
    pytest.param(4, STIFF, "motions that begin almost at one place part there", id="chaotic by the law, too"),
    pytest.param(4, BELIEVED, "that law does not explain it", id="the law does not foretell it"),
    pytest.param(3, STIFF, "it explains that, too", id="the law foretells it"),
])
@pytest.mark.long
def test_a_law_found_on_the_others_is_held_against_the_irregular_record_and_ends_the_search(
        observed, believed, monkeypatch, left_out, model, told):
    def searched(base, engine, *_):
        assert len(base.fitter.records) == len(records) - 1  # no search on all records follows
        law = candidate_of(*model_fit(engine, base.fitter.records, model, KNOWN), ("cubic_stiffness",), None, 1.0)
        form = OtherForm("cubic_stiffness", 3.0, 5.0, 4.9, 5.1, 100.0, 1.0, {}, (), law)
        return replace(verdict_of(base, base, [base], (), 1e-9, ()), verdict="unexplained", form=form)

    records = observed if left_out == 4 else observed[:4]
    monkeypatch.setattr("testbed.analysis.search.diagnose._as_believed",
                        lambda _, records, *more: replace(believed, fitter=believed.fitter.on(records)))
    monkeypatch.setattr("testbed.analysis.search.diagnose.irregular", lambda _: [left_out])
    monkeypatch.setattr("testbed.analysis.search.diagnose._search", searched)
    found = diagnose(ENGINE, records, BELIEVED, KNOWN)
    assert found.verdict == "unexplained" and told in found.sentence and records[left_out].name in found.sentence
