"""What contradicts its hashes is refused by every command; equal values have equal hashes whoever made them."""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from testbed.cli import main
from testbed.problem import InputProblem, InputWarning
from testbed.store import provenance, store
from testbed.store.content_hash import row_digest
from testbed.store.data_set import read_data_set
from testbed.store.seal import seal
from testbed.store.verification import verify
from testbed.sweeps import batch, sweep
from testbed.sweeps.shards import find
from tests.support import plain_engine, sweep_kills

OLD = Path(__file__).parents[1] / "old_data" / "format_2.h5"  # written by the program before hashes and provenance were parted
OTHER = {"python": "3.12.1", "machining-testbed": "0.0.9", "numpy": "2.3.0"}
MODEL = """structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
cutter: {flutes: 1, diameter: 19.05 mm}
cutting: {immersion: 0.1, tangential_coefficient: 550 N/mm^2, normal_coefficient: 200 N/mm^2}
"""
COMMANDS = {
    "verify": (), "inspect": (), "identify": ("-m", "model.yaml", "-o", "new.yaml"), "score": ("--repeats", "1"),
    "compare": ("-m", "model.yaml", "-o", "new"), "diagnose": ("-m", "model.yaml", "-o", "new"), "export": ("-o", "new"),
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    place = tmp_path_factory.mktemp("made")
    for target, keep in ((place / "a.h5", False), (place / "folder", True)):
        sweep.run(sweep_kills.scenario(6), plain_engine.simulate, target, keep_shards=keep)
    return place


@pytest.fixture
def here(made, tmp_path, monkeypatch):
    """A folder with the data set, its folder of shards and a model, to be edited."""
    shutil.copy(made / "a.h5", tmp_path)
    shutil.copytree(made / "folder", tmp_path / "folder")
    (tmp_path / "model.yaml").write_text(MODEL)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def doubled_damping(file):
    file["truth.damping_ratio"][...] = 2.0 * file["truth.damping_ratio"][()]


def other_sample(file):
    file["displacement"][0, 3] += 1


def other_unit(file):
    file["displacement"].attrs["scale_factor"] *= 2.0


def other_versions(file):
    text = file["provenance"].asstr()[()]
    file["provenance"][()] = text.replace("numpy", "numpi")


def other_seed(file):
    file.attrs["seed"] = 6


EDITS = (doubled_damping, other_sample, other_unit, other_versions, other_seed)


def command(*arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    return stop.value.code


@pytest.mark.parametrize("sealed", [False, True])
@pytest.mark.parametrize("edit", EDITS)
def test_no_command_uses_an_edited_data_set(here, capsys, edit, sealed):
    with h5py.File("a.h5", "r+") as file:
        edit(file)
    if sealed:  # by a program that knows the seal and not the hashes
        seal(Path("a.h5"))
    lines = [("chart", "model.yaml", "--speed", "5000:6000:3", "--depth", "1:2:3", "--data", "a.h5", "-o", "new"),
             ("add", "cubic_stiffness", "-m", "model.yaml", "-c", "a.h5", "-o", "new.yaml"),
             *((name, "a.h5", *more) for name, more in COMMANDS.items())]
    for line in lines:
        code = command(*line)
        err = capsys.readouterr().err
        assert code == 2 and "error: a.h5: " in err and "Traceback" not in err, (line, err)
        assert not Path("new").exists() and not Path("new.yaml").exists() and not list(Path().glob("*.part")), line


def test_an_edited_shard_is_refused_by_the_index(here):
    path = find(here / "folder")[1][2]
    with h5py.File(path, "r+") as file:
        other_sample(file)
        kept = [np.frombuffer(row_digest(row), np.uint8) for row in file["displacement"][()]]
        file["digest_displacement"][...] = kept
        store.write_hashes(file, {})
    seal(path)  # the shard by itself is whole
    read_data_set(path)
    with pytest.raises(InputProblem, match="run 2 is not what was recorded"):
        list(read_data_set(here / "folder"))
    assert any("run 2" in line for line in verify(here / "folder").damage)


def test_an_edited_index_is_refused(here):
    path = here / "folder" / "index.h5"
    with h5py.File(path, "r+") as file:
        doubled_damping(file)
    seal(path)
    for place in (here / "folder", path):
        with pytest.raises(InputProblem, match="was changed"):
            read_data_set(place)
        assert verify(place).damage


def test_a_program_that_wrote_to_it_and_changed_nothing_is_said(here, capsys):
    with h5py.File("a.h5", "r+") as file:
        file["start"][...] = file["start"][()]
    with pytest.warns(InputWarning, match="its seal is gone"):
        assert len(list(read_data_set("a.h5"))) == 6
    assert command("inspect", "a.h5", "--quiet") == 0
    assert capsys.readouterr().err.startswith("warning: a.h5: another program has written to it")


def test_what_is_not_read_is_not_checked_and_what_is_read_is(here):
    with h5py.File("a.h5", "r+") as file:
        file["displacement"][5, 3] += 1
    seal(Path("a.h5"))
    data = read_data_set("a.h5")
    assert len(list(data.recordings(0, 5))) == 5
    with pytest.raises(InputProblem, match="displacement of run 5"):
        data.recording(5)


def test_equal_values_of_other_versions_have_equal_hashes(made, tmp_path, monkeypatch):
    monkeypatch.setattr(batch, "versions", lambda: OTHER)
    report = sweep.run(sweep_kills.scenario(6), plain_engine.simulate, tmp_path / "b.h5")
    one, other = read_data_set(made / "a.h5"), read_data_set(report.output)
    assert one.content_hash == other.content_hash and one.versions != other.versions == OTHER
    assert other.made == ((0, 6, {"engine": "fast", **OTHER}),)


@pytest.mark.parametrize("keep", [False, True])
def test_shards_of_several_versions_are_told_apart(made, tmp_path, monkeypatch, keep):
    scenario, target = sweep_kills.scenario(6), tmp_path / "b"
    with monkeypatch.context() as patch:
        patch.setattr(batch, "versions", lambda: OTHER)
        with pytest.raises(sweep.Interrupted):
            sweep.run(scenario, plain_engine.StopsAfter(4), target, keep_shards=keep)
    report = sweep.run(scenario, plain_engine.simulate, target, keep_shards=keep, resume=True)
    data = read_data_set(target)
    kept = 6 - report.computed
    assert report.content_hash == read_data_set(made / "a.h5").content_hash and 0 < kept < 6
    here = {"engine": "fast", **provenance.versions()}
    assert data.made == ((0, kept, {"engine": "fast", **OTHER}), (kept, 6, here))
    assert data.versions["numpy"] == f"2.3.0, {here['numpy']}"
    assert any("several versions" in note and "numpy 2.3.0" in note for note in verify(target).notes)


def as_format_2(monkeypatch):
    """The writer as it was before hashes and provenance were parted."""
    monkeypatch.setattr(store, "FORMAT", 2)
    monkeypatch.setattr(provenance, "write", lambda file, made: file.attrs.__setitem__("versions", '{"numpy": "2.2.2"}'))


def test_an_old_data_set_is_read_and_checked(tmp_path):
    data = read_data_set(OLD)
    assert len(list(data)) == 4 and data.format == 2 and data.versions["numpy"] == "2.4.6"
    again = sweep.run(sweep_kills.scenario(4), plain_engine.simulate, tmp_path / "now.h5")
    found = verify(OLD)
    assert not found.damage and "older testbed" in found.notes[0] and again.content_hash in found.notes[1]
    edited = Path(shutil.copy(OLD, tmp_path / "edited.h5"))
    with h5py.File(edited, "r+") as file:
        doubled_damping(file)
    seal(edited)
    with pytest.raises(InputProblem, match="was changed"):
        read_data_set(edited)


def test_an_unfinished_sweep_of_an_old_testbed_is_continued(made, tmp_path, monkeypatch):
    scenario = sweep_kills.scenario(6)
    with monkeypatch.context() as patch:
        as_format_2(patch)
        with pytest.raises(sweep.Interrupted):
            sweep.run(scenario, plain_engine.StopsAfter(4), tmp_path / "b.h5")
    report = sweep.run(scenario, plain_engine.simulate, tmp_path / "b.h5", resume=True)
    assert 0 < report.computed < 6 and report.content_hash == read_data_set(made / "a.h5").content_hash
    assert read_data_set(tmp_path / "b.h5").made[0][2] == {"engine": "fast", "numpy": "2.2.2"}
