"""A training set holds every run once, keeps whole conditions apart, labels them truly, and appears whole or not at all."""

import errno
import json
from collections import Counter
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
from ruamel.yaml import YAML

from testbed.analysis.multipliers.run_labels import contact_loss_time
from testbed.cut import Cut, whole_cut_sampling
from testbed.engines.fast import simulate as engine
from testbed.exports import shards
from testbed.exports.groups import condition_group, groups_of, split_of
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.store.data_set import read_data_set
from tests.support.export_files import SCENARIO, export, run, simulate

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed (extra formats)")
RIG = Model(Structure(2.573, 146.5976, 0.0032), Cutter(), Cutting("up-milling", 0.162, 5.55768e8, 1.667304e8))


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    return export(tmp_path_factory.mktemp("export"))


def rows_of(folder):
    return [row for file in sorted((folder / "data").iterdir()) for row in pq.read_table(file).to_pylist()]


def test_every_run_stands_in_it_once_as_recorded(exported):
    data, folder = exported
    source = read_data_set(data)
    rows = {row["run"]: row for row in rows_of(folder)}
    assert sorted(rows) == list(range(48)) and sum(len(row["displacement"]) for row in rows.values()) > 48 * 4000
    for index, recording in enumerate(source):
        row = rows[int(source.scenario_run[index])]
        assert np.array_equal(np.float32(row["displacement"]), recording.channels["displacement"].astype(np.float32))
        assert np.array_equal(row["marks"], recording.marks) and np.array_equal(row["pass_times"], recording.pass_times)
        assert all(row[name] == values[index] for name, values in source.conditions.items())
        assert row["true_damping_ratio"] == 0.0032 and row["outcome"] == "ok" and row["outcome_time"] is None


def test_the_files_tell_units_and_sampling_rate(exported):
    file = next((exported[1] / "data").glob("train-*"))
    schema = pq.read_schema(file)
    assert str(schema.field("displacement").type).startswith("list<") and "float" in str(schema.field("displacement").type)
    assert schema.field("displacement").metadata[b"unit"] == b"m"
    assert schema.field("true_tangential_coefficient").metadata == {b"unit": b"N/m^2", b"role": b"truth",
                                                                    b"meaning": b"true tangential coefficient"}
    about = json.loads(schema.metadata[b"machining_testbed"])
    assert about["sampling_rate"] == 6400 and about["origin"] == "synthetic"
    assert about["source_content_hash"] == read_data_set(exported[0]).content_hash


def test_no_condition_lies_in_two_splits(exported):
    places = {}
    for file in (exported[1] / "data").iterdir():
        for row in pq.read_table(file, columns=["group", "spindle_speed", "axial_depth_of_cut"]).to_pylist():
            places.setdefault((row["spindle_speed"], row["axial_depth_of_cut"]), set()).add((file.name[:4], row["group"]))
    assert len(places) == 24 and all(len(found) == 1 for found in places.values())
    assert len({group for found in places.values() for _, group in found}) == 24


def test_splits_stay_when_runs_are_added(exported, tmp_path):
    more = simulate(tmp_path, SCENARIO.replace("count: 4", "count: 7").replace("repeats: 2", "repeats: 1"), "more")
    assert run("export", more, "-o", tmp_path / "set", "--quiet") == 0

    def divided(folder):
        return {row["group"]: file.name.split("-")[0] for file in (folder / "data").iterdir()
                for row in pq.read_table(file, columns=["group"]).to_pylist()}

    few, many = divided(exported[1]), divided(tmp_path / "set")
    assert len(many) == 42 and few == {group: many[group] for group in few}
    assert set(few.values()) == {"train", "validation", "test"}


def test_shares_are_kept_and_another_seed_divides_anew():
    random = np.random.default_rng(1)
    conditions = {name: random.uniform(low, high, 6000) for name, low, high in (
        ("spindle_speed", 250, 450), ("axial_depth_of_cut", 1e-4, 4e-3), ("feed_per_tooth", 5e-5, 2e-4))}
    groups = groups_of(conditions, 1)
    counts = Counter(split_of(group, (80, 10, 10)) for group in groups)
    assert len(set(groups)) == 6000
    assert counts["train"] == pytest.approx(4800, abs=100) and counts["test"] == pytest.approx(600, abs=80)
    again = [split_of(group, (80, 10, 10), seed=1) for group in groups]
    assert sum(one != split_of(group, (80, 10, 10)) for one, group in zip(again, groups, strict=True)) > 1500
    first = {name: values[0] for name, values in conditions.items()}
    rounded = {name: value * (1 + 1e-12) for name, value in first.items()}
    assert condition_group(first, 1) == condition_group(rounded, 1) != condition_group(first, 2)


def test_labels_agree_with_the_linear_machine_and_with_the_samples(exported):
    rows = rows_of(exported[1])
    assert Counter(row["stability"] for row in rows)["stable"] > 12
    assert {row["stability"] for row in rows} == {"stable", "neimark_sacker", "flip"}
    for row in rows:
        assert (row["stability"] == "stable") == (row["largest_multiplier_modulus"] < 1)
        assert row["effects"] == ["contact_loss"]
        clear = abs(row["largest_multiplier_modulus"] - 1) > 0.08 and row["behaviour"] != "undecided"
        assert not clear or (row["behaviour"] == "stable") == (row["stability"] == "stable")
    same = sum(row["behaviour"] == row["stability"] for row in rows)  # large motion may lock to another rhythm
    assert same > 0.65 * len(rows) and sum(row["behaviour"] == "undecided" for row in rows) < 0.3 * len(rows)


@pytest.mark.parametrize("flutes", [1, 2])
def test_contact_loss_is_told_from_the_motion(flutes):
    """Second road: the effect `contact_loss` changes a simulation exactly where a tooth leaves the work."""
    lost = []
    rig = replace(RIG, cutter=Cutter(flutes))
    for speed in np.linspace(2600, 4400, 5):
        for depth in (0.5e-3, 1.7e-3, 2.6e-3, 3.4e-3):
            cut = Cut(speed * np.pi / 30, depth / flutes, 1.016e-4, 0, 60, 5)
            sampling = whole_cut_sampling(cut, flutes, 12800.0)
            linear, real = (engine(model, cut, sampling) for model in (rig, rig.with_effect("contact_loss")))
            gap = np.abs(linear.channels["displacement"] - real.channels["displacement"])
            apart = np.nonzero(gap > 1e-9)[0]
            known = {"idle_passes": 0, "passes": 60, "feed_per_tooth": 1.016e-4}
            found = contact_loss_time(replace(real, conditions=known), 0.162, 0.0, flutes)
            lost.append(not np.isnan(found))
            assert lost[-1] == bool(apart.size), (speed, depth)
            if apart.size:
                assert found == pytest.approx(real.time[apart[0]], abs=cut.tooth_passing_period(flutes) * 1.1)
    assert 2 < sum(lost) < len(lost) - 2


def test_the_card_has_a_head_that_loaders_read_and_scores_that_are_true(exported):
    text = (exported[1] / "README.md").read_text()
    head = YAML(typ="safe").load(text.split("---\n")[1])
    files = {one["split"]: list(exported[1].glob(one["path"])) for one in head["configs"][0]["data_files"]}
    assert set(files) == {"train", "validation", "test"} and all(files.values()) and head["license"] == "cc-by-4.0"
    told = {split: [row["stability"] for row in pq.read_table(paths[0]).to_pylist()] for split, paths in files.items()}
    common = Counter(told["train"]).most_common(1)[0][0]
    content = json.loads((exported[1] / "export.json").read_text())
    one = next(one for one in content["baseline"]["classifier"] if one["split"] == "test")
    assert one["naive_accuracy"] == pytest.approx(told["test"].count(common) / len(told["test"]))
    assert one["accuracy"] > one["naive_accuracy"] and one["rows"] == len(told["test"])
    assert f"| test | {one['groups']} | {one['rows']} | {one['accuracy']:.3f} | {one['naive_accuracy']:.3f} |" in text
    sheet = (exported[1] / "DATASHEET.md").read_text()
    assert "What it must not be used for" in sheet and "CC-BY-4.0" in sheet and "spindle_speed: {from: 2600 rpm" in sheet


def test_croissant_names_files_that_are_there_and_columns_that_exist(exported):
    found = json.loads((exported[1] / "croissant.json").read_text())
    assert found["conformsTo"] == "http://mlcommons.org/croissant/1.0" and found["@type"] == "sc:Dataset"
    objects = [one for one in found["distribution"] if one["@type"] == "cr:FileObject"]
    assert len(objects) == 3
    for one in objects:
        assert sha256((exported[1] / one["contentUrl"]).read_bytes()).hexdigest() == one["sha256"]
    sets = {one["@id"]: one["includes"] for one in found["distribution"] if one["@type"] == "cr:FileSet"}
    kinds = {"sc:Float": ("double", "float"), "sc:Integer": ("int64",), "sc:Text": ("string",), "sc:Boolean": ("bool",)}
    for record in found["recordSet"]:
        for field in record["field"]:
            file = next(exported[1].glob(sets[field["source"]["fileSet"]["@id"]]))
            kind = pq.read_schema(file).field(field["source"]["extract"]["column"]).type
            assert str(kind).startswith("list<") == field.get("repeated", False)
            assert str(getattr(kind, "value_type", kind)) in kinds[field["dataType"]]
        assert len(record["field"]) == len(pq.read_schema(file).names)


def test_the_same_export_twice_is_the_same_bytes(exported, tmp_path):
    assert run("export", exported[0], "-o", tmp_path / "again", "--quiet") == 0
    names = sorted(path.relative_to(exported[1]) for path in exported[1].rglob("*") if path.is_file())
    assert len(names) == 7
    for name in names:
        assert (exported[1] / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_many_files_hold_the_runs_in_order(exported, tmp_path, monkeypatch):
    monkeypatch.setattr(shards, "ROW_GROUP_BYTES", 200_000)
    monkeypatch.setattr(shards, "SHARD_BYTES", 500_000)
    assert run("export", exported[0], "-o", tmp_path / "set", "--quiet") == 0
    names = sorted(path.name for path in (tmp_path / "set" / "data").glob("train-*"))
    assert len(names) > 2 and names[-1] == f"train-{len(names) - 1:05d}-of-{len(names):05d}.parquet"
    runs = [row["run"] for row in rows_of(tmp_path / "set") if row["run"] is not None]
    assert sorted(runs) == list(range(48)) and run("inspect", tmp_path / "set", "--quiet") == 0


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_nothing_half_written_is_left(exported, tmp_path, monkeypatch, capsys, error):
    calls = []

    def breaks(self):
        calls.append(self)
        if len(calls) == 2:
            raise error
        whole(self)

    whole = shards.ShardWriter._flush
    monkeypatch.setattr(shards.ShardWriter, "_flush", breaks)
    code = run("export", exported[0], "-o", tmp_path / "set", "--quiet")
    assert code == (2 if isinstance(error, OSError) else 130) and len(calls) == 2
    assert list(tmp_path.iterdir()) == []
    assert isinstance(error, KeyboardInterrupt) or "No space left" in capsys.readouterr().err


@pytest.mark.parametrize(("arguments", "said"), [
    (["{set}"], "exists already"), (["none/set"], "cannot be made"), (["new", "--split", "1,2"], "three numbers"),
    (["new", "--split", "0,1,1"], "first above 0"), (["new", "--licence", "none"], "licence")])
def test_bad_orders_are_refused_in_one_line(exported, tmp_path, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    assert run("export", exported[0], "-o", *(each.format(set=exported[1]) for each in arguments)) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ") and err.count("\n") == 1 and said in err and list(tmp_path.iterdir()) == []


def test_inspect_says_what_it_is_and_notices_damage(exported, tmp_path, capsys):
    assert run("inspect", exported[1]) == 0
    said = capsys.readouterr().out
    assert "48 runs" in said and "displacement [m]" in said and "licence: CC-BY-4.0" in said
    shard = next((exported[1] / "data").glob("test-*"))
    assert run("inspect", shard, "--json", "-") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["kind"] == "exported_shard" and found["split"] == "test" and found["about"]["sampling_rate"] == 6400
    assert run("export", exported[0], "-o", tmp_path / "set", "--quiet") == 0
    manifest = tmp_path / "set" / "export.json"
    text = manifest.read_text()
    manifest.write_text(text.replace('"seed": 5', '"seed": 6', 1))
    assert manifest.read_text() != text
    assert run("inspect", tmp_path / "set") == 2 and "export.json: was changed" in capsys.readouterr().err
    manifest.write_text(text)
    damaged = next((tmp_path / "set" / "data").glob("train-*"))
    whole = bytearray(damaged.read_bytes())
    whole[len(whole) // 2] ^= 4
    damaged.write_bytes(whole)
    assert run("inspect", tmp_path / "set") == 2 and "is damaged" in capsys.readouterr().err
    damaged.unlink()
    assert run("inspect", tmp_path / "set") == 2 and "is missing" in capsys.readouterr().err


def test_an_accelerometer_alone_tells_what_the_cut_did_and_contact_stays_unknown(tmp_path, capsys):
    text = SCENARIO.replace("repeats: 2", "repeats: 1").replace("displacement: {noise: 0.5 um, bits: 16, range: 5 mm}",
                                                               "acceleration: {noise: 0.05 m/s^2}")  # fmt: skip
    data = simulate(tmp_path, text, "heard")
    assert run("export", data, "-o", tmp_path / "set", "--json", tmp_path / "said.json") == 0
    rows, said = rows_of(tmp_path / "set"), json.loads((tmp_path / "said.json").read_text())
    told = [row for row in rows if row["behaviour"] != "undecided"]
    assert len(told) >= 20 and len(rows) == 24 and {row["behaviour"] for row in told} >= {"stable", "neimark_sacker"}
    assert all((row["behaviour"] == "stable") == (row["stability"] == "stable") for row in told)
    assert {row["contact_loss"] for row in rows} == {None}
    assert sum(said["contact_unknown"].values()) == len(rows) and sum(said["contact_losses"].values()) == 0
    assert sum(sum(counts.values()) for counts in said["behaviours"].values()) == len(rows)
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("train"))
    assert line.split()[-2:] == ["-", str(said["splits"]["train"]["runs"])]
    assert "contact loss not known" in (tmp_path / "set" / "README.md").read_text()
