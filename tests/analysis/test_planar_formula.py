"""A law of no catalogue, hidden in a machine in x and y that MuJoCo cuts: is it written, and with the right number?"""

import math
from dataclasses import replace

import pytest

from testbed.analysis.fit.observe import observe
from testbed.analysis.force import planar_formula
from testbed.analysis.force.explanation import as_json, write_effect
from testbed.analysis.force.formula_trial import Jury
from testbed.analysis.force.planar_formula import explanations_about
from testbed.analysis.force.terms import planar_structure_terms, term_value
from testbed.analysis.search.candidate_round import by_noise
from testbed.analysis.search.refit_from_prior import from_believed
from testbed.api.fitting import engine_of
from testbed.catalogue import catalogue, read_effect
from testbed.engines import mujoco_engine
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from testbed.trial.proposal import Coefficient, effect_text
from tests.support.planar_campaign import planar_campaign

STRENGTH = 3e16  # N/m^3
LAW = '''"""Hidden."""
from testbed.effect import Effect, Parameter

EFFECT = Effect(title="Hidden", parameters=(Parameter("k", "k", "N/m^3", "strength", neutral=0.0, bounds=(0.0, 1e20),
                                                      example=1e15, start=1e15),),
                law="F_y = -k y^3", source="a test", validity="a test", leaves="a test")


def structure_force_y(displacement_y, k):
    return -k * displacement_y**3
'''
MACHINE = Model(Structure.of((Mode(1.1, 180.0, 0.02, math.radians(15)), Mode(0.8, 260.0, 0.02, math.radians(100)))),
                Cutter(2, 16e-3), Cutting("down-milling", 0.15, 7e8, 2.5e8))
BELIEVED = MACHINE.with_values({"modes[0].natural_frequency": 182.0, "modes[1].damping_ratio": 0.024,
                                "tangential_coefficient": 7.8e8})
PLACES = (("displacement_x", "workpiece"), ("displacement_y", "workpiece"))
TESTS = ((3300.0, 0.3e-3), (4100.0, 0.25e-3))
FEW = ("stiffness_3_x", "stiffness_3_y", "stiffness_5_y", "damping_3_y", "square_t", "rubbing_n")


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    folder = tmp_path_factory.mktemp("laws")
    (folder / "hidden.py").write_text(LAW)
    makers = catalogue(str(folder))

    def simulate(model, cut, sampling, channels):
        return mujoco_engine.simulate(model.with_effect("hidden", k=STRENGTH), cut, sampling, channels=channels,
                                      catalogue=makers)

    return planar_campaign(simulate, MACHINE, TESTS, PLACES, course=(5, 10, 5), rate=3000.0)


def names(explanation):
    return [one.term.name for one in explanation.formula]


@pytest.mark.long
def test_a_law_across_the_feed_is_written_with_its_number(records, tmp_path, monkeypatch):
    whole = planar_formula.planar_library
    monkeypatch.setattr(planar_formula, "planar_library",
                        lambda *given: [term for term in whole(*given) if term.name in FEW])  # compiles in less time
    observed = [observe(record, BELIEVED) for record in records]
    base = by_noise(from_believed(engine_of(catalogue()), observed, BELIEVED, (), catalogue()))
    assert base.error_held_out > 3 * 0.01
    said = []
    jury = Jury(engine_of, BELIEVED, catalogue(), said.append)
    told = explanations_about(engine_of, base.fitter, base.fit, catalogue())
    best = jury.likeliest(told)
    assert names(best) == ["stiffness_3_y"] and best.share > 0.95
    (one,) = best.formula
    assert one.value == pytest.approx(STRENGTH, rel=0.04) and one.low < STRENGTH < one.high
    for path in ("modes[0].natural_frequency", "modes[1].natural_frequency", "modes[1].damping_ratio"):
        assert best.state.model.value(path) == pytest.approx(MACHINE.value(path), rel=0.02)
    assert "F_y = " in best.sentence and "y^3" in best.sentence and "leaves" not in best.sentence
    assert "leaves 25 times the noise of a record" in replace(best, left=25.0).sentence
    written = read_effect(write_effect(best, tmp_path, "found"))
    assert list(written.hooks) == ["structure_force_y"] and as_json(best)["formula"][0]["acts"] == "structure_force_y"
    monkeypatch.setattr(planar_formula, "MOST_BYTES", 1000)
    with pytest.raises(ValueError, match="slopes by 6 terms of all records would take"):
        explanations_about(engine_of, base.fitter, base.fit, catalogue())
    monkeypatch.setattr(planar_formula, "MOST_BYTES", 10**9)
    # about the fit with its formula the same one is found again, and the machine's own numbers stay where they are
    fitted = jury._trial(best).fitted
    again = explanations_about(engine_of, *fitted, catalogue())[0]
    assert names(again) == ["stiffness_3_y"] and again.formula[0].value == pytest.approx(one.value, rel=1e-3)


def test_every_law_along_x_has_its_like_along_y():
    terms = {term.name: term for term in planar_structure_terms()}
    here = {"displacement": 2e-5, "velocity": -0.3, "displacement_y": -4e-5, "velocity_y": 0.07}
    turned = {"displacement": here["displacement_y"], "velocity": here["velocity_y"]}
    assert len(terms) == 28 and len({term.law for term in terms.values()}) == 28
    for name, term in terms.items():
        if name.endswith("_y"):
            assert term.hook == "structure_force_y" and not {"displacement", "velocity"} & set(term.arguments)
            assert term_value(term, here) == term_value(terms[name[:-1] + "x"], turned)


def test_a_law_across_the_feed_is_a_file_that_pushes_across_it(tmp_path):
    terms = [term for term in planar_structure_terms() if term.name in ("damping_2_x", "friction_y", "stiffness_3_y")]
    path = tmp_path / "law.py"
    path.write_text(effect_text("law", [Coefficient(term, 2.0, 1.0, 3.0) for term in terms], share=0.5, story="a story"))
    law = read_effect(path)
    assert set(law.hooks) == {"structure_force", "structure_force_y"}
    pushed = law.hooks["structure_force_y"](displacement_y=1e-3, velocity_y=5.0, friction_y=2.0, stiffness_3_y=4.0)
    assert pushed == pytest.approx(-2.0 - 4e-9)
    assert law.law == "F = -damping_2_x v |v|; F_y = -stiffness_3_y y^3 - friction_y tanh(v_y / 0.001)"
