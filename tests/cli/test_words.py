"""Words of the shop and of other programs, units where a number is typed, and arguments in the wrong order."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from testbed.cli import main
from testbed.files.model_file import model_from_text
from testbed.files.synonyms import meant

MODEL = ("structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}\n"
         "cutter: {flutes: 1, diameter: 19.05 mm}\n"
         "cutting: {direction: up-milling, immersion: 0.162, tangential_coefficient: 550 N/mm^2, "
         "normal_coefficient: 200 N/mm^2}\n")  # fmt: skip
CAMPAIGN = ("sampling_rate: 12800 Hz\nchannels: {displacement: {column: 1, unit: um}}\n"
            "records: [{file: a.csv, kind: cut, spindle_speed: 3810 rpm, depth_of_cut: 1 mm, feed: 0.1 mm/tooth}]\n")
CUT = ("--speed", "3810", "--depth", "2.9")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.yaml").write_text(MODEL)
    (tmp_path / "campaign.yaml").write_text(CAMPAIGN)
    return tmp_path


def refused(capsys, *arguments: str) -> str:
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    said = capsys.readouterr().err.strip()
    assert stop.value.code == 2 and "\n" not in said
    return said


@pytest.mark.parametrize(("old", "new", "written"), [
    ("immersion: 0.162", "radial_immersion: 0.25", "write radial_depth, the width of cut a_e as a length"),
    ("immersion: 0.162", "a_e: 4 mm", "write radial_depth; known"),
    ("natural_frequency", "fn", "write natural_frequency; known"),
    ("mass: 2.573 kg", "stiffness: 2 N/um", "write mass, which is the stiffness over"),
    ("flutes", "teeth", "write flutes; known"),
    ("normal_coefficient", "Kr", "write normal_coefficient, a force per area; where yours is the ratio K_r, K_t times it"),
])  # fmt: skip
def test_a_foreign_key_is_answered_with_the_right_one(folder, capsys, old, new, written):
    (folder / "model.yaml").write_text(MODEL.replace(old, new))
    assert written in refused(capsys, "multipliers", "model.yaml", *CUT)


@pytest.mark.parametrize(("old", "new", "written"), [
    ("depth_of_cut", "ap", "write depth_of_cut; known"), ("feed:", "fz:", "write feed, with its unit: 0.1 mm/tooth; known"),
    ("spindle_speed", "rpm", "write spindle_speed; known"), ("sampling_rate", "fs", "write sampling_rate; known"),
])  # fmt: skip
def test_so_is_one_of_a_campaign(folder, capsys, old, new, written):
    (folder / "campaign.yaml").write_text(CAMPAIGN.replace(old, new))
    assert written in refused(capsys, "inspect", "campaign.yaml")


def test_a_key_that_is_known_in_its_place_is_no_foreign_word():
    assert meant("stiffness", ("stiffness", "mass")) is None
    assert meant("stiffness", ("mass",)) is not None
    assert meant("depth_of_cut", ("depth_of_cut", "feed")) is None


@pytest.mark.parametrize(("word", "direction"), [("climb", "down-milling"), ("Conventional milling", "up-milling"),
                                                 ("down-milling", "down-milling"), ("up", "up-milling")])  # fmt: skip
def test_climb_is_down_milling(word, direction):
    model = model_from_text(MODEL.replace("up-milling", word))
    assert model.cutting is not None and model.cutting.direction == direction


def multipliers(folder, *cut: str) -> object:
    with pytest.raises(SystemExit) as stop:
        main(["multipliers", "model.yaml", *cut, "--quiet", "--json", "found.json"])
    assert not stop.value.code
    return json.loads((folder / "found.json").read_text())["multipliers"]


@pytest.mark.parametrize("cut", [("--speed", "3810 rpm", "--depth", "2.9mm"), ("--speed", "63.5 rev/s", "--depth", "2900 um")])
def test_a_unit_may_be_typed(folder, cut):
    for found, plain in zip(multipliers(folder, *cut), multipliers(folder, *CUT), strict=True):
        assert found == pytest.approx(plain, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(("cut", "said"), [
    (("--speed", "2500:4500", "--depth", "1"), "does not say how many: give FIRST:LAST:COUNT, such as 2500:4500:101"),
    (("--speed", "2.9", "--depth", "3810"), "were they exchanged?"),
    (("--speed", "3810 kg", "--depth", "1"), "is not a range"),
])  # fmt: skip
def test_what_is_typed_wrongly_is_said(capsys, cut, said):
    assert said in refused(capsys, "multipliers", "model.yaml", *cut)


@pytest.mark.parametrize(("arguments", "said"), [
    (("compare", "model.yaml", "-m", "campaign.yaml"), "the file is a campaign.yaml: give a model.yaml here"),
    (("inspect", "model.yaml"), "the file is a model.yaml: give a campaign.yaml here"),
    (("run", "model.yaml", "-o", "x.h5"), "the file is a model.yaml: give a scenario here"),
])  # fmt: skip
def test_another_kind_of_file_is_named(capsys, arguments, said):
    assert said in refused(capsys, *arguments)
