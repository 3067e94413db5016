"""Formulas alike to a regression: does a fit of the whole model to the records tell the true one from the others?"""

from dataclasses import replace

import pytest
from test_explain_force import WRONG, decays

from analysis.explain_force import explanations
from analysis.formula_trial import Jury, _Trial
from testbed.cli._fitting import plant_of
from testbed.effect import catalogue

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
    jury = Jury(plant_of, missing.observed, WRONG, catalogue(), said.append)
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
    monkeypatch.setattr(Jury, "_from", lambda self, bare: [both, right])
    jury = Jury(plant_of, (), WRONG, {})
    assert names(jury.likeliest([both])) == ["stiffness_5"]
    left[1] = 2.0
    assert len(names(jury.likeliest([both]))) == 2  # the shorter one leaves more than noise


def test_without_a_formula_nothing_is_fitted():
    with pytest.raises(ValueError, match="no explanation"):
        Jury(plant_of, (), WRONG, {}).likeliest([])
    nothing = explanations(decays(lambda x, v: 0.0))
    assert Jury(plant_of, (), WRONG, {}).likeliest(nothing) is nothing[0]
