"""What is loaded and simulated by the Python API: the same as by the command line, and light to import."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import testbed
from tests.support.shell import Shell

MODEL = """structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
cutter: {flutes: 1, diameter: 19.05 mm}
cutting: {immersion: 0.162, tangential_coefficient: 550 N/mm^2, normal_coefficient: 200 N/mm^2}
"""
SCENARIO = """seed: 3
model: {file: model.yaml}
cut: {feed: 0.2 mm/tooth, idle: 2 rev, cutting: 10 rev, ring_down: 4 rev}
tests: [{spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm}, {spindle_speed: 2850 rpm, depth_of_cut: 2.9 mm}]
sensors: {displacement: {noise: 0.5 um}, velocity: {}}
"""
CAMPAIGN = """name: one
sampling_rate: 12800 Hz
channels: {displacement: {column: x, unit: um}}
records: [{file: x.csv, kind: ring-down}]
"""


@pytest.fixture
def shell(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rings = np.exp(-30 * np.arange(4000) / 12800) * np.sin(2 * np.pi * 146.6 * np.arange(4000) / 12800)
    for name, text in {"model.yaml": MODEL, "scenario.yaml": SCENARIO, "campaign.yaml": CAMPAIGN,
                       "x.csv": "x\n" + "\n".join(f"{value:.6g}" for value in 100 * rings) + "\n"}.items():
        Path(name).write_text(text)
    return Shell(capsys)


def test_a_sweep_is_that_of_the_command_line(shell):
    told = []
    found = testbed.sweep("scenario.yaml", "ours.h5", workers=2, progress=lambda *step: told.append(step))
    theirs = shell.json("run", "scenario.yaml", "-o", "theirs.h5", "--workers", 2)
    assert found.to_dict() == theirs | {"output": "ours.h5"} and found.to_dict()["content_hash"] == found.data.content_hash
    assert told[-1] == ("scenario", 2, 2) and repr(found) == "<Sweep: ours.h5, 2 runs (2 ok), 2 computed now>"
    assert len(found.data.to_pandas()) == 2 and found.data.to_xarray()["displacement"].shape[0] == 2
    with pytest.raises(testbed.InputProblem, match="ours.h5: exists already"):
        testbed.sweep("scenario.yaml", "ours.h5")


@pytest.mark.parametrize("engine", ["fast", "mujoco"])
def test_one_cut_is_that_of_a_scenario(shell, engine):
    scenario = testbed.load("scenario.yaml", testbed.Scenario)
    first = testbed.sweep(scenario, "all.h5", engine=engine).data.recording(0)
    found = testbed.simulate("model.yaml", "3810 rpm", "2.9 mm", feed="0.2 mm/tooth", revolutions=(2, 10, 4), seed=3,
                             engine=engine, channels=("displacement", "velocity"), noise={"displacement": "0.5 um"})
    for name in ("displacement", "velocity"):  # which are stored in single precision
        assert np.array_equal(found.channels[name].astype(np.float32), first.channels[name].astype(np.float32))
        assert np.ptp(found.channels[name]) > 1e-5
    assert found.to_xarray().velocity.attrs["units"] == "m/s" and len(found.to_pandas()) == len(found)
    assert len(found.plot().axes) == 2 and repr(found).startswith("<Recording: displacement [m], velocity [m/s], ")


@pytest.mark.parametrize(("given", "said"), [
    ({"channels": "displacment"}, "channels: there is no 'displacment': did you mean displacement?"),
    ({"noise": {"velocity": 1.0}}, "channels: there is no 'velocity'"),
    ({"noise": "1 mm/s"}, "noise of displacement: "),
    ({"revolutions": (0, 0, 0)}, "revolutions: .* is over before it begins"),
    ({"revolutions": (1, 2.5, 0)}, "revolutions: .* whole number"),
    ({"rate": "3810 rpm"}, "rate: '3810 rpm' is a speed of turning"),
    ({"engine": "slow"}, "engine: there is no 'slow'"),
])
def test_a_cut_asked_for_wrongly_is_refused(shell, given, said):
    with pytest.raises(testbed.InputProblem, match=said):
        testbed.simulate("model.yaml", "3810 rpm", "2.9 mm", **given)


def test_a_file_is_loaded_by_what_it_is(shell):
    model, campaign = testbed.load("model.yaml"), testbed.load("campaign.yaml")
    assert isinstance(model, testbed.Model) and model.file == "model.yaml" and model.structure.natural_frequency == 146.6
    assert model.with_values({"damping_ratio": 0.01}).file == "" and model.with_effect("contact_loss").file == ""
    assert isinstance(campaign, testbed.Campaign) and repr(campaign) == "<Campaign: one, 1 records, campaign.yaml>"
    assert len(testbed.inspect(campaign).records) == 1
    assert testbed.inspect(campaign).json == testbed.inspect("campaign.yaml").json
    assert "<td>damping_ratio</td><td>0.0032 </td>" in model._repr_html_()
    assert testbed.multipliers(model, "3810 rpm", "2 mm").json == testbed.multipliers("model.yaml", "3810 rpm", "2 mm").json
    Path("own").mkdir()
    (Path("own") / "notes.py").write_text("x = 1\n")
    own = testbed.load("own")
    assert own.folders == ("own",) and "process_damping" in own and "process_damping" in own._repr_html_()


@pytest.mark.parametrize(("name", "text", "said"), [
    ("nix.yaml", None, "nix.yaml: there is no such file"),
    ("other.yaml", "key: value\n", "other.yaml: is no model, campaign, taps or scenario"),
    ("x.csv", None, "x.csv: is no data set of `testbed run`, and no YAML file: testbed.inspect looks"),
    ("empty", None, "empty: there is no such file"),
    (".", None, "is a folder without effects"),
    ("nix.h5", None, "nix.h5: there is no such file"),
])
def test_what_cannot_be_loaded_is_told(shell, name, text, said):
    if text:
        Path(name).write_text(text)
    with pytest.raises(testbed.InputProblem, match=said):
        testbed.load(name)


def test_a_file_of_another_kind_is_refused(shell):
    with pytest.raises(testbed.InputProblem, match="model.yaml: is a Model, no Campaign"):
        testbed.load("model.yaml", testbed.Campaign)
    with pytest.raises(testbed.InputProblem, match="model: a Campaign is no model"):
        testbed.multipliers(testbed.load("campaign.yaml"), "3810 rpm", "2 mm")
    with pytest.raises(testbed.InputProblem, match="data: a Model holds no records"):
        testbed.identify(testbed.load("model.yaml"), "model.yaml")


def test_importing_is_light():
    code = "import sys, testbed, testbed.cli; testbed.InputProblem; print([m for m in sys.modules if m in " \
           "('numpy', 'scipy', 'matplotlib', 'numba', 'pandas', 'xarray', 'mujoco', 'h5py', 'pydantic', 'rich')])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_every_public_name_is_there_and_told():
    assert set(testbed.__all__) <= set(dir(testbed)) and testbed.__version__
    for name in testbed.__all__:
        found = getattr(testbed, name)
        assert name == "__version__" or (found.__doc__ and found.__module__.startswith("testbed."))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = testbed.nonsense
