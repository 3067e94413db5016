"""docs/answers.md names every key that a command answers with and no other: real answers, and built ones for what is rare."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import get_args, get_type_hints

import click
import numpy as np
import pytest

from testbed.analysis.comparison.adequacy import FALSE_DISCOVERIES
from testbed.analysis.comparison.tapped import TappedParameter
from testbed.analysis.estimate import Estimate
from testbed.analysis.fit import drift, evidence, observe
from testbed.analysis.force import explanation
from testbed.analysis.force.ranking import Ranked
from testbed.analysis.linear.chart_plot import ChartTest
from testbed.analysis.linear.stability import CLASSES
from testbed.analysis.multipliers.baseline_scores import Baseline, ClassifierScore, RegressorScore
from testbed.analysis.multipliers.baseline_scores import as_json as baseline_json
from testbed.analysis.paper.part import Part, Picture, Statement, Table, as_dict
from testbed.analysis.records.chatter_line import LineTrack
from testbed.analysis.records.inspection import inspect
from testbed.analysis.records.lines import CombSpeed, LineKind
from testbed.analysis.records.noise import Basis
from testbed.analysis.records.ring_downs import RingDown, RungMode
from testbed.analysis.records.segments import Kind
from testbed.analysis.search import answer, diagnosis
from testbed.analysis.search.candidate import Tried
from testbed.analysis.search.diagnosis import Diagnosis, OtherForm
from testbed.analysis.search.next_test import NextTest
from testbed.api.result import plain
from testbed.cli import doctor
from testbed.cli import testbed as commands
from testbed.effect import HOOKS
from testbed.engines import fast
from testbed.recording import Outcome
from testbed.system import interruption
from testbed.trial.proposal import Coefficient, ForceTerm
from testbed.workshop import write_campaign
from tests.support import doc_pages
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.doc_pages import ROOT, codes
from tests.support.made_decays import rung
from tests.support.made_taps import B2, Hammer, write_taps
from tests.support.shell import Shell
from tests.support.synthetic_campaign import synthetic_campaign

ANSWERS = doc_pages.read("answers.md")
PATHS = doc_pages.tables(ANSWERS)
FIRST = {kind: doc_pages.examples(doc_pages.read("files.md"), kind)[0] for kind in ("model", "scenario")}
SECTIONS_OF = {"effects --hooks": "effects", "effects --new": "effects", "inspect of an exported set": "inspect"}
NO_COMMAND = {"Exit codes", "What the verdicts mean, and what to do next"}


def test_every_command_with_an_answer_has_a_section():
    names = commands.list_commands(click.Context(commands))
    with_json = {name for name in names if any(one.name == "json_file" for one in
                                               commands.get_command(click.Context(commands), name).params)}
    assert {SECTIONS_OF.get(heading, heading) for heading in PATHS} - NO_COMMAND == with_json


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Two short cuts of a machine without a hidden effect, as a workshop's files."""
    folder = tmp_path_factory.mktemp("files")
    cuts = synthetic_campaign(partial(fast.simulate, steps=37), TRUE, seed=4, tests=((3810, 2.9), (2850, 2.9)), rate=3200.0,
                              course=(10, 35, 15))
    write_campaign(folder, cuts, BELIEVED)
    time = np.arange(2000) / 2000.0
    tap = 50 * np.exp(-0.01 * 2 * np.pi * 80 * time) * np.sin(2 * np.pi * 80 * time)
    noise = 0.2 * np.random.default_rng(5).standard_normal(time.size)
    np.savetxt(folder / "tap.csv", np.column_stack([time, tap + noise]), "%.5f", ",", header="t,x", comments="")
    (folder / "tap.yaml").write_text("name: tap\nchannels: {displacement: {column: x, unit: um}}\n"
                                     "records: [{file: tap.csv, kind: ring-down}]\n")
    (folder / "bare.yaml").write_text("structure: {mass: 1 kg, natural_frequency: 82 Hz, damping_ratio: 0.02}\n")
    for kind in ("model", "scenario"):
        (folder / f"first_{kind}.yaml").write_text(FIRST[kind].replace("model.yaml}", "first_model.yaml}"))
    return folder


@pytest.fixture
def shell(files, capsys, monkeypatch):
    monkeypatch.chdir(files)
    return Shell(capsys)


def agree(heading, *answers, more=()):
    """The section of a command names what its answers hold, and they hold all that it names. more: tables of other sections."""
    named = doc_pages.named_paths(PATHS[heading]) + [path for table in more for path in doc_pages.named_paths(table)]
    assert doc_pages.missing(named, answers) == []
    assert doc_pages.unheard(named, answers) == []


def test_of_data_sets(shell, files):
    """The first example's scenario, simulated, then all that is done with a data set."""
    run = shell.json("run", "first_scenario.yaml", "-o", "tests.h5")
    agree("run", run)
    assert run["outcomes"] == {"ok": 3} and set(get_args(Outcome)) <= set(codes(PATHS["run"].rows[3][2]))
    agree("verify", shell.json("verify", "tests.h5"))
    fitted = [shell.json("identify", "tests.h5", "-m", "first_model.yaml", "--method", method)
              for method in ("multipliers", "waveform")]
    agree("identify", *fitted)
    agree("score", shell.json("score", "tests.h5", "--noise", "1um", "--repeats", 1))
    ranges = ("--speed", "2500:4500:3", "--depth", "1:4:2")
    laid_over = {"tests": [plain(ChartTest(1.0, 1e-3, "stable", "run 0"))]}
    spread = FIRST["model"].replace("600 N/mm^2", "600 +- 60 N/mm^2")
    Path("spread.yaml").write_text(spread)
    charts = [shell.json("chart", name, *ranges, "-o", "pictures", "--draws", 20)
              for name in ("first_model.yaml", "spread.yaml")]
    assert charts[0]["stable_probability"] is None is charts[1]["no_chance"] and "deviation" in charts[0]["no_chance"]
    agree("chart", *charts, laid_over)
    exported = shell.json("export", "tests.h5", "-o", "set")
    windows = shell.json("export", "tests.h5", "-o", "windows", "--window", 256, "--rate", "6400 Hz")
    classifier = ClassifierScore("test", 1, 1, 1.0, 1.0, 1.0, 1.0, {"flip": {"flip": 1}})
    scores = {"baseline": baseline_json(Baseline(1, (classifier,), (RegressorScore("test", "mass", 1, 1.0, 1.0, 0.5),), ()))}
    agree("export", exported, windows, scores)
    inside = [shell.json("inspect", place) for place in ("set", *map(str, Path("set/data").iterdir()), "windows")]
    assert [one["kind"] for one in inside] == ["exported_set", "exported_shard", "exported_set"]
    agree("inspect of an exported set", *inside, scores, {"folder": "set"}, more=[PATHS["export"]])


def test_of_the_benchmark(shell):
    agree("benchmark", shell.json("benchmark", "bench", "--campaigns", 1, "--seed", 8, "--method", "spectral"))


ONE = Estimate(1.0, 0.9, 1.1, "Hz")
RUNG = RingDown(0.0, 1.0, (RungMode(ONE, ONE, 1.0, {"acceleration_x": ONE}, ONE),), 0.01)
BESIDE = {"tap": [TappedParameter("natural_frequency", ONE, 0.8, 0.85, True).as_json()]}


def test_of_tap(shell, files):
    pytest.importorskip("sdypy.EMA", reason="needs the extra package sdypy-EMA")
    struck = shell.json("tap", write_taps(files, B2[:2], "xx xx", Hammer(blows=2, spacing=0.5)))
    motion = rung(((450.0, 0.02, 0.4, 1.0),), np.arange(4000) / 12800.0)
    np.savetxt(files / "rung.csv", motion.T, delimiter=",", header="x,y", comments="")
    sensed = "response: {{column: {0}, unit: m/s^2, quantity: acceleration}}"
    (files / "rung.yaml").write_text("sampling_rate: 12800 Hz\ntaps:\n" + "".join(
        f"  - {{file: rung.csv, direction: {axis}, {sensed.format(axis)}}}\n" for axis in "xy"))
    agree("tap", struck, shell.json("tap", "rung.yaml"))


def test_of_multipliers(shell):
    agree("multipliers", shell.json("multipliers", "model.yaml", "--speed", 3810, "--depth", 2))
    assert set(CLASSES) <= set(codes(PATHS["multipliers"].rows[2][2]))


def test_of_inspection(shell, files):
    found = inspect(files / "campaign.yaml")
    track = LineTrack(*np.ones((3, 7)))
    followed = replace(found, records=(replace(found.records[0], chatter_line=track, blows=(0.5, 2.0)),)).as_json()
    agree("inspect", *(shell.json("inspect", name) for name in ("campaign.yaml", "tap.csv", "tap.yaml")), plain(followed),
          {"records": [{"ring_downs": [plain(RUNG.as_json())]}]})
    known = {*get_args(Kind), *get_args(LineKind), *get_args(get_type_hints(CombSpeed)["basis"]), *get_args(Basis)}
    assert known <= {code for row in PATHS["inspect"].rows for code in codes(row[2])}


def test_of_comparison(shell):
    found = shell.json("compare", "campaign.yaml", "-m", "model.yaml")
    agree("compare", found, BESIDE)
    assert all(0.8 < one["chi_square"] < 1.25 for one in found["records"])  # a mean square, as the page says


def test_of_the_plan(shell):
    found = shell.json("plan", "campaign.yaml", "-m", "model.yaml", "--speed", "2600:4400:3", "--depth", "1:2:2", "--draws", 20)
    told = {"no_plan": "unexplained", "next": [{"separates": ["helix"]}]}
    agree("plan", found, told)


def test_of_addition(shell):
    found = shell.json("add", "process_damping", "-c", "campaign.yaml", "-m", "model.yaml", "-o", "new.yaml")
    agree("add", found)
    assert found["parameters"]["process_damping.coefficient"]["value"] == 0.0  # nothing is hidden: so nothing is written
    assert found["vanished"] == ["process_damping"] and not Path("new.yaml").exists()
    assert "not written: Process damping" in shell.err


def _diagnosis():
    """A diagnosis with all that one can hold."""
    tried = Tried(("helix",), {"helix.angle": 0.1}, 0.1, 0.1, 20.0, True)
    form = OtherForm("quadratic_damping", 2.0, 3.0, 2.9, 3.1, 50.0, 1.01, {"coefficient": 1.0}, ("dry_friction",))
    return Diagnosis("unexplained", ("helix",), "It is.", 0.2, 0.1, 0.1, (tried,), tried, tried, (tried,),
                     NextTest(1.0, 1e-3, 5.0), ("helix", "sensor_lag"), form, ("feed", 0.5))


def _explanation():
    """A missing force explained, with all that this can hold; the ranking, which takes records, is given."""
    term = ForceTerm("cube", "structure_force", "v^3", "velocity**3", "N s^3/m^3", "a cube")
    found = explanation.Explanation((Coefficient(term, 1.0, 0.9, 1.1),), 0.9, ((("v",), 0.5),), {"stiffness": 1.0},
                                      ("a drag",), None, (), ())
    ranked = (Ranked(("velocity",), 0.9),)
    vars(found).update(in_cut=ranked, out_of_cut=ranked)
    return found


@pytest.mark.long
def test_of_diagnosis(shell):
    cuts = shell.json("diagnose", "campaign.yaml", "-m", "model.yaml")
    tap = shell.json("diagnose", "tap.yaml", "-m", "bare.yaml", "--decoys", "--false-alarms", 1)
    assert cuts["verdict"] == tap["verdict"] == "adequate" and cuts["held_out"] and not tap["held_out"]
    whole = plain(answer.as_json(_diagnosis(), BELIEVED))
    proposed = {"proposal": plain(explanation.as_json(_explanation()) | {"file": "proposal.py"})}
    agree("diagnose", cuts, tap, whole, proposed, BESIDE)


def test_the_verdicts_are_those_of_the_program():
    sources = ("diagnosis.py", "diagnose.py", "law_form.py")
    source = "".join((ROOT / "analysis" / "search" / name).read_text() for name in sources)
    given = set(re.findall(r'(?:answer\(|return |verdict=)\s*"([a-z_]+)"', source))
    assert given == set(PATHS["What the verdicts mean, and what to do next"].keys()) and len(given) == 5


def test_the_exit_codes_are_those_of_the_program():
    source = (ROOT / "testbed/cli/__init__.py").read_text()
    given = {int(code) for code in re.findall(r"return (\d+)\n", source)} | {interruption.INTERRUPTED, 1}  # 1: after a fault
    assert {int(code) for code in PATHS["Exit codes"].column("code")} == given


@pytest.mark.parametrize("said", [
    f"at most {diagnosis.ADEQUATE} times the noise floor", f"or up to {diagnosis.FAINT_REST} times",
    f"at most {diagnosis.COMPLETE} times the noise floor", f"take away {100 * diagnosis.EXPLAINED:g} %",
    f"and, above {diagnosis.FAINT_REST}, take away {100 * diagnosis.MOSTLY:g} %",
    f"(three or more effects: {diagnosis.ADEQUATE})",
    f"Above {evidence.DELTA_BIC:g} a gain is worth having", f"with {100 * FALSE_DISCOVERIES:g} % of false discoveries",
    f"a polynomial of {drift.DRIFT_ORDER} terms, and one more for each second, beyond",
    f"{drift.MOST_DRIFT} terms cubic splines of as many",
    f"and {observe.UNRESOLVED:.0e} of the channel's".replace("e-0", "e-"),
])
def test_numbers_in_words_are_those_of_the_program(said):
    assert said in ANSWERS
    assert (diagnosis.MANY, drift.DRIFT_TIME) == (3, 1.0)  # three effects, each second


def test_of_effects(shell):
    card = shell.json("effects", "cubic_stiffness")
    agree("effects", shell.json("effects"), {"effects": [card]})
    hooks = shell.json("effects", "--hooks")
    agree("effects --hooks", hooks)
    assert {hook.joins for hook in HOOKS.values()} == set(codes(PATHS["effects --hooks"].rows[2][2]))
    agree("effects --new", shell.json("effects", "--new", "my_effect"))


def test_of_doctor(shell, monkeypatch):
    monkeypatch.setattr(doctor, "_checked", list)  # what computes and draws has tests of its own
    agree("doctor", shell.json("doctor"))


def test_of_the_paper(shell):
    whole = Part("x", "X", ("text",), (Picture("x", "of x"),), (Table("t", ("a",), (("b",),)),),
                 (Statement("here", "it is", "1", "1", True),), {"number": 1.0})
    agree("paper", shell.json("paper", "--only", "fig1", "--quick", "-o", "paper", "--workers", 1), {"parts": [as_dict(whole)]})
