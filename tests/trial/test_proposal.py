"""Is a proposed effect file one that the catalogue takes, the engine compiles, and that does what it says?"""

import numpy as np
import pytest

from testbed.catalogue import read_effect
from testbed.cut import Cut, whole_cut_sampling
from testbed.engines import fast
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.problem import InputProblem
from testbed.trial.compilable import check_compilable
from testbed.trial.proposal import Coefficient, ForceTerm, effect_text, free_name, write_proposal

QUINTIC = ForceTerm("stiffness_5", "structure_force", "-x^5", "-displacement**5", "N/m^5", "quintic stiffness")
SQUARE = ForceTerm("square_n", "normal_force", "b h^2", "depth * chip * chip", "N/m^3", "square of the chip")
WAVE = ForceTerm("cos_5_n", "normal_force", "b cos(5 theta)", "depth * math.cos(5.0 * angle)", "N/m", "waveform")
FOUND = (
    Coefficient(QUINTIC, 4e21, 3.9e21, 4.1e21),
    Coefficient(SQUARE, 2e12, 1.9e12, 2.1e12),
    Coefficient(WAVE, -3e3, -4e3, -2e3),
)
MODEL = Model(Structure(2.573, 146.4, 0.0032), Cutter(), Cutting())
CUT = Cut(400.0, 1.5e-3, passes=20)


@pytest.fixture(scope="module")
def effect(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own") / "new"
    path = write_proposal(FOUND, folder, "proposal", share=0.93, story='Found "here": a force.')
    assert path == folder / "proposal.py" and list(folder.iterdir()) == [path]
    return read_effect(path)


def test_the_file_is_an_effect_with_the_found_values(effect):
    assert effect.example() == {"stiffness_5": 4e21, "square_n": 2e12, "cos_5_n": -3e3}
    assert effect.neutral() == {"stiffness_5": 0.0, "square_n": 0.0, "cos_5_n": 0.0}
    assert [one.unit for one in effect.parameters] == ["N/m^5", "N/m^3", "N/m"]
    for one in effect.parameters:
        assert one.bounds[0] < one.example < one.bounds[1] and one.start == one.example and one.vanishes
    assert "x^5" in effect.law and "93%" in effect.manual and "a force." in effect.manual
    assert max(len(line) for line in effect.path.read_text().splitlines()) <= 128
    check_compilable(effect)


def test_the_hooks_are_the_formula(effect):
    x = 7e-5
    assert effect.hooks["structure_force"](x, 4e21) == pytest.approx(-4e21 * x**5)
    depth, chip, angle = 2e-3, 5e-5, 0.4
    known = {"depth": depth, "chip": chip, "penetration": chip, "angle": angle, "square_n": 2e12, "cos_5_n": -3e3}
    wanted = depth * (2e12 * chip**2 - 3e3 * np.cos(5 * angle))
    assert effect.hooks["normal_force"](**known) == pytest.approx(wanted)
    assert effect.hooks["normal_force"](**{**known, "penetration": chip - 1e-5}) == 0.0  # contact lost


@pytest.mark.long
def test_the_engine_runs_it_and_it_vanishes_when_neutral(effect):
    own = {"proposal": effect}
    sampling = whole_cut_sampling(CUT, 1, 12800.0)

    def motion(model):
        return fast.simulate(model, CUT, sampling, catalogue=own).channels["displacement"]

    base = motion(MODEL)
    assert np.array_equal(motion(MODEL.with_effect("proposal", **effect.neutral())), base)
    changed = motion(MODEL.with_effect("proposal", **effect.example()))
    assert np.isfinite(changed).all() and np.abs(changed - base).max() > 0.05 * np.abs(base).max()


@pytest.mark.parametrize("name", ["two words", "_hidden", "test_it", "class", "chain", "cubic_stiffness", ""])
def test_bad_names_are_refused_and_nothing_is_written(tmp_path, name):
    with pytest.raises(InputProblem):
        write_proposal(FOUND, tmp_path, name, share=1.0, story="x")
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_never_overwritten(tmp_path):
    path = write_proposal(FOUND[:1], tmp_path, "mine", share=1.0, story="x")
    before = path.read_text()
    with pytest.raises(InputProblem, match="exists already"):
        write_proposal(FOUND[1:], tmp_path, "mine", share=1.0, story="x")
    assert path.read_text() == before
    assert free_name(tmp_path, "mine") == "mine_2" and free_name(tmp_path, "helix") == "helix_2"
    assert free_name(tmp_path / "nowhere", "mine") == "mine"
    with pytest.raises(InputProblem, match="is a file"):
        write_proposal(FOUND, path, "other", share=1.0, story="x")


def test_a_formula_must_have_terms_with_values():
    with pytest.raises(ValueError, match="without terms"):
        effect_text("proposal", (), 1.0, "x")
    with pytest.raises(ValueError, match="not found"):
        effect_text("proposal", (Coefficient(QUINTIC, 0.0, 0.0, 0.0),), 1.0, "x")
    with pytest.raises(ValueError, match="one name"):
        effect_text("proposal", FOUND[:1] * 2, 1.0, "x")
