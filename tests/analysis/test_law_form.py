"""Is another law told from the one it was named by, and the named one left alone where it holds?"""

from types import SimpleNamespace

import pytest
from plain_cut import TRUE, free_decays

from analysis.search.begun_anew import from_believed
from analysis.search.diagnose import diagnose
from analysis.search.diagnosis import as_json
from analysis.search.law_form import other_form
from testbed.catalogue import catalogue
from testbed.engines import predict

PLANT = SimpleNamespace(predict_cuts=predict.predict_cuts, predict_driven=predict.predict_driven)
KNOWN = catalogue()
BELIEVED = TRUE.with_values({"natural_frequency": 146.7, "damping_ratio": 0.0045})
DAMPED = BELIEVED.with_effect("quadratic_damping", coefficient=250.0)
DAMPING = {"quadratic_damping": KNOWN["quadratic_damping"]}


def asked(law, *names):
    """What is said of the laws of these effects, fitted to decays under another."""
    return other_form(from_believed(PLANT, free_decays(law), BELIEVED, names, KNOWN), KNOWN, lambda text: None)


@pytest.mark.parametrize(("law", "name"), [
    (lambda x, v: -300.0 * abs(v) * v, "quadratic_damping"),
    (lambda x, v: -5e12 * x**3, "cubic_stiffness"),
])
def test_a_law_that_holds_is_left_alone(law, name):
    assert asked(law, name) is None


@pytest.mark.parametrize(("law", "name", "exponent"), [
    (lambda x, v: -1500.0 * v**3, "quadratic_damping", 3.0),
    (lambda x, v: -300.0 * abs(v) ** 0.5 * v, "quadratic_damping", 1.5),
    (lambda x, v: -2e19 * x**5, "cubic_stiffness", 5.0),
])
def test_the_exponent_of_another_law_is_found(law, name, exponent):
    found = asked(law, name)
    assert found.effect == name and found.low < exponent < found.high and found.high - found.low < 0.8
    assert found.value == pytest.approx(exponent, abs=0.2) and found.delta_bic > 20.0 and found.needless == ()


def test_what_only_helped_to_imitate_the_law_is_needless():
    found = asked(lambda x, v: -1500.0 * v**3, "quadratic_damping", "cubic_stiffness")
    assert found.value == pytest.approx(3.0, abs=0.2) and found.needless == ("cubic_stiffness",)
    assert "makes cubic_stiffness needless" in found.sentence


def test_an_exponent_that_leaves_more_than_noise_is_no_law():
    """Of two powers and a spring on one side a single power between them explains more than the cube, but not all."""
    assert asked(lambda x, v: -1e12 * x**3 - 1e20 * x**5 - 3e8 * x**2 * (x > 0), "cubic_stiffness") is None


@pytest.mark.parametrize("model", [
    pytest.param(BELIEVED.with_effect("dry_friction", **KNOWN["dry_friction"].example()), id="no file gives another form"),
    pytest.param(DAMPED.with_effect("quadratic_damping", coefficient=250.0, exponent=2.0), id="its owner states it"),
])
def test_an_exponent_is_not_asked_where(model):
    said = []
    fitted = SimpleNamespace(effects=tuple(model.effects), fit=SimpleNamespace(state=SimpleNamespace(model=model)), fitter=())
    assert other_form(fitted, KNOWN, said.append) is None and not said


def test_a_law_that_the_model_has_is_asked_too():
    found = diagnose(PLANT, free_decays(lambda x, v: -300.0 * abs(v) ** 1.5 * v), DAMPED, DAMPING)
    assert found.verdict == "unexplained" and found.form.effect == "quadratic_damping"
    assert found.form.value == pytest.approx(2.5, abs=0.2) and found.form.low < 2.5 < found.form.high
    holds = diagnose(PLANT, free_decays(lambda x, v: -300.0 * abs(v) * v), DAMPED, DAMPING)
    assert holds.verdict == "adequate" and holds.form is None


def test_a_diagnosis_calls_a_named_law_unknown_where_its_exponent_is_another():
    found = diagnose(PLANT, free_decays(lambda x, v: -1500.0 * v**3), BELIEVED, DAMPING)
    assert found.verdict == "unexplained" and found.form is not None
    assert found.form.value == pytest.approx(3.0, abs=0.2)
    told = as_json(found, BELIEVED)["other_law"]
    assert set(told["parameters"]) == {"coefficient", "exponent", "reference_velocity"}
    assert told["parameters"]["exponent"] == told["value"]
    assert told["effect"] == "quadratic_damping" and told["stated"] == 2.0 and told["low"] < 3.0 < told["high"]
    assert "The law itself is another" in found.sentence
