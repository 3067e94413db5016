"""Data sets through the API: scored, verified, exported, as the command line does it; effects; the package's own names."""

import json
import pkgutil
from pathlib import Path

import pytest

import testbed
from testbed.api.result import json_text
from tests.support.api_answers import behaves, same
from tests.support.shell import Shell

SCENARIO = """seed: 3
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 1, diameter: 19.05 mm}
  cutting: {immersion: 0.162, tangential_coefficient: 550 N/mm^2, normal_coefficient: 165 N/mm^2}
cut: {idle: 5 rev, cutting: 30 rev, ring_down: 30 rev}
tests:
  - {spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 2850 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 4100 rpm, depth_of_cut: 2.0 mm}
sensors: {displacement: {noise: 0.1 um}}
engine: {name: fast}
"""


@pytest.fixture
def shell(capsys):
    return Shell(capsys)


def test_score(shell, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("cuts.yaml").write_text(SCENARIO)
    made = testbed.sweep("cuts.yaml", "cuts.h5", progress=False)
    told = []
    found = testbed.score(made.data, noise=("1 um", 2e-6), repeats=2, tests=(2,), seed=4,
                          progress=lambda *one: told.append(one))
    order = ("--noise", "1um,2um", "--repeats", "2", "--tests", "2", "--seed", "4")
    assert shell("score", "cuts.h5", *order, "--json", "-") == 0
    ours, theirs = found.to_dict(), json.loads(shell.out)
    assert ours.pop("cost") and theirs.pop("cost")  # of processor time, no two are alike
    assert ours == theirs and ours["method"] == "multipliers" and len(found.scores) == 6
    behaves(found)
    assert told[-1] == ("identifying", 4, 4) and found.truth["natural_frequency"] == 146.6
    assert all(one.rms < 0.05 * one.truth for one in found.scores if one.parameter == "natural_frequency")
    assert len(found.plot().axes) == 6 and {"score.md", "score_noise.png"} <= {one.name for one in found.save("out")}
    with pytest.raises(testbed.InputProblem, match="there are score_noise, score_cost"):
        found.plot("score_tests")
    for wrong, said in (({"noise": "1 kg"}, "noise: "), ({"noise": -1.0}, "below 0"), ({"repeats": 0}, "0 is below 1"),
                        ({"tests": (4,)}, "holds 3 tests, not 4"), ({"method": "wavefrom"}, "did you mean waveform")):
        with pytest.raises(testbed.InputProblem, match=said):
            testbed.score("cuts.h5", **wrong)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A data set of three cuts."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "cuts.yaml").write_text(SCENARIO)
    return testbed.sweep(folder / "cuts.yaml", folder / "cuts.h5", progress=False).data


def test_verify(shell, made, tmp_path):
    found = same(shell, testbed.verify(made.path), "verify", str(made.path))
    assert found.intact and found.runs == 3 and "intact" in repr(found)
    whole = Path(made.path).read_bytes()
    (tmp_path / "bad.h5").write_bytes(whole[:9000] + bytes([whole[9000] ^ 1]) + whole[9001:])
    broken = testbed.verify(tmp_path / "bad.h5", quick=True)
    assert not broken.intact and broken.damage[0].startswith("the file's bytes are not those") and len(broken.to_pandas()) > 0


@pytest.mark.parametrize(("asked", "order"), [
    ({"seed": 3}, ("--seed", "3")),
    ({"window": 512, "step": 256, "rate": "6.4 kHz", "shares": (60, 20, 20)},
     ("--window", "512", "--step", "256", "--rate", "6.4kHz", "--split", "60,20,20"))])
def test_export(shell, made, tmp_path, monkeypatch, asked, order):
    pytest.importorskip("pyarrow")
    monkeypatch.chdir(tmp_path)
    found = testbed.export(made, "ours", **asked)
    assert shell("export", str(made.path), "-o", "theirs", *order, "--json", "-") == 0, shell.err
    assert found.json.replace('"ours"', '"theirs"') == shell.out
    behaves(found)
    assert found.splits.keys() == {"train", "validation", "test"} and found.baseline["features"]
    ours, theirs = ({path.relative_to(name): path.read_bytes() for path in Path(name).rglob("*.*")}
                    for name in ("ours", "theirs"))
    assert ours == theirs and {"README.md", "croissant.json"} < {str(path) for path in ours}


def test_export_refuses_in_one_line(made, tmp_path):
    for wrong, said in (({"step": 9}, "step: goes with a window"), ({"window": 4}, "4 is below 8"),
                        ({"shares": (1, 2)}, "'1, 2' are no shares"), ({"licence": "mine"}, "there is no 'mine'"),
                        ({"split_by": "run"}, "give condition, machine"),
                        ({"rate": "3 kg"}, "rate: ")):
        with pytest.raises(testbed.InputProblem, match=said):
            testbed.export(made, tmp_path / "new", **wrong)
    with pytest.raises(testbed.InputProblem, match="exists already"):
        testbed.export(made, tmp_path)


def test_effects(shell, tmp_path, monkeypatch):
    known = testbed.list_effects()
    assert shell("effects", "--json", "-") == 0 and json.loads(shell.out) == {
        "effects": [json.loads(json_text(testbed.effect_card(name))) for name in known]}
    assert shell("effects", "runout", "--no-picture", "--json", "-") == 0
    assert shell.out == json_text(testbed.effect_card("runout"))
    with pytest.raises(testbed.InputProblem, match="did you mean runout"):
        testbed.effect_card("runnout")
    monkeypatch.chdir(tmp_path)
    effect, test = testbed.new_effect("my_drag", "mine")
    assert testbed.effect_card("my_drag", "mine")["file"] == str(effect) and test.name == "test_my_drag.py"
    assert shell("effects", "--new", "my_drag") == 0 and Path("my_drag.py").read_text() == effect.read_text()
    with pytest.raises(testbed.InputProblem, match="exists already"):
        testbed.new_effect("my_drag", "mine")


def test_every_command_is_a_function_but_those_that_make_something_to_look_at():
    commands = {path.stem for path in (Path(testbed.__file__).parent / "cli").glob("*.py") if not path.stem.startswith("_")}
    named = {"run": "sweep", "effects": "list_effects"}
    assert {one for one in commands if named.get(one, one) not in testbed.__all__} == \
        {"benchmark", "demo", "doctor", "init", "paper", "view"}
    for name in set(testbed.__all__) - {"__version__"}:  # no submodule takes a public name's place
        assert getattr(testbed, name).__module__.startswith("testbed."), name


def test_a_walk_through_the_package_ends():
    names = [one.name for one in pkgutil.walk_packages(testbed.__path__, "testbed.")]
    assert "testbed.api.chart" in names and not any(name.startswith("testbed.testbed") for name in names)
    assert len(names) == len(set(names)) < 1000
