"""Where a command writes: never over what it reads, and bad input leaves no empty folder behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.test_newcomer_errors import CUT, HEAD, MODEL, rows
from tests.support.shell import Shell

EFFECT = Path(__file__).parents[2] / "testbed" / "effects" / "process_damping.py"
TESTS = "tests: [{spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm}]\n"
AT = ("--speed", "3810", "--depth", "2.9")


@pytest.fixture
def testbed(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Shell:
    monkeypatch.chdir(tmp_path)
    for name, text in {"campaign.yaml": HEAD + CUT, "model.yaml": MODEL, "t.h5": "a data set", "mine.py": "identify = print",
                       "scenario.yaml": f"model: {{file: model.yaml}}\n{TESTS}", "torn.yaml": "structure: [", "empty.yaml": "",
                       "own.yaml": MODEL + "effects: {my_own: {strength: much}}\n",
                       "cut.csv": "\n".join(["x,tach", *rows(2560)]) + "\n"}.items():
        Path(name).write_text(text)
    Path("fx").mkdir()
    (Path("fx") / "my_drag.py").write_text(EFFECT.read_text("utf-8"), "utf-8")
    Path("link.json").symlink_to("model.yaml")
    Path("empty").mkdir()
    return Shell(capsys)


def files() -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in Path().rglob("*") if path.is_file()}


BOTH = ("-m", "model.yaml")


@pytest.mark.parametrize(("arguments", "said"), [
    (("verify", "t.h5", "--json", "t.h5"), "t.h5: exists already, and this command reads it (DATA)"),
    (("verify", "t.h5", "--json", "./fx/../t.h5"), "t.h5: exists already"),
    (("inspect", "campaign.yaml", "--json", "campaign.yaml"), "(DATA): name another place for --json"),
    (("inspect", "campaign.yaml", "--json", "cut.csv"), "cut.csv: exists already and is no JSON"),
    (("multipliers", "model.yaml", *AT, "--json", "model.yaml"), "(MODEL.yaml)"),
    (("multipliers", "model.yaml", *AT, "--json", "link.json"), "(MODEL.yaml)"),
    (("effects", "--effects", "fx", "--json", "fx/my_drag.py"), "my_drag.py: exists already and is no JSON"),
    (("chart", "model.yaml", *AT, "--data", "t.h5", "--json", "t.h5"), "(--data)"),
    (("identify", "t.h5", *BOTH, "-o", "t.h5"), "(DATA): name another place for --output"),
    (("identify", "campaign.yaml", *BOTH, "-o", "cut.csv"), "cut.csv: exists already and is no model.yaml"),
    (("identify", "t.h5", *BOTH, "-o", "campaign.yaml"), "campaign.yaml: exists already and is no model.yaml: name another"),
    (("add", "runout", *BOTH, "-c", "nix.yaml", "-o", "scenario.yaml"), "scenario.yaml: exists already and is no model.yaml"),
    (("identify", "t.h5", *BOTH, "-o", "torn.yaml"), "torn.yaml: exists already and is no model.yaml"),
    (("identify", "t.h5", *BOTH, "-o", "new.yaml", "--json", "new.yaml"), "by --output and by --json"),
    (("add", "runout", *BOTH, "-c", "campaign.yaml", "-o", "campaign.yaml"), "(--campaign)"),
    (("add", "runout", *BOTH, "-c", "campaign.yaml", "-o", "n.yaml", "--report", "n.yaml"), "name two places"),
    (("compare", "campaign.yaml", *BOTH, "--json", "model.yaml"), "(--model)"),
    (("diagnose", "campaign.yaml", *BOTH, "--json", "campaign.yaml"), "(CAMPAIGN.yaml)"),
    (("diagnose", "campaign.yaml", *BOTH, "-o", "x", "--json", "x"), "by --output and by --json"),
    (("score", "t.h5", "--method", "mine.py", "--json", "mine.py"), "(--method)"),
    (("export", "t.h5", "-o", "set", "--json", "t.h5"), "(DATA.h5)"),
    (("run", "model.yaml", "-o", "x.h5", "--json", "model.yaml"), "(SCENARIO.yaml)"),
    (("run", "model.yaml", "-o", "x.h5", "--cluster", "campaign.yaml", "--json", "campaign.yaml"), "(--cluster)"),
])
def test_no_command_writes_over_what_it_reads(testbed: Shell, arguments: tuple[str, ...], said: str) -> None:
    before = files()
    assert said in testbed.refused(*arguments)
    assert files() == before


@pytest.mark.parametrize("arguments", [("identify", "t.h5", *BOTH), ("add", "runout", *BOTH, "-c", "nix.yaml")])
@pytest.mark.parametrize("place", ["model.yaml", "own.yaml", "empty.yaml"])
def test_a_model_may_be_replaced_by_its_successor(testbed: Shell, arguments: tuple[str, ...], place: str) -> None:
    said = testbed.refused(*arguments, "-o", place)
    assert said.startswith(f"error: {arguments[1] if arguments[0] == 'identify' else 'nix.yaml'}: ")  # and not for its place


def test_json_replaces_json_and_fills_an_empty_file(testbed: Shell) -> None:
    Path("m.json").touch()
    for _ in range(2):
        assert testbed("multipliers", "model.yaml", *AT, "--quiet", "--json", "m.json") == 0, testbed.err
        assert Path("m.json").read_text().startswith("{")


@pytest.mark.parametrize("arguments", [
    ("inspect", "nix.yaml", "-o", "new"), ("inspect", "nix.yaml", "-o", "new/inner/most"),
    ("inspect", "nix.yaml", "-o", "empty"),
    ("compare", "nix.yaml", *BOTH, "-o", "new"), ("diagnose", "nix.yaml", *BOTH, "-o", "new"),
    ("diagnose", "nix.yaml", *BOTH, "--propose", "new"),
    ("add", "runout", "-m", "nix.yaml", "-c", "campaign.yaml", "-o", "n.yaml", "--report", "new"),
    ("add", "no_such_effect", *BOTH, "-c", "campaign.yaml", "-o", "n.yaml", "--report", "new"),
])
def test_bad_input_leaves_no_folder_behind(testbed: Shell, arguments: tuple[str, ...]) -> None:
    said = testbed.refused(*arguments)  # `refused` compares what stands there before and after
    assert "nix.yaml: there is no such file" in said or "unknown effect" in said


def test_a_folder_that_is_written_into_stays(testbed: Shell) -> None:
    assert testbed("inspect", "campaign.yaml", "-o", "new/pictures", "--quiet") == 0, testbed.err
    assert sorted(path.suffix for path in Path("new/pictures").iterdir()) == [".png", ".svg"]


@pytest.mark.parametrize("arguments", [
    ("diagnose", "campaign.yaml", *BOTH, "--propose", "cut.csv"), ("compare", "campaign.yaml", *BOTH, "-o", "cut.csv"),
    ("inspect", "campaign.yaml", "-o", "cut.csv/new"),
])
def test_a_file_where_a_folder_is_wanted_is_refused_before_the_work(testbed: Shell, arguments: tuple[str, ...],
                                                                      monkeypatch: pytest.MonkeyPatch) -> None:
    def read(*_: object) -> None:
        pytest.fail("the work had begun")

    monkeypatch.setattr("testbed.api.fitting.load_records", read)
    monkeypatch.setattr("testbed.analysis.records.inspection.inspect", read)
    assert "cannot be made" in testbed.refused(*arguments)


@pytest.mark.parametrize(("arguments", "said"), [
    (("inspect", "campaign.yaml", "--json", ""), "--json: is empty: name a file"),
    (("inspect", "campaign.yaml", "--json", 300 * "j"), "jjj...: is too long a name for a file"),
    (("inspect", "campaign.yaml", "-o", 300 * "d"), "cannot be made (File name too long)"),
    (("export", "none.h5", "--description", 300 * "long ", "-o", "set"), "none.h5: there is no such"),
    (("inspect", "", "-o", "new"), "DATA: is empty"),
    (("compare", "campaign.yaml", *BOTH, "-o", " "), "--output: is empty"),
    (("view", "flexure", "-o", "r.gif"), "r.gif: is no PNG picture: give a name that ends in .png"),
    (("view", "flexure", "-o", "r"), "r: is no PNG picture"),
    (("help",), "there is no command 'help': see testbed --help\n"),
    (("inspect", "cut.csv", "--rate", "-5 Hz"), "--rate: '-5 Hz' must be above 0 and at most 1e+09 Hz"),
    (("inspect", "cut.csv", "--rate", "0 Hz"), "'0 Hz' must be above 0"),
    (("inspect", "cut.csv", "--rate", "1e300 Hz"), "at most 1e+09 Hz"),
    (("inspect", "cut.csv", "--rate", "nan Hz"), "--rate: "),
])
def test_what_cannot_be_meant_is_said_by_name(testbed: Shell, arguments: tuple[str, ...], said: str) -> None:
    assert said in testbed.refused(*arguments)


def test_an_effect_file_or_a_method_that_exits_is_a_fault_of_the_file(testbed: Shell) -> None:
    (Path("fx") / "my_drag.py").write_text("import sys\n\nsys.exit(3)\nEFFECT = None\n")
    assert "fx/my_drag.py:3: SystemExit: 3" in testbed.refused("effects", "--effects", "fx")
    from testbed.api.methods import load_method
    from testbed.problem import InputProblem

    Path("mine.py").write_text("raise SystemExit(3)\n")
    with pytest.raises(InputProblem, match="cannot be imported"):
        load_method(Path("mine.py"))
