"""`testbed diagnose` and `testbed add` as a user meets them: four short cuts as files, one effect hidden in them."""

import json
import re
import shutil
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from testbed.api.next_command import next_command
from testbed.catalogue import catalogue
from testbed.cli import main
from testbed.effects import process_damping
from testbed.engines import fast
from testbed.files.campaign import load_campaign
from testbed.files.model_file import read_model
from testbed.workshop import write_campaign
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.shell import Shell
from tests.support.synthetic_campaign import synthetic_campaign

EFFECT, PATH, STRENGTH = "process_damping", "process_damping.coefficient", 6.0e5
CUTS = ((3810, 2.9), (2850, 2.9), (4200, 1.5), (2600, 1.5))
VERDICTS = {"missing_effect", "adequate", "unexplained", "undecided", "not_converged"}


@pytest.fixture
def testbed(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Shell(capsys)


def _answer(folder, *arguments):
    """A command's JSON and what it printed, run once for the whole file."""
    import contextlib
    import io

    said = io.StringIO()
    with contextlib.redirect_stdout(said), pytest.raises(SystemExit) as stop:
        main([*arguments, "--json", str(folder / f"{arguments[0]}.json")])
    assert stop.value.code == 0
    text = (folder / f"{arguments[0]}.json").read_text()
    return json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no JSON")), said.getvalue()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """campaign.yaml, model.yaml and the CSV files: four cuts of a second, process damping hidden in them."""
    folder = tmp_path_factory.mktemp("files")
    true = TRUE.with_effect(EFFECT, coefficient=STRENGTH)
    write_campaign(folder, synthetic_campaign(partial(fast.simulate, steps=37), true, seed=4, tests=CUTS, rate=6400.0,
                                              course=(10, 35, 15)), BELIEVED)
    return folder


@pytest.fixture(scope="module")
def diagnosed(files, tmp_path_factory):
    return _answer(tmp_path_factory.mktemp("diagnosed"), "diagnose", str(files / "campaign.yaml"), "-m",
                   str(files / "model.yaml"))


@pytest.fixture(scope="module")
def added(files, tmp_path_factory):
    folder = tmp_path_factory.mktemp("added")
    return (*_answer(folder, "add", EFFECT, "-m", str(files / "model.yaml"), "-c", str(files / "campaign.yaml"), "-o",
                     str(folder / "new.yaml")), folder / "new.yaml")


@pytest.mark.parametrize(("verdict", "tried", "proposed", "expected"), [
    ("missing_effect", ("any",), False, "testbed add helix -m m.yaml -c c.yaml -o NEW.yaml"),
    ("unexplained", ("any",), False, "testbed diagnose c.yaml -m m.yaml --propose DIR"),
    ("unexplained", ("any",), True, ""),  # told with what was proposed
    ("unexplained", (), False, ""),  # a record contradicts the others, or a sensor is turned round: no effect was looked for
    ("adequate", ("any",), False, ""),
])
def test_the_command_to_go_on_with(verdict, tried, proposed, expected):
    found = SimpleNamespace(verdict=verdict, effects=("helix",), candidates=tried, mode=None)
    assert next_command(found, "c.yaml", "m.yaml", proposed) == expected


def test_several_effects_are_added_together():
    found = SimpleNamespace(verdict="missing_effect", effects=("helix", "runout"), candidates=("any",), mode=None)
    assert next_command(found, "c.yaml", "m.yaml", False) == "testbed add helix runout -m m.yaml -c c.yaml -o NEW.yaml"


@pytest.mark.parametrize(("verdict", "expected"), [
    ("missing_effect", "testbed add my_drag -m m.yaml -c 'a b/c.yaml' --effects mine --effects more -o NEW.yaml"),
    ("unexplained", "testbed diagnose 'a b/c.yaml' -m m.yaml --effects mine --effects more --propose DIR"),
])
def test_the_command_to_go_on_with_knows_the_user_s_own_effects(verdict, expected):
    found = SimpleNamespace(verdict=verdict, effects=("my_drag",), candidates=("any",), mode=None)
    assert next_command(found, "a b/c.yaml", "m.yaml", False, ("mine", "more")) == expected


def test_what_was_proposed_is_added_beside_the_user_s_own_effects(testbed, monkeypatch):
    from testbed.api.believed import Effects
    from testbed.api.diagnose import Diagnosis
    from testbed.cli import diagnose
    from testbed.cli._answer import Answer

    told = SimpleNamespace(sentence="A force is missing.", formula="v^3")
    monkeypatch.setattr("testbed.analysis.force.explanation.as_json", lambda _: {})
    monkeypatch.setattr("testbed.analysis.force.explanation.write_effect", lambda _, folder, name: Path(folder) / f"{name}.py")
    jury = SimpleNamespace(left_unexplained=lambda *_: told, likeliest=lambda one: one)
    monkeypatch.setattr("testbed.analysis.force.formula_trial.Jury", lambda *_: jury)
    found = Diagnosis(BELIEVED, None, Effects({}, ("more", "./mine")), [], (), {}, ("c.yaml", "m.yaml"))
    diagnose._propose(Answer(None, False), found, "mine")
    said = testbed.capsys.readouterr().out
    assert "next: testbed add proposal -m m.yaml -c c.yaml --effects more --effects mine -o NEW.yaml\n" in said


def test_the_files_are_what_was_measured(files):
    records = load_campaign(files / "campaign.yaml").records
    assert len(records) == len(CUTS) and read_model(files / "model.yaml") == BELIEVED
    for record, (rpm, depth) in zip(records, CUTS, strict=True):
        assert record.kind == "cut" and record.cut(1).axial_depth_of_cut == pytest.approx(depth * 1e-3)
        turn = (record.recording.marks[-1] - record.recording.marks[0]) / (len(record.recording.marks) - 1)
        assert 60 / turn == pytest.approx(rpm, rel=6e-4)


def test_diagnose_answers_as_the_contract_says(diagnosed):
    said, _ = diagnosed
    assert {"verdict", "effects", "error", "candidates", "base_parameters", "next_test"} <= set(said)
    assert said["verdict"] in VERDICTS and set(said["error"]) == {"baseline", "with_effects", "noise_floor"}
    for one in said["candidates"]:
        assert {"effects", "parameters", "error_fit", "error_held_out", "delta_bic", "converged", "fitted"} <= set(one)
        assert one["fitted"] or (one["parameters"] == {} and one["delta_bic"] == 0.0 and not one["converged"])
    assert {one["fitted"] for one in said["candidates"]} == {True, False}
    for one in said["base_parameters"].values():
        assert set(one) == {"before", "after", "unit", "determined"}
    if said["next_test"] is not None:
        assert {"spindle_speed", "depth_of_cut", "separates"} <= set(said["next_test"])


def test_diagnose_names_what_is_hidden(diagnosed):
    said, text = diagnosed
    assert said["verdict"] == "missing_effect" and said["effects"] == [EFFECT]
    error = said["error"]
    assert error["baseline"] > 1.5 * error["noise_floor"] and error["with_effects"] < 1.05 * error["noise_floor"]
    best = next(one for one in said["candidates"] if one["effects"] == [EFFECT])
    assert best["parameters"][PATH] == pytest.approx(STRENGTH, rel=0.1) and best["delta_bic"] > 10
    frequency = said["base_parameters"]["natural_frequency"]
    assert frequency["before"] == 148.0 and frequency["unit"] == "Hz"
    assert abs(frequency["after"] - TRUE.structure.natural_frequency) < 0.05
    assert re.search(r"^0 +refitted, no effect +0\.\d+", text, re.MULTILINE) and "as believed" not in text
    assert "missing effect: Process damping (ploughing of the flank) [process_damping]" in text
    assert "testbed add process_damping -m " in text


def test_add_lets_the_error_fall_to_the_noise(added):
    said, text, _ = added
    assert said["effect"] == EFFECT and said["converged"] is True
    assert said["error"]["before"] > 1.5 * said["noise_floor"] > said["error"]["after"] / 1.05 * 1.5
    assert len(said["records"]) == len(CUTS)
    for one in said["records"]:
        assert one["held_out"] is True and one["before"] > one["after"]
    found = said["parameters"]
    assert {"natural_frequency", "damping_ratio", "tangential_coefficient", "normal_coefficient", PATH} == set(found)
    for one in found.values():
        assert one["low"] < one["value"] < one["high"]
    assert found[PATH]["unit"] == "N/m" and found[PATH]["value"] == pytest.approx(STRENGTH, rel=0.1)
    assert re.search(r"^all records +0\.\d+ +0\.\d+ +0\.\d+$", text, re.MULTILINE)


def test_the_model_that_add_wrote_loads_and_explains_the_records(added, files, testbed):
    said, _, path = added
    model = read_model(path)
    assert set(model.effects) == {EFFECT}
    for name, one in said["parameters"].items():
        assert model.value(name) == one["value"], name
    assert testbed("compare", files / "campaign.yaml", "-m", path, "--json", "c.json") == 0, testbed.err
    compared = json.loads(Path("c.json").read_text())
    assert compared["error"] < 1.05 * compared["noise_floor"]
    assert compared["noise_floor"] == pytest.approx(said["noise_floor"], rel=0.02)


def _own(folder):
    """A user's own effect: ploughing, with process damping's law, under a name and in a file of its own."""
    source = Path(process_damping.__file__).read_text()
    (folder / "ploughing.py").write_text(source.replace("Process damping (ploughing of the flank)", "My ploughing"))


@pytest.mark.long
def test_add_takes_an_effect_of_the_user_s_own(files, testbed):
    Path("mine").mkdir()
    _own(Path("mine"))
    command = ["add", "ploughing", "-m", files / "model.yaml", "-c", files / "campaign.yaml", "-o", "new.yaml"]
    assert "did you mean" in testbed.refused(*command[:1], "plowing", *command[2:], "--effects", "mine")
    assert "ploughing: unknown effect" in testbed.refused(*command)
    assert testbed(*command, "--effects", "mine", "--json", "a.json") == 0, testbed.err
    said = json.loads(Path("a.json").read_text())
    assert said["error"]["after"] < 1.05 * said["noise_floor"]
    assert said["parameters"]["ploughing.coefficient"]["value"] == pytest.approx(STRENGTH, rel=0.1)
    assert set(read_model("new.yaml", catalogue("mine")).effects) == {"ploughing"}
    assert "unknown effect" in testbed.refused("compare", files / "campaign.yaml", "-m", "new.yaml")


@pytest.fixture
def copied(files, testbed):
    """The files in the folder where the commands run, to be spoilt."""
    for path in files.iterdir():
        shutil.copy(path, path.name)
    return testbed


ADD = ("-m", "model.yaml", "-c", "campaign.yaml", "-o", "new.yaml")


@pytest.mark.parametrize(("arguments", "said"), [
    (("add", "proces_damping", *ADD), "proces_damping: unknown effect: did you mean process_damping?"),
    (("add", "zzz", *ADD), "testbed effects lists them; for one of your own give the folder of its file: --effects DIR"),
    (("add", EFFECT, "helix", EFFECT, *ADD), f"{EFFECT}: named twice: name every effect once"),
    (("add", EFFECT, *ADD[:4], "-o", "none/new.yaml"), "there is no folder none"),
    (("add", EFFECT, "-m", "none.yaml", *ADD[2:]), "none.yaml: there is no such file"),
    (("add", EFFECT, *ADD[:2], "-c", "none.yaml", *ADD[4:]), "none.yaml: there is no such file"),
    (("add", EFFECT, *ADD[:4]), "'--output'"),
    (("add", EFFECT, *ADD, "--effects", "none"), "none: is not a folder"),
    (("diagnose", "none.yaml", "-m", "model.yaml"), "none.yaml: there is no such file"),
    (("diagnose", "campaign.yaml"), "'--model'"),
    (("diagnose", "model.yaml", "-m", "model.yaml"), "model.yaml"),
])
def test_a_bad_call_is_answered_in_one_line(copied, arguments, said):
    assert said in copied.refused(*arguments)


def _replace(name, old, new):
    text = Path(name).read_text()
    assert old in text
    Path(name).write_text(text.replace(old, new))


def test_an_effect_that_the_model_has_is_not_added_again(copied):
    with Path("model.yaml").open("a") as file:
        file.write("effects: {process_damping: {coefficient: 1 N/m}}\n")
    assert "model.yaml: has process_damping already" in copied.refused("add", EFFECT, *ADD)


@pytest.mark.parametrize("command", [("add", EFFECT, *ADD), ("diagnose", "campaign.yaml", "-m", "model.yaml")])
def test_a_missing_column_is_named_with_its_nearest(copied, command):
    _replace("campaign.yaml", "disp_um", "displ_um")
    said = copied.refused(*command)
    assert "displ_um" in said and "disp_um" in said.replace("displ_um", "")


def test_an_effect_of_the_cut_needs_a_cut(copied):
    lines = [line for line in Path("campaign.yaml").read_text().splitlines() if "tachometer" not in line]
    lines = [line for line in lines if "file:" not in line] + ["  - {file: cut_0.csv, kind: ring-down, from: 0.75 s}"]
    Path("campaign.yaml").write_text("\n".join(lines).replace("from: 0.75 s", "from: 0.75") + "\n")
    said = copied.refused("add", EFFECT, *ADD)
    assert "no record can show process_damping" in said and said.startswith("error: campaign.yaml: ")
