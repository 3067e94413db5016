"""Sweeps: the same values whoever computes them, nothing lost by an interruption, a failure told by name."""

import errno
import json
import os
import signal
import sys
from dataclasses import replace

import numpy as np
import pytest

from testbed.files.yaml_text import parse
from testbed.problem import InputProblem
from testbed.scenario.scenario_file import scenario_from
from testbed.store.data_set import read_data_set
from testbed.sweeps import sweep
from testbed.sweeps.shards import find, shard_path
from tests.support import plain_engine

TEXT = """name: trial
seed: 5
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 1, diameter: 19.05 mm}
  cutting: {immersion: 0.1, tangential_coefficient: 550 N/mm^2, normal_coefficient: 200 N/mm^2}
cut: {cutting: 5 rev, spread: {displacement: 5 um}}
sweep:
  spindle_speed: {from: 3000 rpm, to: 6000 rpm, count: 4}
  depth_of_cut: {from: 1 mm, to: 3.4 mm, count: 5}
sensors:
  sampling_rate: 2 kHz
  displacement: {noise: 1 um, bits: 16, range: 1 mm}
"""


@pytest.fixture
def scenario():
    return scenario_from(parse(TEXT, "s.yaml"))


@pytest.fixture
def struck_by_interruptions():
    """Ctrl-C as at a terminal: a program started in a shell's background finds it ignored, and so do its children."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def samples(path):
    return [recording.channels["displacement"] for recording in read_data_set(path)]


def test_a_sweep_holds_every_run_once_in_order(scenario, tmp_path):
    seen = []
    report = sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5",
                       progress=lambda done, total: seen.append((done, total)))
    data = read_data_set(report.output)
    assert (report.runs, report.computed, report.outcomes) == (20, 20, {"ok": 20})
    assert data.scenario_run.tolist() == list(range(20)) and data.verify()
    assert [data.conditions["axial_depth_of_cut"][k] for k in range(3)] == pytest.approx([1e-3, 1.6e-3, 2.2e-3])
    assert seen[0] == (0, 20) and seen[-1] == (20, 20) and seen == sorted(seen)
    assert len({tuple(values) for values in samples(report.output)}) == 20
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


def test_the_workers_change_nothing(scenario, tmp_path):
    hashes = {sweep.run(scenario, plain_engine.simulate, tmp_path / f"{workers}{processes}.h5", workers=workers,
                        processes=processes).content_hash
              for workers, processes in ((1, False), (2, False), (5, False), (2, True))}
    assert len(hashes) == 1
    assert sweep.run(replace(scenario, seed=6), plain_engine.simulate, tmp_path / "b.h5").content_hash not in hashes


@pytest.mark.parametrize("workers", [1, 2])
def test_an_interrupted_sweep_is_continued_where_it_stopped(scenario, tmp_path, workers):
    whole = sweep.run(scenario, plain_engine.simulate, tmp_path / "whole.h5")
    with pytest.raises(sweep.Interrupted) as stop:
        sweep.run(scenario, plain_engine.StopsAfter(12), tmp_path / "a.h5", workers=workers)
    assert 0 < stop.value.done < 20 and not (tmp_path / "a.h5").exists()
    kept = stop.value.done
    report = sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5", workers=3, resume=True)
    assert report.computed == 20 - kept and report.content_hash == whole.content_hash
    assert not (tmp_path / "a.h5.parts").exists()


def test_an_interruption_that_the_interpreter_drops_is_neither_lost_nor_printed(
        scenario, tmp_path, struck_by_interruptions, monkeypatch):
    class Finalised:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)  # as if Ctrl-C struck here: what is raised can be handed to nobody

    begun, told = [], []
    monkeypatch.setattr(sys, "unraisablehook", told.append)

    def simulate(*arguments, **options):
        begun.append(1)
        if len(begun) == 7:
            Finalised()
        return plain_engine.simulate(*arguments, **options)

    with pytest.raises(sweep.Interrupted) as stop:
        sweep.run(scenario, simulate, tmp_path / "a.h5")
    assert 7 <= stop.value.done < 20
    assert told == [] and sys.unraisablehook == told.append
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_shards_that_are_there_are_not_computed_again(scenario, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep, "consolidate", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(sweep.Interrupted) as stop:
        sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5")
    monkeypatch.undo()
    assert stop.value.done == 20
    assert sweep.run(scenario, plain_engine.unwanted, tmp_path / "a.h5", resume=True).computed == 0


def test_a_damaged_shard_is_computed_again(scenario, tmp_path):
    with pytest.raises(sweep.Interrupted):
        sweep.run(scenario, plain_engine.StopsAfter(12), tmp_path / "a.h5")
    shard = sorted((tmp_path / "a.h5.parts").glob("runs-*.h5"))[0]
    shard.write_bytes(shard.read_bytes()[:500])
    (tmp_path / "a.h5.parts" / ".runs-00000000-00000005.h5.xyz.part").write_bytes(b"half")
    report = sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5", resume=True)
    assert report.content_hash == sweep.run(scenario, plain_engine.simulate, tmp_path / "b.h5").content_hash


def test_resuming_a_finished_sweep_computes_nothing(scenario, tmp_path):
    first = sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5")
    again = sweep.run(scenario, plain_engine.unwanted, tmp_path / "a.h5", resume=True)
    assert (again.computed, again.runs, again.content_hash) == (0, 20, first.content_hash)


def test_what_exists_is_never_overwritten(scenario, tmp_path):
    sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5")
    before = (tmp_path / "a.h5").read_bytes()
    (tmp_path / "text.h5").write_text("mine")
    other = replace(scenario, seed=9)
    for name, given, resume in (("a.h5", scenario, False), ("a.h5", other, True), ("text.h5", scenario, True)):
        with pytest.raises(InputProblem):
            sweep.run(given, plain_engine.simulate, tmp_path / name, resume=resume)
    assert (tmp_path / "a.h5").read_bytes() == before and (tmp_path / "text.h5").read_text() == "mine"


def test_an_unfinished_sweep_of_another_scenario_is_not_continued(scenario, tmp_path):
    with pytest.raises(sweep.Interrupted):
        sweep.run(scenario, plain_engine.StopsAfter(12), tmp_path / "a.h5")
    with pytest.raises(InputProblem, match="--resume"):
        sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5")
    with pytest.raises(InputProblem, match="another scenario"):
        sweep.run(replace(scenario, seed=9), plain_engine.simulate, tmp_path / "a.h5", resume=True)
    (tmp_path / "a.h5.parts" / "sweep.json").write_text(json.dumps({"fingerprint": 3}))
    with pytest.raises(InputProblem, match="another scenario"):  # the shards tell what a damaged note does not
        sweep.run(replace(scenario, seed=9), plain_engine.unwanted, tmp_path / "a.h5", resume=True)
    assert sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5", resume=True).computed == 20 - 10


def test_a_run_that_cannot_be_computed_is_a_row(scenario, tmp_path):
    report = sweep.run(scenario, plain_engine.overflowing, tmp_path / "a.h5")
    assert report.outcomes == {"diverged": 12, "ok": 8}
    data = read_data_set(report.output)
    assert (data.outcome == "diverged").tolist() == (data.conditions["axial_depth_of_cut"] > 2e-3).tolist()


def test_a_run_that_kills_its_process_is_found_and_told_by_name(scenario, tmp_path):
    short = replace(scenario, tests=scenario.tests[:4])
    report = sweep.run(short, plain_engine.deadly, tmp_path / "a.h5", workers=2, processes=True)
    assert report.outcomes == {"crashed": 1, "ok": 3}
    plain = sweep.run(short, plain_engine.simulate, tmp_path / "b.h5")
    for index, (found, wanted) in enumerate(zip(samples(report.output), samples(plain.output), strict=True)):
        assert (len(found) == 1) if index == 2 else np.array_equal(found, wanted)


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="limits the size of files as a Unix system can")
def test_a_full_disk_is_told_in_a_line_and_the_sweep_is_continued(scenario, tmp_path, workers):
    import resource

    whole = sweep.run(scenario, plain_engine.simulate, tmp_path / "whole.h5")
    smallest = 20_000
    for limit, there in ((smallest, 0), (whole.output.stat().st_size - 1_000, 20)):  # in a shard, in the last step
        unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, unlimited[1]))
        try:
            with pytest.raises(InputProblem, match="--resume") as problem:
                sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5", workers=workers, resume=True)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
        assert "\n" not in str(problem.value) and "File too large" in str(problem.value)
        assert not (tmp_path / "a.h5").exists() and not list(tmp_path.glob(".*.part"))
        kept = sum(last - first for first, last, _ in find(tmp_path / "a.h5.parts"))
        assert kept == there
    report = sweep.run(scenario, plain_engine.unwanted, tmp_path / "a.h5", resume=True)
    assert report.content_hash == whole.content_hash and report.computed == 0


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EDQUOT])
def test_a_place_that_stops_taking_files_is_told_and_the_sweep_is_continued(scenario, tmp_path, monkeypatch, number):
    def refuse(path, content, **options):
        if len(find(tmp_path / "a.h5.parts")) == 2:
            raise OSError(number, os.strerror(number))
        written(path, content, **options)

    from testbed.store import store

    written = store.write_sealed
    monkeypatch.setattr(store, "write_sealed", refuse)
    with pytest.raises(InputProblem, match=os.strerror(number)):
        sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5")
    monkeypatch.undo()
    assert len(find(tmp_path / "a.h5.parts")) == 2
    report = sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5", resume=True)
    assert 0 < report.computed < 20 and report.outcomes == {"ok": 20}


def test_shards_misnamed_or_of_another_scenario_are_computed_again(scenario, tmp_path):
    whole = sweep.run(scenario, plain_engine.simulate, tmp_path / "whole.h5")
    with pytest.raises(sweep.Interrupted):
        sweep.run(scenario, plain_engine.StopsAfter(12), tmp_path / "a.h5")
    shards = find(tmp_path / "a.h5.parts")
    os.replace(shards[0][2], shard_path(tmp_path / "a.h5.parts", 15, 20))
    sweep.run(replace(scenario, seed=9), plain_engine.simulate, tmp_path / "other", keep_shards=True)
    (tmp_path / "other" / shards[1][2].name).replace(shards[1][2])
    report = sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5", resume=True)
    assert report.content_hash == whole.content_hash and report.computed > 20 - 12


def test_a_folder_of_shards_has_the_content_of_the_file(scenario, tmp_path):
    one = sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5")
    other = sweep.run(scenario, plain_engine.simulate, tmp_path / "b", keep_shards=True, workers=2, compression="none")
    assert one.content_hash == other.content_hash and (tmp_path / "b").is_dir()
    again = sweep.run(scenario, plain_engine.unwanted, tmp_path / "b", keep_shards=True, resume=True)
    assert again.computed == 0 and sorted(path.name for path in tmp_path.iterdir()) == ["a.h5", "b"]


def test_a_finished_folder_of_shards_that_was_damaged_is_made_whole(scenario, tmp_path):
    whole = sweep.run(scenario, plain_engine.simulate, tmp_path / "b", keep_shards=True)
    shards = find(tmp_path / "b")
    shards[1][2].unlink()
    content = bytearray(shards[2][2].read_bytes())
    content[len(content) // 2] ^= 4
    shards[2][2].write_bytes(content)
    with pytest.raises(InputProblem, match="exists already"):
        sweep.run(scenario, plain_engine.unwanted, tmp_path / "b", keep_shards=True)
    with pytest.raises(InputProblem):
        sweep.run(replace(scenario, seed=9), plain_engine.unwanted, tmp_path / "b", keep_shards=True, resume=True)
    again = sweep.run(scenario, plain_engine.simulate, tmp_path / "b", keep_shards=True, resume=True)
    assert again.computed == sum(last - first for first, last, _ in shards[1:3])
    assert again.content_hash == whole.content_hash and [path.name for path in tmp_path.iterdir()] == ["b"]


def test_a_packing_that_is_not_installed_is_told_before_anything_is_written(scenario, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "hdf5plugin", None)
    with pytest.raises(InputProblem, match="hdf5plugin"):
        sweep.run(scenario, plain_engine.unwanted, tmp_path / "a.h5", compression="zstd")
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written(scenario, tmp_path):
    with pytest.raises(InputProblem):
        sweep.run(scenario, plain_engine.unwanted, tmp_path / "none" / "a.h5")
    assert not list(tmp_path.iterdir())
