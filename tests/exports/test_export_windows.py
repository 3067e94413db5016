"""Windows for training: cut where they say, labelled by the delay equation and by where they lie, split without leakage."""

import json
from collections import Counter

import numpy as np
import pytest

from testbed.analysis.multipliers.run_labels import chatter
from testbed.exports.windows import Windowing, resampled, windows_of
from testbed.recording import Recording
from testbed.store.data_set import read_data_set
from tests.support.export_files import SCENARIO, run, simulate

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed (extra formats)")
LENGTH, STEP = 400, 150
MACHINES = SCENARIO.replace("idle: 0 rev", "idle: 8 rev").replace("repeats: 2", "repeats: 1").replace(
    "  depth_of_cut: {from: 0.4 mm, to: 3.6 mm, count: 4}",
    "  depth_of_cut: {from: 0.4 mm, to: 3.6 mm, count: 3}\n  natural_frequency: {from: 140 Hz, to: 150 Hz, count: 5}")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """90 runs: five machines, each at the same 18 conditions."""
    return simulate(tmp_path_factory.mktemp("windows"), MACHINES)


@pytest.fixture(scope="module")
def exported(data):
    folder = data.parent / "set"
    assert run("export", data, "-o", folder, "--window", LENGTH, "--step", STEP, "--split-by", "machine", "--quiet") == 0
    return folder


def rows_of(folder, columns=None):
    return [row | {"split": file.name.split("-")[0]} for file in sorted((folder / "data").iterdir())
            for row in pq.read_table(file, columns=columns).to_pylist()]


def test_windows_are_the_samples_of_their_run(data, exported):
    rows = rows_of(exported)
    source = read_data_set(data)
    by_run = {}
    for row in rows:
        by_run.setdefault(row["run"], []).append(row)
    assert len(by_run) == len(source) == 90
    for index, recording in enumerate(source):
        mine = sorted(by_run[int(source.scenario_run[index])], key=lambda row: row["window"])
        values = recording.channels["displacement"].astype(np.float32)
        assert [row["window"] for row in mine] == list(range((len(values) - LENGTH) // STEP + 1))
        for row in mine:
            first = STEP * row["window"]
            assert np.array_equal(np.float32(row["displacement"]), values[first:first + LENGTH])
            assert row["start"] == pytest.approx(recording.time[first], abs=1e-12)
    assert Counter(row["label"] for row in rows)["no_cut"] > 100 and float(np.abs(rows[0]["displacement"]).max()) > 0


def test_a_label_is_the_window_s_own(data, exported):
    source = read_data_set(data)
    passes = {int(source.scenario_run[index]): one.pass_times for index, one in enumerate(source)}
    seen = Counter()
    for row in rows_of(exported):
        entry, leave = passes[row["run"]][8], passes[row["run"]][68]
        inside = [entry <= row["start"] + k / 6400.0 < leave for k in range(LENGTH)]
        seen[row["segment"]] += 1
        if all(inside):
            expected = row["stability"] if chatter(row["stability"], row["behaviour"])["chatter"] is not None else "unknown"
            assert row["segment"] == "cut" and row["label"] == expected
            begun = [time for time in passes[row["run"]][8:68] if time <= row["start"]]
            assert row["passes_in_cut"] == len(begun) - 1
        elif any(inside):
            assert row["segment"] == ("entry" if inside[-1] else "exit") and row["label"] == "unknown"
        else:
            assert row["segment"] == ("idle" if row["start"] < entry else "ring-down") and row["label"] == "no_cut"
            assert row["chatter"] is False and row["passes_in_cut"] is None
        assert (row["chatter"] is None) == (row["label"] == "unknown")
        assert row["chatter"] is not True or row["label"] in ("neimark_sacker", "flip")
    assert all(seen[one] >= 90 for one in ("idle", "entry", "cut", "exit", "ring-down"))


def test_what_is_not_known_is_never_false():
    assert chatter(None, "stable") == chatter("saddle_node", "undecided") == {"label": "unknown", "chatter": None}
    assert chatter("stable", "neimark_sacker") == chatter("flip", "stable") == {"label": "unknown", "chatter": None}
    assert chatter("stable", "undecided") == {"label": "stable", "chatter": False}
    assert chatter("flip", "neimark_sacker") == {"label": "flip", "chatter": True}


def test_late_windows_sound_as_their_label_says(exported):
    """Second road: away from the border the samples alone, one against the next revolution, tell chatter from none."""
    right = []
    for row in rows_of(exported):
        if row["segment"] != "cut" or row["chatter"] is None or row["passes_in_cut"] < 40 \
                or abs(row["largest_multiplier_modulus"] - 1) < 0.08:
            continue
        values, turn = np.array(row["displacement"], float), 2 * np.pi / row["spindle_speed"] * 6400.0
        at = np.arange(LENGTH - int(turn) - 2)
        change = np.interp(at + turn, np.arange(LENGTH), values) - values[at]
        right.append((np.sqrt(np.mean(change**2)) > 0.12 * values.std() + 1e-6) == row["chatter"])  # 1 um: two of the noise
    assert len(right) > 200 and np.mean(right) > 0.97


def test_a_split_holds_whole_machines_or_whole_conditions(data, exported, tmp_path):
    columns = ["run", "group", "machine_id", "condition_id", "true_natural_frequency", "spindle_speed"]
    rows = rows_of(exported, columns)
    machines, conditions = {}, {}
    for row in rows:
        assert row["group"] == row["machine_id"]
        machines.setdefault(row["true_natural_frequency"], set()).add((row["split"], row["machine_id"]))
        conditions.setdefault(row["condition_id"], set()).add(row["split"])
    assert len(machines) == 5 and all(len(places) == 1 for places in machines.values())
    assert len({split for places in machines.values() for split, _ in places}) > 1
    assert len(conditions) == 18 and all(len(places) > 1 for places in conditions.values())
    assert run("export", data, "-o", tmp_path / "set", "--window", LENGTH, "--quiet") == 0
    places = {}
    for row in rows_of(tmp_path / "set", columns):
        assert row["group"] == row["condition_id"]
        places.setdefault(row["group"], set()).add(row["split"])
    assert len(places) == 18 and all(len(found) == 1 for found in places.values())


def test_phases_of_a_record_make_no_new_machine(tmp_path):
    text = MACHINES.replace("sensors:", "random:\n  ambient_vibration: {amplitude: 1 um, frequency: 50 Hz, phase: "
                            "{uniform: [0 deg, 360 deg]}}\nsensors:")
    text = text.replace("count: 6", "count: 2").replace("idle: 8 rev, cutting: 60 rev", "idle: 2 rev, cutting: 12 rev")
    data = simulate(tmp_path, text)
    assert len(set(read_data_set(data).truth["ambient_vibration.phase"])) == 30
    assert run("export", data, "-o", tmp_path / "set", "--window", 64, "--split-by", "machine", "--quiet") == 0
    assert len({row["machine_id"] for row in rows_of(tmp_path / "set", ["machine_id"])}) == 5


def test_the_card_counts_what_is_there(exported, capsys):
    content, text = json.loads((exported / "export.json").read_text()), (exported / "README.md").read_text()
    rows = rows_of(exported, ["label", "run"])
    for split, counts in content["labels"].items():
        assert counts == Counter(row["label"] for row in rows if row["split"] == split)
        assert content["splits"][split]["rows"] == sum(counts.values())
        assert f"{sum(counts.values())} in {split}" in text
    assert content["about"]["window"] == {"length": LENGTH, "step": STEP} and "`passes_in_cut`" in text
    assert "in windows of 400 samples" in (exported / "DATASHEET.md").read_text()
    assert run("inspect", exported) == 0
    said = capsys.readouterr().out
    assert f"{len(rows)} windows of 90 runs" in said and "no_cut" in said and "machines" in said
    for one in content["baseline"]["classifier"]:
        assert set(one["confusion"]) <= {"chatter", "no chatter"}
        if one["split"] == "train":
            assert one["recall"] > 0.8 > one["naive_recall"]


def test_at_a_lower_rate_what_is_below_half_of_it_stays_and_the_rest_goes():
    time = np.arange(6400) / 6400.0
    channels = {"displacement": np.sin(2 * np.pi * 90 * time + 0.3), "velocity": np.sin(2 * np.pi * 1700 * time)}
    found = resampled(Recording(channels, 6400.0, {"displacement": "m", "velocity": "m/s"}, "synthetic", 0.25), 1600.0)
    assert len(found) == 1600 and found.sampling_rate == 1600.0 and found.start == 0.25
    middle = slice(50, -50)  # the filter has no samples beyond the ends
    expected = np.sin(2 * np.pi * 90 * (found.time - 0.25) + 0.3)
    assert found.channels["displacement"][middle] == pytest.approx(expected[middle], abs=2e-3)
    assert np.abs(found.channels["velocity"][middle]).max() < 2e-3
    with pytest.raises(ValueError, match="not brought"):
        resampled(found, 3200.0)


def test_the_rate_asked_for_is_that_of_the_rows(data, tmp_path):
    assert run("export", data, "-o", tmp_path / "set", "--window", 128, "--rate", "2 kHz", "--quiet") == 0
    rows = rows_of(tmp_path / "set", ["sampling_rate", "start", "window", "displacement", "segment"])
    assert {row["sampling_rate"] for row in rows} == {2000.0} and {len(row["displacement"]) for row in rows} == {128}
    late = max(rows, key=lambda row: row["window"])
    assert late["start"] == pytest.approx(late["window"] * 128 / 2000.0) and late["segment"] == "ring-down"
    about = json.loads((tmp_path / "set" / "export.json").read_text())["about"]
    assert about["sampling_rate"] == 2000.0 and about["recorded_at"] == 6400.0
    assert "low-passed from 6400 Hz" in (tmp_path / "set" / "DATASHEET.md").read_text()


def test_broken_samples_are_in_no_window_and_a_broken_run_keeps_its_place():
    values = np.zeros(1000)
    values[430] = np.nan
    recording = Recording({"displacement": values}, 1000.0, {"displacement": "m"}, "synthetic",
                          pass_times=np.arange(0.0, 0.43, 0.1), conditions={"idle_passes": 2, "passes": 6})
    found = list(windows_of(recording, Windowing(100, 100)))
    assert [one["window"] for one in found] == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    assert [one["segment"] for one in found[:4]] == ["idle", "idle", "cut", "cut"]
    never = Recording({"displacement": np.zeros(300)}, 1000.0, {"displacement": "m"}, "synthetic",
                      pass_times=np.array([0.0, 0.1]), conditions={"idle_passes": 2, "passes": 6})
    assert {one["segment"] for one in windows_of(never, Windowing(100, 50))} == {"idle"}


@pytest.mark.parametrize(("arguments", "said"), [
    (["--step", 10], "--step goes with --window"), (["--window", 10_000_000], "samples, too few for a window of 10000000"),
    (["--window", 3], "--window"), (["--rate", "12.8 kHz"], "give a lower --rate"), (["--rate", "6399.9 Hz"], "whole numbers"),
    (["--rate", "10"], "unit"), (["--rate", "0 Hz"], "above 0"), (["--split-by", "tool"], "condition")])
def test_bad_orders_are_refused_in_one_line(data, tmp_path, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    assert run("export", data, "-o", "new", *arguments) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ") and err.count("\n") == 1 and said in err and list(tmp_path.iterdir()) == []


def test_one_machine_cannot_be_held_out(tmp_path, capsys):
    text = SCENARIO.replace("repeats: 2", "repeats: 1").replace("cutting: 60 rev", "cutting: 10 rev")
    data = simulate(tmp_path, text)
    assert run("export", data, "-o", tmp_path / "set", "--split-by", "machine") == 2
    assert "all its runs are of one machine" in capsys.readouterr().err and not (tmp_path / "set").exists()
