"""Formulas alike to a regression: does a fit of the whole model to the records tell the true one from the others?"""

from dataclasses import replace

import pytest

from testbed.analysis.fit.effect_start import effect_parameters
from testbed.analysis.force.explain_force import explanations
from testbed.analysis.force.formula_trial import Jury, _Trial
from testbed.analysis.force.trial_law import NAME, trial_law
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from tests.analysis.test_explain_force import WRONG, decays

STRENGTH = 4e20


@pytest.fixture(scope="module")
def missing():
    return decays(lambda x, v: -STRENGTH * x**5)


def names(explanation):
    return [one.term.name for one in explanation.formula]


def test_what_a_wrong_formula_has_led_nearer_to_the_truth_shows_the_right_one(missing):
    told = explanations(missing)
    assert names(told[0]) == ["stiffness_5"] and len(told) > 1
    wrong = next(one for one in told if names(one) == ["stiffness_3"])
    said = []
    jury = Jury(plant_of, WRONG, catalogue(), said.append)
    best = jury.likeliest([wrong])
    assert names(best) == ["stiffness_5"]
    assert best.formula[0].value == pytest.approx(STRENGTH, rel=0.05)
    tried = [text for text in said if text.startswith("fitting")]
    assert len(tried) == 2 and "x^3" in tried[0] and "x^5" in tried[1]  # the second leaves but noise: no third is tried


def test_a_term_that_the_fit_does_not_need_is_left_out(missing, monkeypatch):
    right, other, *_ = explanations(missing)
    both = replace(right, formula=(*right.formula, *other.formula))
    left = {1: 1.0, 2: 1.0}  # by the number of terms: what their fits leave
    monkeypatch.setattr(Jury, "_trial", lambda self, one: _Trial(one, 0.0, left[len(one.formula)], right.state))
    monkeypatch.setattr(Jury, "_from", lambda self, trial: [both, right])
    jury = Jury(plant_of, WRONG, {})
    assert names(jury.likeliest([both])) == ["stiffness_5"]
    left[1] = 2.0
    assert len(names(jury.likeliest([both]))) == 2  # the shorter one leaves more than noise


def test_without_a_formula_nothing_is_fitted():
    with pytest.raises(ValueError, match="no explanation"):
        Jury(plant_of, WRONG, {}).likeliest([])
    nothing = explanations(decays(lambda x, v: 0.0))
    assert Jury(plant_of, WRONG, {}).likeliest(nothing) is nothing[0]


def test_formulas_on_trial_share_one_engine_and_free_their_own_terms_alone(missing, tmp_path):
    right, *others = explanations(missing)
    other = next(one for one in others if names(one) == ["stiffness_3"])
    texts = []
    for told in (right, other):
        law = trial_law(told, tmp_path)
        texts.append(law.path.read_text())
        assert [one.path for one in effect_parameters(law, missing.observed)] == [f"{NAME}.{term}" for term in names(told)]
        values = {**law.neutral(), **law.example()}
        force = law.hooks["structure_force"](displacement=7e-5, velocity=0.3, **values)
        order = int(names(told)[0][-1])
        assert force == pytest.approx(-told.formula[0].value * 7e-5**order)
    assert texts[0] == texts[1]  # engines are kept by the text of the file
