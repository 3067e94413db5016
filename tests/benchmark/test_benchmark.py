"""The benchmark: campaigns whose truth is sealed, answers that are checked, scores that count what was not answered."""

import json
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.benchmark.answers import PARAMETERS, Answer, read_answers
from testbed.benchmark.scores import score
from testbed.cli._baselines import METHODS, _off_harmonics
from testbed.cli._benchmark import CLEAR, NONE_HIDDEN
from testbed.cli._demo_loop import HIDDEN
from testbed.problem import InputProblem
from testbed.recording import Recording
from tests.support import doc_pages
from tests.support.export_files import run

ASKED = {"c1": ["cut_0", "cut_1"], "c2": ["cut_0"]}
EFFECTS = ("process_damping", "runout")
TRUTH = {"c1": {"parameters": {"natural_frequency": 100.0, "damping_ratio": 0.01, "tangential_coefficient": 5e8},
                "effects": ["runout"], "chatter": {"cut_0": True, "cut_1": False}},
         "c2": {"parameters": {"natural_frequency": 200.0, "damping_ratio": 0.02, "tangential_coefficient": 4e8},
                "effects": [], "chatter": {"cut_0": True}}}


def test_scores_by_hand():
    found = score(TRUTH, {
        "c1": Answer({"natural_frequency": (101.0, 99.0, 103.0)}, ("process_damping", "runout"), {"cut_0": True}),
        "c2": Answer({"natural_frequency": (190.0, 189.0, 191.0), "damping_ratio": (0.02, math.nan, math.nan)}, (),
                     {"cut_0": False})})
    frequency, damping, force = found.parameters
    assert (frequency.answered, frequency.intervals, frequency.coverage) == (2, 2, 0.5)
    assert frequency.error == pytest.approx(0.03) and frequency.worst == pytest.approx(0.05)
    assert frequency.width == pytest.approx((0.04 + 0.01) / 2)
    assert (damping.answered, damping.error, damping.intervals) == (1, 0.0, 0) and math.isnan(damping.coverage)
    assert force.answered == 0 and math.isnan(force.error)
    assert (found.right, found.wrong, found.none) == (1, 1, 0)
    assert (found.recall_chatter, found.recall_quiet, found.balanced_accuracy) == (0.5, 0.0, 0.25)
    assert (found.answered, found.cuts) == (2, 3)


def test_silence_is_never_right():
    nothing = score(TRUTH, {})
    assert (nothing.right, nothing.wrong, nothing.none) == (0, 0, 2) and nothing.balanced_accuracy == 0.0
    said = score(TRUTH, {"c1": Answer(effects=()), "c2": Answer(effects=None)})
    assert (said.right, said.none) == (0, 2)


@pytest.mark.parametrize(("given", "said"), [
    ("[1]", "has no `campaigns`"), ("{", "is no JSON"), ('{"campaigns": {"c9": {}}}', "'c9' is not known"),
    ('{"campaigns": {"c1": {"effekts": []}}}', "did you mean effects?"),
    ('{"campaigns": {"c1": {"effects": ["runnout"]}}}', "did you mean runout?"),
    ('{"campaigns": {"c1": {"effects": "runout"}}}', "no list of names"),
    ('{"campaigns": {"c1": {"chatter": {"cut_0": 1}}}}', "give true, false, or null"),
    ('{"campaigns": {"c2": {"chatter": {"cut_1": true}}}}', "'cut_1' is not known"),
    ('{"campaigns": {"c1": {"parameters": {"damping_ratio": 0.1}}}}', "no value with its interval"),
    ('{"campaigns": {"c1": {"parameters": {"damping_ratio": {"value": null}}}}}', "value is no number"),
    ('{"campaigns": {"c1": {"parameters": {"damping_ratio": {"value": 1, "low": 2, "high": 1}}}}}', "is no interval"),
    ('{"campaigns": {"c1": {"parameters": {"damping_ratio": {"value": 1, "low": 0}}}}}', "is no interval"),
    ('{"campaigns": {"c1": 3}}', "is no mapping")])
def test_what_is_misspelt_is_no_missing_answer(tmp_path, given, said):
    (tmp_path / "a.json").write_text(given)
    with pytest.raises(InputProblem, match="a.json") as problem:
        read_answers(tmp_path / "a.json", ASKED, EFFECTS)
    assert said in str(problem.value)


def test_an_answer_comes_back_as_it_was_written(tmp_path):
    one = Answer({"natural_frequency": (1.0, 0.5, 2.0), "damping_ratio": (0.1, math.nan, math.nan)}, ("runout",),
                 {"cut_1": False})
    (tmp_path / "a.json").write_text(json.dumps({"campaigns": {"c1": one.as_json()}}))
    back = read_answers(tmp_path / "a.json", ASKED, EFFECTS)["c1"]
    assert back.as_json() == one.as_json() and back.parameters["natural_frequency"] == (1.0, 0.5, 2.0)
    assert read_answers(tmp_path / "a.json", ASKED, EFFECTS).keys() == {"c1"}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A benchmark of one campaign."""
    folder = tmp_path_factory.mktemp("benchmark") / "bench"
    assert run("benchmark", folder, "--campaigns", 1, "--seed", 8, "--method", "naive", "--quiet") == 0
    return folder


def test_the_truth_is_apart_and_sealed(made, tmp_path, capsys):
    secret = made.with_name("bench-truth.json")
    truth = json.loads(secret.read_text())["campaigns"]["c1"]
    files = [path for path in made.rglob("*") if path.is_file()]
    assert len(files) == 4 + 5 + 2 + 6 + 1 and {path.suffix for path in files} == {".csv", ".yaml", ".json", ".md"}
    for path in files:
        text = path.read_text()
        assert "seed" not in text and repr(truth["parameters"]["natural_frequency"]) not in text, path
    assert counted(truth["chatter"]) == {True: 3, False: 3} and set(truth["parameters"]) == set(PARAMETERS)
    (tmp_path / "t.json").write_text(secret.read_text().replace("cut_0", "cut_1", 1))
    assert run("benchmark", made, "--truth", tmp_path / "t.json") == 2
    assert "is not the truth that was sealed" in capsys.readouterr().err
    (tmp_path / "bench").mkdir()
    for path in ("benchmark.json",):
        (tmp_path / "bench" / path).write_text((made / path).read_text())
    assert run("benchmark", tmp_path / "bench") == 2 and "the truth is sealed" in capsys.readouterr().err


def counted(chatter):
    return {which: list(chatter.values()).count(which) for which in (True, False)}


def test_the_cuts_to_be_judged_are_what_the_truth_says(made):
    """Second road, by the recorded volts alone: of once-a-turn samples, does the spread die, to a fifth or to the noise?"""
    truth = json.loads(made.with_name("bench-truth.json").read_text())["campaigns"]["c1"]["chatter"]
    for cut, chatters in truth.items():
        displacement, volts = np.loadtxt(made / "campaigns" / "c1" / "judge" / f"{cut}.csv", delimiter=",", skiprows=1).T
        marks = np.nonzero((volts[:-1] < 2.5) & (volts[1:] >= 2.5))[0].astype(float)
        marks += (2.5 - volts[marks.astype(int)]) / (volts[marks.astype(int) + 1] - volts[marks.astype(int)])
        early, late = (np.interp(marks[turns], np.arange(displacement.size), displacement).std()
                       for turns in (slice(15, 30), slice(45, 60)))  # of 12 idle turns and 50 in the cut
        assert (late > 0.2 * early and late > 2.2) == chatters, (cut, early, late)  # um


def test_answers_are_scored_beside_the_baselines(made, tmp_path, capsys):
    truth = json.loads(made.with_name("bench-truth.json").read_text())["campaigns"]["c1"]
    perfect = {"parameters": {name: {"value": value, "low": value, "high": value}
                              for name, value in truth["parameters"].items()},
               "effects": truth["effects"], "chatter": truth["chatter"]}
    (tmp_path / "mine.json").write_text(json.dumps({"campaigns": {"c1": perfect}}))
    assert run("benchmark", made, tmp_path / "mine.json", "--json", tmp_path / "said.json") == 0
    scores = json.loads((tmp_path / "said.json").read_text())["scores"]
    assert list(scores) == ["naive", "spectral", "mine.json"]
    mine, naive, spectral = scores["mine.json"], scores["naive"], scores["spectral"]
    assert mine["right"] == 1 and mine["balanced_accuracy"] == 1.0
    assert all(one["error"] == 0.0 and one["coverage"] == 1.0 for one in mine["parameters"].values())
    assert naive["balanced_accuracy"] == 0.5 and naive["parameters"]["natural_frequency"]["error"] > 0.005
    assert spectral["parameters"]["natural_frequency"]["error"] < 0.004 and spectral["answered"] == 6
    assert "mine.json" in capsys.readouterr().out


@pytest.mark.parametrize(("order", "low", "high"), [(3.0, 0.0, 0.1), (2.5, 0.99, 1.0), (2.7, 0.99, 1.0)])
def test_the_spectral_method_hears_what_is_off_the_tooth_harmonics(order, low, high):
    time = np.arange(6400) / 3200.0  # 25 Hz of tooth passing, from 0.5 s to 1.5 s
    values = np.where((time > 0.5) & (time < 1.5), np.sin(2 * np.pi * 25 * order * time), 0.0)
    recording = Recording({"displacement": values}, 3200.0, {"displacement": "m"}, "measured")
    conditions = {"spindle_speed": 50 * np.pi, "axial_depth_of_cut": 1e-3, "feed_per_tooth": 1e-4}
    assert low <= _off_harmonics(SimpleNamespace(recording=recording, conditions=conditions)) <= high


def test_the_same_seed_makes_the_same_files(made, tmp_path):
    assert run("benchmark", tmp_path / "again", "--campaigns", 1, "--seed", 8, "--method", "naive", "--quiet") == 0
    for path in (one.relative_to(made) for one in made.rglob("*.csv")):
        assert (made / path).read_bytes() == (tmp_path / "again" / path).read_bytes()
    assert (made / "benchmark.json").read_bytes() == (tmp_path / "again" / "benchmark.json").read_bytes()


@pytest.mark.parametrize(("arguments", "said"), [
    (["nothing", "mine.json"], "does not exist"), (["{made}", "--seed", 1], "exists already"),
    (["{made}", "--truth", "none.json"], "cannot be read"), (["{made}", "none.json"], "cannot be read"),
    ([".", "--method", "naive"], "exists and is no benchmark"), (["{made}", "--method", "magic"], "magic")])
def test_bad_orders_are_refused_in_one_line(made, tmp_path, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    assert run("benchmark", *(str(one).format(made=made) for one in arguments)) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ") and err.count("\n") == 1 and said in err and list(tmp_path.iterdir()) == []


def test_the_page_says_what_the_program_does():
    page = doc_pages.read("benchmark.md")
    last = page.split("## What it does not tell")[1]
    assert set(re.findall(r"`(\w+)`", last)) == set(HIDDEN)
    assert f"farther than {CLEAR:g} from 1" in page and NONE_HIDDEN == 0.25 and "A quarter of the campaigns" in page
    assert set(doc_pages.tables(page)["Baselines"].keys()) == set(METHODS)


@pytest.mark.long
def test_the_page_s_results_are_those_of_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = doc_pages.read("benchmark.md")
    command = next(line for line in doc_pages.blocks(page, "sh")[-1].splitlines() if "--seed" in line)
    asked = [word for word in command.split()[1:] if word not in ("--method", "naive", "spectral", "testbed")]
    assert run(*asked) == 0
    said = {line.split()[0]: line.split()[1:] for line in capsys.readouterr().out.splitlines()
            if line.startswith(("naive", "spectral"))}
    told = {row[0].strip("`"): " ".join(row[1:]).split() for row in doc_pages.tables(page)["Results"].rows}
    assert len(said) == 2 and all(told[name] == row for name, row in said.items())
