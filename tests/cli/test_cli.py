"""The command line as a user meets it: answers, exit codes, one line for bad input, and nothing half-written."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from testbed.catalogue import catalogue
from testbed.cli import ORDER, main
from testbed.cli._answer import Answer
from testbed.files.model_file import read_model
from testbed.store.data_set import read_data_set
from tests.support.shell import Shell

ROOT = Path(__file__).parents[2]
MODEL = """structure: {mass: 2.573 kg, natural_frequency: 147.5 Hz, damping_ratio: 0.005}
cutter: {flutes: 1, diameter: 19.05 mm}
cutting: {immersion: 0.162, tangential_coefficient: 800 N/mm^2, normal_coefficient: 240 N/mm^2}
"""
TRUE = MODEL.replace("147.5 Hz", "146.5976 Hz").replace("0.005", "0.0032").replace("800", "555.768") \
    .replace("240", "166.7304")
SCENARIO = """seed: 3
model: {file: true.yaml}
cut: {idle: 10 rev, cutting: 60 rev, ring_down: 60 rev}
tests:
  - {spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 2850 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 4100 rpm, depth_of_cut: 2.0 mm}
sensors:
  mark_angle: 40 deg
  displacement: {noise: 0.2 um, bits: 16, range: 1 mm}
"""


@pytest.fixture
def testbed(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in (("model.yaml", MODEL), ("true.yaml", TRUE), ("s.yaml", SCENARIO)):
        Path(name).write_text(text)
    return Shell(capsys)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """The scenario's data set, simulated once."""
    folder = tmp_path_factory.mktemp("data")
    (folder / "true.yaml").write_text(TRUE)
    (folder / "s.yaml").write_text(SCENARIO)
    with pytest.raises(SystemExit) as stop:
        main(["run", str(folder / "s.yaml"), "-o", str(folder / "data.h5"), "--quiet"])
    assert stop.value.code == 0
    return folder / "data.h5"


def test_run_writes_a_data_set(testbed):
    answer = testbed.json("run", "s.yaml", "-o", "d.h5", "--workers", 2)
    assert answer["runs"] == answer["computed"] == 3 and answer["outcomes"] == {"ok": 3} and answer["seed"] == 3
    data = read_data_set("d.h5")
    assert data.content_hash == answer["content_hash"] and "<mujoco" in data.model_xml and data.verify()
    assert all(np.ptp(record.channels["displacement"]) > 1e-5 for record in data)


def test_sensors_that_are_too_slow_for_the_vibration_are_told(testbed):
    short = SCENARIO.replace("60 rev", "4 rev")
    for rate, told in (("290 Hz", True), ("12800 Hz", False)):  # the structure swings at 146.6 Hz
        Path("s.yaml").write_text(short.replace("sensors:", f"sensors:\n  sampling_rate: {rate}"))
        notes = testbed.json("run", "s.yaml", "-o", f"{told}.h5")["notes"]
        assert len(notes) == told == testbed.err.count("warning: s.yaml: sensors.sampling_rate, 290 Hz, is below twice the")


def test_both_engines_agree(testbed):
    one = SCENARIO.replace("  - {spindle_speed: 2850 rpm, depth_of_cut: 2.9 mm}\n", "").replace("noise: 0.2 um, ", "")
    Path("one.yaml").write_text(one.replace("60 rev", "10 rev").replace("bits: 16, range: 1 mm", "noise: 0 um"))
    for engine in ("fast", "mujoco"):
        assert testbed("run", "one.yaml", "-o", f"{engine}.h5", "--engine", engine) == 0, testbed.err
    for fast, mujoco in zip(read_data_set("fast.h5"), read_data_set("mujoco.h5"), strict=True):
        size = np.ptp(fast.channels["displacement"])
        assert size > 1e-5
        assert np.max(np.abs(fast.channels["displacement"] - mujoco.channels["displacement"])) < 1e-3 * size


def test_the_seed_can_be_given(testbed):
    first = testbed.json("run", "s.yaml", "-o", "a.h5")["content_hash"]
    assert testbed.json("run", "s.yaml", "-o", "b.h5", "--seed", 3)["content_hash"] == first
    assert testbed.json("run", "s.yaml", "-o", "c.h5", "--seed", 4)["content_hash"] != first


@pytest.mark.parametrize("method", ["multipliers", "waveform"])
def test_identify_finds_the_machine(testbed, data, method):
    answer = testbed.json("identify", data, "-m", "model.yaml", "-o", "new.yaml", "--method", method)
    found = answer["parameters"]
    assert found["natural_frequency"]["value"] == pytest.approx(146.5976, abs=0.1)
    assert found["damping_ratio"]["value"] == pytest.approx(0.0032, rel=0.2)
    assert found["natural_frequency"]["unit"] == "Hz" and found["tangential_coefficient"]["unit"] == "N/m^2"
    for one in found.values():
        assert one["low"] < one["value"] < one["high"]
    written = read_model("new.yaml")
    assert written.structure.natural_frequency == found["natural_frequency"]["value"]
    assert written.cutting.tangential_coefficient == found["tangential_coefficient"]["value"]
    assert len(answer["tests"]) == 3
    for test in answer["tests"]:
        assert abs(complex(*test["measured"][0]) - complex(*test["model"][0])) < 0.02
        assert abs(complex(*test["measured"][0])) > 0.3


def test_score_knows_the_truth(testbed, data):
    answer = testbed.json("score", data, "--noise", "1um", "--repeats", 1)
    scores = answer["scores"]
    assert {one["parameter"]: one["unit"] for one in scores} == {"natural_frequency": "Hz", "damping_ratio": "1",
                                                                 "tangential_coefficient": "N/m^2"}
    assert answer["units"]["noise"] == "m" and answer["units"]["median"] == "s"
    assert {one["parameter"] for one in scores} >= {"natural_frequency", "damping_ratio", "tangential_coefficient"}
    assert {(one["noise"], one["count"], one["failures"]) for one in scores} == {(1e-6, 1, 0)}
    truth = {one["parameter"]: one["truth"] for one in scores}
    assert truth["natural_frequency"] == 146.5976 and truth["damping_ratio"] == 0.0032
    assert all(0 < abs(one["bias"]) < 0.2 * one["truth"] for one in scores)


def test_multipliers(testbed):
    answer = testbed.json("multipliers", "true.yaml", "--speed", 3810, "--depth", 2.9)
    assert answer["class"] == "stable" and answer["spindle_speed"] == pytest.approx(398.982, abs=1e-3)
    assert complex(*answer["multipliers"][0]) == pytest.approx(-0.69637 + 0.38921j, abs=2e-3)
    assert testbed.json("multipliers", "true.yaml", "--speed", 3635, "--depth", 2)["class"] == "flip"


def test_multipliers_know_the_effects(testbed):
    Path("damped.yaml").write_text(TRUE + "effects: {process_damping: {coefficient: 1.0e5 N/m}}\n")
    plain, damped = (testbed.json("multipliers", name, "--speed", 3810, "--depth", 2.9)["multipliers"][0]
                     for name in ("true.yaml", "damped.yaml"))
    assert 1e-3 < abs(complex(*plain) - complex(*damped)) < 0.2


def test_chart(testbed, data):
    ranges = ["--speed", "2500:4500:9", "--depth", "0.5:4:5"]
    answer = testbed.json("chart", "true.yaml", *ranges, "--data", data, "-o", "p")
    assert np.shape(answer["class"]) == (5, 9) and len(answer["tests"]) == 3
    assert {name for row in answer["class"] for name in row} >= {"stable", "neimark_sacker"}
    assert {test["outcome"] for test in answer["tests"]} == {"stable"}
    for name in ("stability_chart.png", "stability_chart.svg"):
        assert (Path("p") / name).stat().st_size > 5000


def test_a_limit_beyond_the_charts_depths_is_no_depth_of_it(testbed):
    for depth, lies in (("3:4:5", "below"), ("0.5:4:15", "within"), ("0.05:0.1:3", "above")):
        answer = testbed.json("chart", "true.yaml", "--speed", "3565:3575:2", "--depth", depth, "-o", "p")
        assert answer["stability_limit_lies"] == [lies, lies]
        assert all((limit is None) == (lies != "within") for limit in answer["stability_limit"]), lies
        if lies == "within":
            assert all(0.5e-3 < limit < 3e-3 for limit in answer["stability_limit"])


def test_chart_with_effects_is_that_of_the_plain_machine_where_they_are_small(testbed):
    Path("slightly.yaml").write_text(TRUE + "effects: {process_damping: {coefficient: 1 N/m}}\n")
    plain, slightly = (testbed.json("chart", name, "--speed", "3000:4000:3", "--depth", "1:3:2", "-o", name[:5])
                       for name in ("true.yaml", "slightly.yaml"))
    assert plain["class"] == slightly["class"]
    assert np.array(plain["largest_multiplier"]) == pytest.approx(np.array(slightly["largest_multiplier"]), abs=2e-3)


def test_effects(testbed):
    names = {effect["name"] for effect in testbed.json("effects")["effects"]}
    assert {"process_damping", "contact_loss", "second_mode", "sensor_lag"} <= names
    card = testbed.json("effects", "process_damping")
    assert card["parameters"][0]["unit"] == "N/m" and card["source"]
    assert "edge_position" in testbed.json("effects", "--hooks")


def test_tables_set_words_to_the_left_and_numbers_to_the_right(capsys):
    Answer(None, False).table(("test", "speed", "verdict", "low", "unit"),
                              [("run 0", "3810 rpm", "stable", "-1e+06 to 1", "1"), ("2", "-", "no", "unknown", "N/m"),
                               ("run 11", "99 rpm", "9 of 10 agree, the rest do not", ".5", "1/s")])
    assert capsys.readouterr().out.splitlines() == [
        "test       speed  verdict                                 low  unit",
        "run 0   3810 rpm  stable                          -1e+06 to 1  1",
        "2              -  no                                  unknown  N/m",
        "run 11    99 rpm  9 of 10 agree, the rest do not           .5  1/s"]


def test_the_catalogue_and_its_hooks_are_set_as_text(testbed):
    assert testbed("effects") == 0
    titles = {effect.title for effect in catalogue().values()}
    begins = {line.index(title) for line in testbed.out.splitlines() for title in titles if line.endswith(f"  {title}")}
    assert len(begins) == 1
    assert testbed("effects", "--hooks") == 0
    assert "sensed_velocity may ask for nothing but the effect's parameters and states\n" in testbed.out
    assert "chip may ask for: penetration, and the effect's parameters and states\n" in testbed.out


@pytest.mark.long
def test_a_new_effect_is_a_file_that_works(testbed):
    assert testbed("effects", "--new", "my_drag") == 0
    assert testbed.json("effects", "my_drag", "--effects", ".", "--no-picture")["name"] == "my_drag"
    effects = catalogue(".")
    assert effects["my_drag"].hooks["structure_force"](2.0, 3.0) == -6.0
    Path("dragged.yaml").write_text(TRUE + "effects: {my_drag: {coefficient: 50 N s/m}}\n")
    assert read_model("dragged.yaml", effects).value("my_drag.coefficient") == 50.0
    assert testbed("multipliers", "dragged.yaml", "--speed", 3000, "--depth", 1) == 2
    assert "my_drag: unknown effect" in testbed.err and "--effects DIR" in testbed.err
    assert testbed("effects", "--new", "my_drag") == 2 and testbed("effects", "--new", "contact_loss") == 2


def test_doctor(testbed):
    answer = testbed.json("doctor")
    assert answer["ok"] and sum("engine: a test cut moves" in one["what"] for one in answer["findings"]) == 2


BAD = {
    "misspelt key": ("s.yaml", SCENARIO.replace("seed", "sed"), ["run", "s.yaml", "-o", "x.h5"], "did you mean seed"),
    "missing unit": ("true.yaml", TRUE.replace("2.573 kg", "2.573"), ["run", "s.yaml", "-o", "x.h5"], "has no unit"),
    "negative depth": ("s.yaml", SCENARIO.replace("2.9 mm", "-2.9 mm"), ["run", "s.yaml", "-o", "x.h5"], "at least 0"),
    "speed of zero": ("s.yaml", SCENARIO.replace("3810", "0"), ["run", "s.yaml", "-o", "x.h5"], "above 0"),
    "immersion above 1": ("model.yaml", MODEL.replace("0.162", "1.62"),
                          ["multipliers", "model.yaml", "--speed", "3000", "--depth", "1"], "at most 0.5"),
    "no such effect": ("model.yaml", MODEL + "effects: {contact_los: {}}\n",
                       ["multipliers", "model.yaml", "--speed", "3000", "--depth", "1"], "did you mean contact_loss"),
    "no cutter": ("model.yaml", "structure: flexure\n",
                  ["chart", "model.yaml", "--speed", "3000", "--depth", "1"], "has no cutter"),
    "no data set": ("x.h5", "not HDF5", ["score", "x.h5"], "x.h5: is no HDF5 file"),
    "absurd depth": ("model.yaml", MODEL, ["multipliers", "model.yaml", "--speed", "3000", "--depth", "5e6"],
                     "'--depth': 5e+06 mm is beyond any cut (1000 mm)"),
    "absurd speed": ("model.yaml", MODEL, ["multipliers", "model.yaml", "--speed", "0.01", "--depth", "2"],
                     "speed 0.01 rpm, depth 2 mm: no multipliers of this cut can be had (the structure swings"),
    "absurd speed with an effect": ("model.yaml", MODEL + "effects: {process_damping: {coefficient: 1e5 N/m}}\n",
                                    ["multipliers", "model.yaml", "--speed", "0.01", "--depth", "2"],
                                    "the structure swings 8.85e+05 times within a tooth pass"),
    "a decimal comma": ("model.yaml", MODEL.replace("147.5", "147,5"),
                        ["multipliers", "model.yaml", "--speed", "3000", "--depth", "1"],
                        "structure: natural_frequency '147,5 Hz' holds a comma: write a decimal point: 147.5 Hz"),
    "a model as data": ("c.yaml", MODEL, ["identify", "c.yaml", "-m", "model.yaml"], "c.yaml"),
    "text as data": ("c.csv", "1,2", ["identify", "c.csv", "-m", "model.yaml"], "campaign.yaml"),
}


@pytest.mark.parametrize("name", sorted(BAD))
def test_bad_input_is_answered_in_one_line(testbed, name):
    file, text, arguments, said = BAD[name]
    Path(file).write_text(text)
    before = sorted(Path().iterdir())
    assert testbed(*arguments) == 2
    assert testbed.err.startswith("error: ") and testbed.err.count("\n") == 1 and said in testbed.err
    assert testbed.out == "" and sorted(Path().iterdir()) == before


@pytest.mark.parametrize(("arguments", "said"), [
    (["multiplier"], "did you mean multipliers"), (["run", "s.yaml"], "'--output'"),
    (["run", "none", "-o", "x.h5"], "none: there is no such file"),
    (["run", "published_test", "-o", "x.h5"], "did you mean published_tests"),
    (["run", "s.yaml", "-o", "none/x.h5"], "there is no folder none"), (["run", "s.yaml", "-o", "."], "is a folder"),
    (["run", "s.yaml", "-o", "s.yaml"], "s.yaml: exists already"),
    (["run", "s.yaml", "-o", "x.h5", "--workers", "0"], "workers"),
    (["run", "s.yaml", "-o", "x.h5", "--json", "none/j.json"], "no folder"),
    (["chart", "model.yaml", "--speed", "2500:4500:0", "--depth", "1"], "0 points"),
    (["chart", "model.yaml", "--speed", "0", "--depth", "1"], "above 0"),
    (["chart", "model.yaml", "--speed", "1:2", "--depth", "1"], "FIRST:LAST:COUNT"),
    (["chart", "model.yaml", "--speed", "4000:3000:10", "--depth", "1"], "'4000:3000:10' does not rise: give FIRST below LAST"),
    (["chart", "model.yaml", "--speed", "3000", "--depth", "1:1:3"], "'1:1:3' does not rise"),
    (["chart", "model.yaml", "--speed", "1e999", "--depth", "1"], "finite"),
    (["chart", "model.yaml", "--speed", "3000 kg", "--depth", "1"], "not a range"),
    (["multipliers", "model.yaml", "--speed", "3000", "--depth", "-1"], "at least 0"),
    (["multipliers", "model.yaml", "--speed", "1:2:3", "--depth", "1"], "one speed"),
    (["multipliers", "model.yaml", "--speed", "3000", "--depth", "1", "--feed", "0.1 mm"], "m/tooth"),
    (["identify", "none.h5", "-m", "model.yaml"], "no such file"),
    (["identify", "none.h5", "-m", "none.yaml"], "none.yaml"),
    (["effects", "proces_damping"], "did you mean process_damping"), (["effects", "--effects", "none"], "not a folder"),
    (["effects", "--new", "class"], "class: is a word of Python: choose another"), (["effects", "--new", "a b"], "no name"),
    (["effects", "--new", "x" * 300], "too long a name"),
])
def test_a_bad_command_line_is_answered_in_one_line(testbed, arguments, said):
    before = sorted(Path().iterdir())
    assert testbed(*arguments) == 2
    assert testbed.err.startswith("error: ") and testbed.err.count("\n") == 1 and said in testbed.err
    assert sorted(Path().iterdir()) == before


def test_noise_below_what_is_there_cannot_be_scored(testbed, data):
    assert testbed("score", data, "--noise", "0.1um") == 2 and "already has" in testbed.err
    assert testbed("score", data, "--noise", "1") == 2 and "no unit" in testbed.err


@pytest.mark.parametrize("share", [0.2, 0.95])
def test_a_truncated_data_set(testbed, data, share):
    whole = Path(data).read_bytes()
    Path("cut.h5").write_bytes(whole[:int(len(whole) * share)])
    run = ["run", "s.yaml", "-o", "cut.h5"]
    for arguments in (["identify", "cut.h5", "-m", "model.yaml"], ["score", "cut.h5"], run, [*run, "--resume"]):
        assert testbed(*arguments) == 2 and testbed.err.count("\n") == 1


def test_every_command_explains_itself_with_an_example(testbed):
    assert testbed() == 0 and "Example:" in testbed.out
    listed = testbed.out
    found = [name for name in ORDER if f"\n  {name} " in listed]
    assert {"run", "identify", "score", "chart", "multipliers", "effects", "doctor", "view"} <= set(found)
    for name in found:
        assert testbed(name, "--help") == 0 and f"Example: testbed {name}" in testbed.out, name


def test_quiet_is_quiet_and_json_goes_to_a_file(testbed):
    arguments = ["multipliers", "true.yaml", "--speed", 3810, "--depth", 2.9, "--quiet", "--json", "m.json"]
    assert testbed(*arguments) == 0 and testbed.out == testbed.err == ""
    assert json.loads(Path("m.json").read_text())["class"] == "stable"


def _started(*arguments):
    return subprocess.Popen([sys.executable, "-c", "from testbed.cli import main; main()", *arguments],
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                            env={**os.environ, "PYTHONPATH": str(ROOT)},
                            # a shell's background job ignores Ctrl-C, and so would what it starts
                            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))


def test_help_imports_nothing_heavy():
    code = "import sys\nfrom testbed.cli import main\ntry:\n    main(['--help'])\nexcept SystemExit:\n    pass\n" \
           "heavy = {'numpy', 'scipy', 'mujoco', 'matplotlib', 'h5py', 'pydantic', 'numba', 'rich'}\n" \
           "print('HEAVY', sorted(heavy & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert "HEAVY []" in done.stdout and "Commands:" in done.stdout


def test_commands_start_without_what_is_slow_and_wanted_by_few():
    code = "import sys, testbed.analysis.search.diagnose, testbed.analysis.comparison.compare\n" \
           "import testbed.analysis.multipliers.identify\n" \
           "import testbed.analysis.tap.uncertain, testbed.analysis.report.story_page, testbed.analysis.force.latent_force\n" \
           "print('SLOW', sorted({'scipy.stats', 'scipy.signal', 'mujoco', 'matplotlib'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert "SLOW []" in done.stdout


def test_ctrl_c_keeps_what_is_finished_and_says_how_to_go_on(testbed):
    many = SCENARIO.replace("60 rev", "100 rev").replace("seed: 3\n", "seed: 3\nrepeats: 6000\n")
    Path("many.yaml").write_text(many)
    process = _started("run", "many.yaml", "-o", "many.h5")
    deadline = time.monotonic() + 180  # a kernel may have to be compiled first, beside other tests
    while not list(Path().glob("many.h5.parts/runs-*.h5")) and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130 and "Traceback" not in said
    assert "testbed run many.yaml --output many.h5 --resume" in said
    assert not Path("many.h5").exists()
    kept = sorted(Path().glob("many.h5.parts/runs-*.h5"))
    assert kept and all(len(read_data_set(shard)) > 0 for shard in kept)


def test_the_package_runs_as_a_module():
    done = subprocess.run([sys.executable, "-m", "testbed", "--version"], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.startswith("testbed ")
    assert subprocess.run([sys.executable, "-m", "testbed", "runn"], capture_output=True, cwd=ROOT).returncode == 2
