"""The demo runs whole, and what it says is what it found."""

import json
import math
import os
import re
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from testbed.cli import _demo, _demo_loop, main
from testbed.files.campaign import load_campaign
from testbed.files.model_file import read_model
from testbed.store.data_set import read_data_set
from tests.support import doc_pages
from tests.support.real_data import MEASUREMENTS, needs

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """(folder, what it printed, its JSON) of one run in a pipe."""
    folder = tmp_path_factory.mktemp("demo")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TESTBED_MEASUREMENTS": str(MEASUREMENTS)}
    done = subprocess.run([sys.executable, "-c", "from testbed.cli import main; main()", "demo", "-o", "out", "--json",
                           "demo.json"], cwd=folder, env=environment, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout, json.loads((folder / "demo.json").read_text())


@pytest.mark.long
def test_the_five_published_tests_agree(demo):
    _, said, found = demo
    assert [test["published"] for test in found["published"]] \
        == ["neimark_sacker", "neimark_sacker", "flip", "stable", "stable"]
    for test in found["published"]:
        assert test["linear"] == test["simulated"] == test["published"] and test["agree"]
    assert "5 of 5 agree" in said and len(re.findall(r"^  [A-E] .* yes$", said, re.MULTILINE)) == 5


@pytest.mark.long
def test_the_sweep_is_stored_and_agrees_with_the_chart(demo):
    folder, said, found = demo
    data = read_data_set(folder / "out" / "rig_sweep.h5")
    assert len(data) == len(found["sweep"]) == 24 and data.engine == "mujoco" and data.verify()
    assert all(np.ptp(recording.channels["displacement"]) > 1e-5 for recording in data)
    decided = [cut for cut in found["sweep"] if cut["simulated"] != "undecided"]
    assert len(decided) >= 20 and sum(cut["agree"] for cut in decided) >= len(decided) - 1
    assert {"stable", "neimark_sacker", "flip"} <= {cut["simulated"] for cut in decided}


@pytest.mark.long
def test_the_identification_is_scored(demo):
    found = demo[2]["identification"]
    limits = {"natural_frequency": 0.5 / (2 * math.pi), "damping_ratio": 0.15 * 0.0032,
              "tangential_coefficient": 0.03 * 555.768e6}
    assert {one["parameter"] for one in found["scores"]} == set(limits)
    for one in found["scores"]:
        assert one["count"] == 5 and one["failures"] == 0 and one["noise"] == 0.5e-6
        assert 0 < one["rms"] < limits[one["parameter"]]


@needs("tap_test")
@pytest.mark.long
def test_the_hammer_test_is_identified(demo):
    own, other = (demo[2]["hammer_test"][name] for name in ("time record", "receptance file"))
    assert own["natural_frequency"] == pytest.approx(1067, abs=4) and own["damping_ratio"] == pytest.approx(0.034, abs=0.002)
    assert own["natural_frequency"] == pytest.approx(other["natural_frequency"], abs=1.0)


@pytest.mark.long
def test_it_says_where_everything_is(demo):
    folder, said, found = demo
    for path in (*found["data"], *found["pictures"], found["report"]):
        assert path in said and (folder / path).stat().st_size > (200 if path.endswith(".yaml") else 2000)
    pictures = {Path(path).stem for path in found["pictures"]}
    assert {"published_tests", "stability_chart", "multipliers"} <= pictures
    for name in pictures - {"rig"}:
        assert (folder / "out" / f"{name}.svg").stat().st_size > 5000
    page = (folder / found["report"]).read_text()
    sources = re.findall(r"<img[^>]* src=[\"']([^\"']+)", page)
    assert len(sources) == len(pictures)
    for source in sources:
        assert source.startswith("data:")  # the page stands alone
    assert ("rig.png" in page) != ("no picture of the rig" in said)


@pytest.mark.long
def test_the_hidden_effect_is_named_added_and_revealed_last(demo):
    folder, said, found = demo
    loop = found["workshop"]
    assert loop["diagnosis"]["verdict"] == "missing_effect" and loop["named_right"] is True
    assert loop["diagnosis"]["effects"] == [loop["truth"]["effect"]] == [one["effect"] for one in loop["additions"]]
    error = loop["error"]
    assert error["before"] > 1.3 * error["noise_floor"] and error["after"] < 1.05 * error["noise_floor"]
    base = [one for one in loop["parameters"] if one["parameter"] in _demo_loop.MACHINE]
    assert len(base) == 4 and len(loop["parameters"]) == 4 + len(loop["truth"]["parameters"])
    for one in loop["parameters"]:
        assert one["low"] < one["value"] < one["high"]
        reach = 1.5 * (one["high"] - one["low"])  # three times the half width: a miss by chance is next to impossible
        assert abs(one["value"] - one["truth"]) < reach, one["parameter"]
    for one in base:
        assert abs(one["value"] - one["truth"]) < 0.5 * abs(one["believed"] - one["truth"]), one["parameter"]
    hidden = loop["truth"]["effect"]
    assert said.index(loop["sha256"]) < said.index(hidden) < said.index("the seal")


@pytest.mark.long
def test_it_says_how_sure_and_what_next_once_the_effect_is_added(demo):
    _, said, found = demo
    loop, outlook = found["workshop"], found["outlook"]
    chance = np.array(outlook["stable_probability"], float)
    assert chance.shape == (5, 7) and np.nanmin(chance) < 0.5 < np.nanmax(chance) and outlook["no_chance"] is None
    assert {one["parameter"] for one in outlook["drawn"]} >= {f"{loop['truth']['effect']}.{one}"
                                                              for one in loop["truth"]["parameters"]}
    assert outlook["recommended"]["stable_probability"] >= 0.95 and outlook["next"]
    for one in outlook["next"]:
        assert one["stable_probability"] >= 0.95 and one["vibration"] <= 0.5e-3 and one["information"] > 0.0
    assert np.isfinite(np.array(outlook["limit_before"], float)).any()
    assert said.index("no chance is given") < said.index("testbed plan") < said.index("the seal")


@pytest.mark.long
def test_the_workshop_s_files_hold_nothing_of_the_truth(demo):
    folder, _, found = demo
    loop = found["workshop"]
    place = folder / "out" / "workshop"
    assert sha256((place / "truth.json").read_bytes()).hexdigest() == loop["sha256"]
    assert json.loads((place / "truth.json").read_text()) == loop["truth"]
    for name in ("campaign.yaml", "model.yaml", "cut_0.csv"):
        assert loop["truth"]["effect"] not in (place / name).read_text()
    assert set(read_model(place / "better.yaml").effects) == {loop["truth"]["effect"]}
    assert not read_model(place / "model.yaml").effects
    records = load_campaign(place / "campaign.yaml").records
    assert len(records) == len(_demo_loop.CUTS) and all(len(one.recording.marks) > 60 for one in records)


@pytest.mark.long
def test_the_answer_is_what_its_page_says(demo):
    named = doc_pages.named_paths(doc_pages.tables(doc_pages.read("answers.md"))["demo"])
    assert doc_pages.missing(named, [demo[2]]) == []
    assert doc_pages.unheard(named, [demo[2]]) == []


@pytest.mark.long
def test_the_first_campaign_of_the_pages_reads_what_it_leaves(demo):
    text = doc_pages.examples(doc_pages.read("files.md"), "campaign")[0].replace("demo/workshop", "out/workshop")
    (demo[0] / "first.yaml").write_text(text)
    found, own = (load_campaign(demo[0] / name).records for name in ("first.yaml", "out/workshop/campaign.yaml"))
    for one, other in zip(found, own, strict=True):
        assert np.array_equal(one.recording.channels["displacement"], other.recording.channels["displacement"])
        assert other.conditions.items() >= one.conditions.items() and np.array_equal(one.recording.marks, other.recording.marks)


def test_a_seed_hides_the_same_again_and_seeds_differ():
    drawn = [_demo_loop.draw(seed) for seed in range(40)]
    assert drawn[:3] == [_demo_loop.draw(seed) for seed in range(3)] and drawn[0] != drawn[1]
    assert {one["effect"] for one in drawn} == set(_demo_loop.HIDDEN)
    for one in drawn:
        for name, value in one["parameters"].items():
            low, high = _demo_loop.HIDDEN[one["effect"]][name]
            assert low <= value <= high
        for name, value in one["machine"].items():
            assert 0.005 < abs(one["believed"][name] / value - 1) < 0.35


def test_a_seed_writes_the_same_files_again(tmp_path):
    sealed = []
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        sealed.append(_demo_loop.make(tmp_path / name, 5))
    assert sealed[0].digest == sealed[1].digest
    for path in sealed[0].campaign.parent.iterdir():
        assert path.read_bytes() == (tmp_path / "other" / "workshop" / path.name).read_bytes(), path.name


def test_a_truth_that_was_changed_is_not_believed(tmp_path):
    path = tmp_path / "truth.json"
    path.write_text("{}")
    sealed = _demo_loop.Sealed(tmp_path / "c", tmp_path / "m", path, sha256(b"{ }").hexdigest(), 1.0, 1.0)
    with pytest.raises(RuntimeError, match="changed after it was sealed"):
        _demo_loop.open_truth(sealed, None)


def test_without_measured_blows_the_rig_is_struck_and_found(monkeypatch, tmp_path):
    monkeypatch.setenv("TESTBED_MEASUREMENTS", str(tmp_path))
    assert _demo.tap_test_folder() is None
    with pytest.raises(SystemExit) as stop:
        main(["run", "identification", "-o", str(tmp_path / "rig.h5"), "--quiet"])
    assert stop.value.code == 0
    found = _demo.struck_rig(tmp_path / "rig.h5")
    blow, truth = found["simulated blow"], found["truth"]
    assert blow["natural_frequency"] == pytest.approx(truth["natural_frequency"], rel=1e-5) and 0.0 < blow["misfit"] < 0.02
    assert blow["damping_ratio"] == pytest.approx(truth["damping_ratio"], rel=5e-3)
    assert blow["modal_mass"] == pytest.approx(truth["modal_mass"], rel=2e-3) and blow["modal_mass"] != truth["modal_mass"]


def test_a_rig_that_cannot_be_drawn_is_said(monkeypatch, tmp_path):
    monkeypatch.setenv("MUJOCO_GL", "none")
    said = _demo.draw_rig(tmp_path / "rig.png")
    assert said and "\n" not in said and not (tmp_path / "rig.png").exists()


@pytest.mark.parametrize("place", ["file", "file/inside"])
def test_a_place_that_cannot_be_used(monkeypatch, tmp_path, capsys, place):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("kept")
    with pytest.raises(SystemExit) as stop:
        main(["demo", "-o", place])
    assert stop.value.code == 2 and capsys.readouterr().err.startswith("error: ") and Path("file").read_text() == "kept"


def test_a_stranger_s_campaign_is_not_replaced(tmp_path, capsys):
    (tmp_path / "workshop").mkdir()
    (tmp_path / "workshop" / "campaign.yaml").write_text("mine")
    with pytest.raises(SystemExit) as stop:
        main(["demo", "-o", str(tmp_path), "--quiet"])
    assert stop.value.code == 2 and "no earlier demo's" in capsys.readouterr().err
    assert [path.name for path in tmp_path.rglob("*")] == ["workshop", "campaign.yaml"]


def test_a_stranger_s_data_are_not_replaced(tmp_path, capsys):
    (tmp_path / "rig_published.h5").write_text("mine")
    with pytest.raises(SystemExit) as stop:
        main(["demo", "-o", str(tmp_path), "--quiet"])
    assert stop.value.code == 2 and "exists" in capsys.readouterr().err
    assert (tmp_path / "rig_published.h5").read_text() == "mine"
