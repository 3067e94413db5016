"""`testbed effects`: the catalogue, a card with its picture, and a template that works as it is written."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner

from testbed.catalogue import catalogue
from testbed.cli._fingerprint import picture
from testbed.cli.effects import command
from testbed.system.kernel_cache import cache_folder


def run(*arguments: str):
    return CliRunner().invoke(command, list(arguments), catch_exceptions=False)


def test_the_list_names_every_effect():
    answer = run()
    assert answer.exit_code == 0
    for name, effect in catalogue().items():
        assert name in answer.output and effect.title in answer.output


def test_every_card_says_law_parameters_and_confusions_and_draws_a_live_picture():
    for name, effect in catalogue().items():
        answer = run(name)
        assert answer.exit_code == 0 and effect.law in answer.output and effect.leaves in answer.output
        for parameter in effect.parameters:
            assert parameter.name in answer.output and parameter.unit in answer.output
        for other, test in effect.confused_with:
            assert other in answer.output and test in answer.output
        change = answer.output[answer.output.index("change by the effect"):]
        assert len({line.split("|")[1] for line in change.splitlines() if "|" in line}) > 1, name


def test_a_card_says_what_a_model_file_may_leave_out():
    line = "transverse_ratio: only force_y shows it, so a model file may leave it out"
    assert line in run("second_mode").output and "may leave it out" not in run("runout").output


def test_the_card_stands_before_the_effect_is_compiled_and_can_do_without_its_picture(tmp_path, monkeypatch):
    import testbed.cli._fingerprint as drawing

    said = []
    monkeypatch.setattr(drawing, "fingerprint", lambda *_: said.append(True) or 1 / 0)
    assert "law: " in run("runout", "--no-picture").output and not said
    answer = CliRunner().invoke(command, ["runout"])
    assert said and isinstance(answer.exception, ZeroDivisionError) and "in model.yaml: effects: {runout:" in answer.output


def test_an_effect_of_no_known_name_is_looked_for_in_the_user_s_own_folders():
    from testbed.problem import InputProblem

    with pytest.raises(InputProblem, match="give the folder of its file: --effects DIR$"):
        run("zzz")
    with pytest.raises(InputProblem) as close:
        run("run_out")
    assert "did you mean runout?" in str(close.value) and "--effects" not in str(close.value)


def test_a_card_as_json():
    card = json.loads(run("runout", "--json", "-", "--quiet").output)
    assert card["name"] == "runout" and [one["name"] for one in card["parameters"]] == ["offset", "angle"]
    assert card["parameters"][0]["unit"] == "m"


def test_the_picture_puts_a_ramp_where_it_belongs():
    x = np.linspace(0.0, 1.0, 400)
    lines = picture(x, 5.0 * x, width=8, height=2)
    assert lines[0].strip().startswith("5 |") and lines[1].strip().startswith("0 |")
    top, bottom = (line.split("|")[1] for line in lines[:2])
    blank = {"\u2800", " "}
    assert set(top[:4]) <= blank and set(bottom[4:]) <= blank and top[-1] not in blank and bottom[0] not in blank
    assert picture(x, np.full(400, np.nan)) == ["(no finite values)"]
    assert len(picture(x, np.zeros(400))) == 5


@pytest.mark.long
def test_a_new_effect_works_as_it_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    answer = run("--new", "my_effect")
    assert answer.exit_code == 0 and {path.name for path in tmp_path.iterdir()} == {"my_effect.py", "test_my_effect.py"}
    assert "pytest is in the extra `dev` alone" in answer.output
    effect = catalogue(tmp_path)["my_effect"]
    assert effect.title == "My effect" and effect.hooks["structure_force"](2.0, 3.0) == -6.0
    found = subprocess.run([sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_my_effect.py"],
                           capture_output=True, text=True, timeout=300, check=False)
    assert found.returncode == 0 and "4 passed" in found.stdout, found.stdout + found.stderr


@pytest.mark.long
def test_the_first_preview_says_that_it_compiles(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TESTBED_CACHE", str(tmp_path / "cache"))
    cache_folder.cache_clear()
    try:
        run("--new", "fresh_effect")
        first, second = (run("fresh_effect", "--effects", ".").output for _ in range(2))
    finally:
        cache_folder.cache_clear()
    line = "  it is compiled first: some ten seconds, once for each version of its file\n"
    assert "change by the effect, um" in first and first.replace(line, "") == second != first


def test_a_name_that_is_taken_or_is_none_is_refused(tmp_path, monkeypatch):
    from testbed.problem import InputProblem

    monkeypatch.chdir(tmp_path)
    for name in ("runout", "no-name", "test_mine", "_mine"):
        with pytest.raises(InputProblem):
            run("--new", name)
    (tmp_path / "mine.py").write_text("kept")
    with pytest.raises(InputProblem, match="exists already"):
        run("--new", "mine")
    assert (tmp_path / "mine.py").read_text() == "kept" and not (tmp_path / "test_mine.py").exists()
