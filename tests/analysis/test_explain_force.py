"""Is a hidden law found as a short formula, nothing where nothing hides, and what the force depends on ranked right?"""

from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observe import observe
from testbed.analysis.force.explain_force import explain, explanations_from
from testbed.analysis.force.explanation import as_json, formula_text, write_effect
from testbed.analysis.force.latent_force import by_the_marks, missing_force
from testbed.analysis.force.ranking import explained, rank
from testbed.catalogue import read_effect
from tests.analysis.test_latent_force import ENGINE, cut_state
from tests.support.plain_cut import MARK, RELEASED, TRUE, free_decays, record

WRONG = TRUE.with_values({"natural_frequency": 146.7, "damping_ratio": 0.0045})


def decays(structure_law):
    """What a wrong model lacks in free decays from several displacements."""
    state = State(WRONG, 0.0, tuple(Nuisances(displacement=amplitude) for amplitude in RELEASED))
    return missing_force(ENGINE, free_decays(structure_law), state, {})


@pytest.mark.parametrize(
    ("name", "law", "value"),
    [
        ("damping_3", lambda x, v: -3000.0 * v**3, 3000.0),
        ("damping_xx", lambda x, v: -4e9 * x**2 * v, 4e9),
        ("stiffness_5", lambda x, v: -4e20 * x**5, 4e20),
    ],
)
def test_a_law_of_the_structure_is_read_off_free_decays(name, law, value):
    found = explain(decays(law))
    assert [one.term.name for one in found.formula] == [name]
    assert found.formula[0].value == pytest.approx(value, rel=0.04)
    assert found.formula[0].low < found.formula[0].value < found.formula[0].high
    assert found.share > 0.95
    assert found.state.model.structure.natural_frequency == pytest.approx(146.4, abs=0.03)
    assert found.state.model.structure.damping_ratio == pytest.approx(0.0032, rel=0.1)
    assert found.in_cut == () and len(found.maps["in_cut"]["force"]) == 0


def test_where_nothing_hides_nothing_is_proposed(tmp_path):
    found = explain(decays(lambda x, v: 0.0))
    assert found.formula == () and found.share == 0.0 and "No force of the library" in found.sentence
    with pytest.raises(ValueError, match="nothing to write"):
        write_effect(found, tmp_path, "proposal")
    assert list(tmp_path.iterdir()) == []


def test_with_one_condition_nothing_is_said_to_be_held_out(tmp_path):
    many = explain(decays(lambda x, v: -4e20 * x**5))
    alike = [replace(one, condition=("ring-down", "tap")) for one in many.missing.observed]
    single = replace(many, observed=tuple(alike))
    assert many.held_out and "of the misfit on held-out conditions" in many.sentence
    assert not single.held_out and "of the misfit in the regression itself" in single.sentence
    assert "held-out conditions" not in single.sentence
    assert "operating conditions held out" in write_effect(many, tmp_path, "many").read_text()
    assert "held out" not in write_effect(single, tmp_path, "single").read_text()


def test_a_described_force_is_not_also_said_to_go_with_nothing():
    found = explain(decays(lambda x, v: -3000.0 * v**3))
    assert "Out of the cut the missing force goes with velocity" in found.sentence
    scattered = {name: values if name != "force" else np.random.default_rng(4).normal(size=len(values))
                 for name, values in found.maps["out_of_cut"].items()}
    lost = replace(found)
    lost.__dict__["maps"] = {"in_cut": found.maps["in_cut"], "out_of_cut": scattered}
    assert "v^3" in lost.sentence and "goes with" not in lost.sentence
    unknown = replace(found, formula=(), share=0.0)
    unknown.__dict__["maps"] = lost.maps
    assert unknown.sentence == ("No force of the library explains what is missing. "
                                "Out of the cut the missing force goes with nothing that was measured.")


CHIP_LAW = 2.0e12  # N/m^3, by the square of the chip


@pytest.fixture(scope="module")
def cuts():
    made = [
        record(rpm, depth, seed, tooth_law=lambda depth, chip, angle: CHIP_LAW * depth * chip * chip)
        for seed, (rpm, depth) in enumerate(((3500.0, 1.5e-3), (4200.0, 2.0e-3), (2700.0, 1.5e-3)))
    ]
    return [observe(one, TRUE) for one in made]


@pytest.mark.long
def test_a_record_that_a_fit_has_turned_from_its_marks_is_read_by_the_marks(cuts):
    state = cut_state(cuts)
    astray = replace(state, nuisances=(replace(state.nuisances[0], angle=0.7), *state.nuisances[1:]))
    assert by_the_marks(cuts, state) is None
    assert by_the_marks(cuts, astray) == state
    assert by_the_marks([replace(one, clock_error=None) for one in cuts], astray) is None  # no marks: any angle may be
    names = [[one.term.name for one in found.formula]
             for found in (explain(missing_force(ENGINE, cuts, astray, {})), explanations_from(ENGINE, cuts, astray, {})[0])]
    assert names[0] != ["square_n"] and names[1] == ["square_n"]


def test_a_law_of_the_chip_is_read_off_cuts_and_written(cuts, tmp_path):
    records, law = cuts, CHIP_LAW
    bent = TRUE.with_values({"tangential_coefficient": 4.5e8, "normal_coefficient": 5.0e8, "damping_ratio": 0.0034})
    state = replace(cut_state(records, bent), angle=MARK - 0.03)
    found = explain(missing_force(ENGINE, records, state, {}))
    assert [one.term.name for one in found.formula] == ["square_n"]
    assert found.formula[0].value == pytest.approx(law, rel=0.05)
    assert found.state.angle == pytest.approx(MARK, abs=0.01)
    assert found.state.model.cutting.tangential_coefficient == pytest.approx(5.5e8, rel=0.05)
    assert any("chip" in one.variables for one in found.in_cut[:3])
    assert all(one.share < 0.2 for one in found.out_of_cut)
    effect = read_effect(write_effect(found, tmp_path, "proposal"))
    assert effect.example()["square_n"] == pytest.approx(found.formula[0].value, rel=1e-5)
    assert found.start("proposal").model.effects["proposal"]["square_n"] == found.formula[0].value
    answer = as_json(found)
    assert answer["formula"][0]["acts"] == "normal_force" and "b h^2" in formula_text(found.formula)
    assert set(found.maps["in_cut"]) >= {"displacement", "velocity", "force"}


def samples(force, **variables):
    count = len(force)
    return {"force": force, "deviation": np.ones(count), "condition": np.arange(count) * 4 // count, **variables}


def test_the_variable_that_the_force_goes_with_is_ranked_first():
    random = np.random.default_rng(0)
    x, v, chip = random.uniform(-2.0, 2.0, (3, 8000))
    noise = 0.3 * random.standard_normal(8000)
    single = rank(samples(x**3 + noise, displacement=x, velocity=v, chip=chip))
    assert "displacement" in single[0].variables
    alone = {one.variables: one.share for one in single if len(one.variables) == 1}
    assert alone["displacement",] > 0.9 and abs(alone["velocity",]) < 0.03 and abs(alone["chip",]) < 0.03
    pair = rank(samples(x * v + noise, displacement=x, velocity=v, chip=chip))
    assert set(pair[0].variables) == {"displacement", "velocity"} and pair[0].share > 0.6
    assert rank(samples(x[:50], displacement=x[:50])) == ()


def test_what_holds_in_one_condition_only_explains_nothing():
    """A bin that no other condition has says nothing of this one."""
    time = np.linspace(0.0, 1.0, 4000)
    force = np.floor(time * 4)
    assert explained(force, np.ones(4000), np.arange(4000) * 4 // 4000, np.arange(4000) * 16 // 4000) < 0.01
