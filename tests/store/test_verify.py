"""verify: every flipped bit, every missing, moved, doubled or cut shard is noticed and told."""

import contextlib
import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from testbed.cli import main
from testbed.problem import InputProblem
from testbed.store.data_set import is_data_set, read_data_set
from testbed.store.seal import seal, sealed_size, state
from testbed.store.verification import verify
from testbed.sweeps import sweep
from testbed.sweeps.shards import find, shard_path
from tests.support import plain_engine, sweep_kills


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A data set of 24 runs as a file and as a folder of shards."""
    place = tmp_path_factory.mktemp("made")
    scenario = sweep_kills.scenario(24)
    sweep.run(scenario, plain_engine.simulate, place / "a.h5")
    sweep.run(scenario, plain_engine.simulate, place / "folder", keep_shards=True)
    return place


@pytest.fixture
def file(made, tmp_path):
    return shutil.copy(made / "a.h5", tmp_path / "a.h5")


@pytest.fixture
def folder(made, tmp_path):
    return shutil.copytree(made / "folder", tmp_path / "folder")


def flipped(path, byte, bit):
    raw = bytearray(path.read_bytes())
    raw[byte] ^= 1 << bit
    path.write_bytes(raw)


def test_what_is_whole_is_called_whole(made):
    for path in (made / "a.h5", made / "folder"):
        found = verify(path)
        assert (found.damage, found.notes, found.runs) == ([], [], 24)
        assert found.content_hash == read_data_set(made / "a.h5").content_hash


def test_every_one_of_many_flipped_bits_is_noticed(file):
    rng = np.random.default_rng(4)
    whole = file.read_bytes()
    places = [*rng.integers(len(whole), size=40), 0, len(whole) - 1, sealed_size(file), len(whole) - 20]
    for place in places:
        flipped(file, int(place), int(rng.integers(8)))
        with contextlib.suppress(InputProblem):
            assert verify(file).damage, f"byte {place}"
        file.write_bytes(whole)
    assert not verify(file).damage


def test_every_flipped_bit_of_a_folder_is_noticed(folder):
    rng = np.random.default_rng(5)
    for path in sorted(folder.iterdir()):
        whole = path.read_bytes()
        for place in rng.integers(len(whole), size=6):
            flipped(path, int(place), int(rng.integers(8)))
            assert any(path.name in line for line in verify(folder).damage), f"{path.name} byte {place}"
            path.write_bytes(whole)
    assert not verify(folder).damage


def test_the_touched_runs_are_named(file):
    with h5py.File(file, "r+") as data:
        samples = data["displacement"]
        samples[7, 3] += 1  # through HDF5's own filters: only the hashes can tell
    seal(file)
    found = verify(file)
    assert state(file) == "whole" and found.damaged_runs == [7]
    assert any("runs touched: 7" in line for line in found.damage)


@pytest.mark.parametrize("left", [0.0, 0.3, 0.9, -1, -60])
def test_a_file_cut_short_is_noticed(file, left):
    size = file.stat().st_size
    os.truncate(file, int(size * left) if left >= 0 else size + left)
    with pytest.raises(InputProblem):
        read_data_set(file)
    try:
        assert verify(file).damage
    except InputProblem as problem:
        assert "cut short" in str(problem)


def missing(folder):
    shards = find(folder)
    shards[1][2].unlink()
    return f"runs {shards[1][0]} to {shards[1][1] - 1} are missing"


def moved(folder):
    shards = find(folder)
    os.replace(shards[0][2], folder / "spare")
    os.replace(shards[1][2], shards[0][2])
    os.replace(folder / "spare", shards[1][2])
    return "is not where it belongs"


def doubled(folder):
    first, last, path = find(folder)[1]
    shutil.copy(path, shard_path(folder, first, last + 1))
    return "is not where it belongs"


def cut(folder):
    path = find(folder)[2][2]
    os.truncate(path, path.stat().st_size // 2)
    return "cut short"


def foreign(folder):
    other = folder.parent / "other"
    sweep.run(sweep_kills.scenario(24).with_seed(9), plain_engine.simulate, other, keep_shards=True)
    path = find(folder)[2][2]
    shutil.copy(other / path.name, path)
    return "another scenario"


def stranger(folder):
    (folder / "notes.txt").write_text("mine")
    return "notes.txt does not belong here"


@pytest.mark.parametrize("harm", [missing, moved, doubled, cut, foreign, stranger])
def test_what_happened_to_a_shard_is_told(folder, harm):
    said = harm(folder)
    assert any(said in line for line in verify(folder).damage), verify(folder).damage


def test_a_folder_reads_as_the_file_does(made):
    one, other = read_data_set(made / "a.h5"), read_data_set(made / "folder")
    assert is_data_set(made / "folder") and len(find(made / "folder")) > 1
    assert one.content_hash == other.content_hash and one.channels == other.channels
    for before, after in zip(one, other, strict=True):
        assert np.array_equal(before.channels["displacement"], after.channels["displacement"])
        assert dict(before.conditions) == dict(after.conditions)
    assert np.array_equal(one.recording(17).channels["displacement"], other.recording(17).channels["displacement"])


def test_a_folder_without_a_shard_is_not_read(folder):
    find(folder)[0][2].unlink()
    with pytest.raises(InputProblem, match="missing"):
        read_data_set(folder)


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    return stop.value.code, *capsys.readouterr()


def test_the_command(file, capsys):
    code, out, err = run(capsys, "verify", file)
    assert code == 0 and "intact, 24 runs" in out and not err
    code, out, err = run(capsys, "verify", file, "--quick", "--json", "-")
    assert code == 0 and json.loads(out)["intact"] is True
    flipped(file, file.stat().st_size // 2, 3)
    code, out, err = run(capsys, "verify", file)
    assert code == 2 and err.startswith(f"error: {file}: ") and err.count("\n") == 1 and "not those" in err
    code, out, _ = run(capsys, "verify", file, "--json", "-")
    assert code == 2 and json.loads(out)["intact"] is False
    code, _, err = run(capsys, "verify", file.parent / "none.h5")
    assert code == 2 and "no such file" in err
    code, _, err = run(capsys, "verify", file.parent)
    assert code == 2 and "no folder of a sweep" in err


def test_the_index_of_a_folder_stands_for_the_folder(folder):
    assert not verify(folder / "index.h5").damage
    sorted(folder.glob("runs-*.h5"))[0].unlink()
    assert "missing" in " ".join(verify(folder / "index.h5").damage)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no device that is always full")
def test_a_full_disk_is_told_in_one_line(file):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-c", "from testbed.cli import main; main()", "verify", str(file)],
                              stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "No space left" in done.stderr


def test_an_answer_that_cannot_be_written_is_told_in_one_line(file, tmp_path, capsys, monkeypatch):
    def full(self, *arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_text", full)
    code, _, err = run(capsys, "verify", file, "--json", tmp_path / "x.json")
    assert code == 2 and err.startswith(f"error: {tmp_path / 'x.json'}: ") and err.count("\n") == 1
    assert "No space left" in err and not list(tmp_path.glob("*x.json*"))


def test_a_file_that_another_program_changed_is_noticed(file):
    with h5py.File(file, "r+") as data:
        data["spindle_speed"][0] += 1e-9
    assert any("content" in line for line in verify(file).damage)
