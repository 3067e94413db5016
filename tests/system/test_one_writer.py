"""One writer an output: two sweeps at once, locks of the dead and of other machines, damaged notes, foreign shards."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from testbed.catalogue import catalogue
from testbed.files.yaml_text import parse
from testbed.problem import InputProblem
from testbed.scenario.scenario_file import scenario_from
from testbed.store.data_set import read_data_set
from testbed.store.verification import verify
from testbed.sweeps import sweep
from testbed.sweeps.shards import find, note_text, read_note, shard_path
from testbed.system import one_writer as module
from testbed.system.one_writer import lock_path, one_writer
from tests.support import plain_engine, sweep_kills

RUNS = 24
HOLDER = "import sys, time\nfrom pathlib import Path\nfrom testbed.system.one_writer import one_writer\n" \
         "with one_writer(Path(sys.argv[1])):\n    print('held', flush=True)\n    time.sleep(60)\n"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The content hash of an undisturbed sweep."""
    target = tmp_path_factory.mktemp("whole") / "a.h5"
    return sweep.run(sweep_kills.scenario(RUNS), plain_engine.simulate, target).content_hash


@pytest.fixture
def scenario():
    return sweep_kills.scenario(RUNS)


def holder(target):
    """A process that holds the lock."""
    process = subprocess.Popen([sys.executable, "-c", HOLDER, str(target)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    return process


def owner(**changed):
    return dict(module._myself()) | changed


def test_a_second_sweep_is_refused_and_nothing_is_mixed(scenario, tmp_path, whole):
    target = tmp_path / "a.h5"
    began, go_on, found = threading.Event(), threading.Event(), []

    def progress(done, runs):
        if done:
            began.set()
            go_on.wait(20)

    first = threading.Thread(target=lambda: found.append(sweep.run(scenario, plain_engine.simulate, target, progress=progress)))
    first.start()
    assert began.wait(20)
    for other, resume in ((scenario, False), (scenario, True), (scenario.with_seed(9), True), (sweep_kills.scenario(7), False)):
        with pytest.raises(InputProblem, match=f"another sweep writes to it .process {os.getpid()} on "):
            sweep.run(other, plain_engine.unwanted, target, resume=resume)
    go_on.set()
    first.join()
    assert found[0].content_hash == whole and [path.name for path in tmp_path.iterdir()] == ["a.h5"]


def test_of_many_that_begin_at_once_one_writes(tmp_path, whole):
    target = tmp_path / "a.h5"
    started = [sweep_kills.start(target, RUNS) for _ in range(4)]
    codes = [process.wait() for process in started]
    assert codes.count(0) >= 1 and all(json.loads(process.stdout.read())["content_hash"] == whole
                                       for process, code in zip(started, codes, strict=True) if code == 0)
    assert not verify(target).damage and not lock_path(target).exists() and not Path(f"{target}.parts").exists()


def test_the_lock_of_a_dead_process_is_taken(scenario, tmp_path, whole):
    target = tmp_path / "a.h5"
    process = holder(target)
    with pytest.raises(InputProblem, match=f"process {process.pid} on"):
        sweep.run(scenario, plain_engine.unwanted, target)
    process.kill()
    process.wait()
    assert lock_path(target).exists()
    assert sweep.run(scenario, plain_engine.simulate, target).content_hash == whole
    assert not lock_path(target).exists()


@pytest.mark.parametrize("number", [None, *module._NO_LOCKS])
def test_without_the_systems_locks_processes_are_asked_for(tmp_path, monkeypatch, number):
    if number is not None:
        monkeypatch.setattr(module.fcntl, "flock", lambda *_: (_ for _ in ()).throw(OSError(number, "no locks")))
    else:
        monkeypatch.setattr(module, "_locked", lambda handle: None)
    target = tmp_path / "a.h5"
    process = holder(target)
    with pytest.raises(InputProblem, match="from here nobody can tell"), one_writer(target):
        pass
    process.kill()
    process.wait()
    with one_writer(target) as check:
        check()
    lock_path(target).write_text(json.dumps(owner(begun="1")))  # another process has the number now
    with one_writer(target):
        pass


def test_another_machine_is_believed_to_be_alive(tmp_path):
    target = tmp_path / "a.h5"
    lock_path(target).write_text(json.dumps(owner(host="node17", pid=4)))
    with pytest.raises(InputProblem, match=r"process 4 on node17.*remove a.h5.lock"), one_writer(target):
        pass
    assert json.loads(lock_path(target).read_text())["host"] == "node17"


@pytest.mark.parametrize(("restart", "job", "free"), [("1", "77", True), ("0", "77", False), ("1", "78", False)])
def test_the_queues_restart_of_the_same_job_goes_on(tmp_path, monkeypatch, restart, job, free):
    target = tmp_path / "a.h5"
    lock_path(target).write_text(json.dumps(owner(host="node17", job="77", restart="0")))
    monkeypatch.setenv("SLURM_JOB_ID", job)
    monkeypatch.setenv("SLURM_RESTART_COUNT", restart)
    if free:
        with one_writer(target):
            pass
        assert not lock_path(target).exists()
    else:
        with pytest.raises(InputProblem, match="node17"), one_writer(target):
            pass


def text(path):
    path.write_text("my own words")


def number(path):
    path.write_text("17")


def nested(path):
    path.write_text("[" * 100_000)


def nothing(path):
    path.write_text("")


def zeros(path):
    path.write_bytes(bytes(300))


def link(path):
    (path.parent / "mine.txt").write_text("mine")
    path.symlink_to("mine.txt")


def folder(path):
    path.mkdir()


def fifo(path):
    os.mkfifo(path)


@pytest.mark.parametrize("make", [text, number, nested, nothing, zeros, link, folder, fifo])
def test_what_is_no_lock_is_left_alone(tmp_path, make, monkeypatch):
    monkeypatch.setattr(module, "_TRIES", 3)
    target = tmp_path / "a.h5"
    make(lock_path(target))
    before = lock_path(target).lstat()
    begin = time.monotonic()
    with pytest.raises(InputProblem) as problem, one_writer(target):
        pass
    assert "\n" not in str(problem.value) and time.monotonic() - begin < 5
    after = lock_path(target).lstat()
    assert (before.st_ino, before.st_size) == (after.st_ino, after.st_size)
    assert not (tmp_path / "mine.txt").exists() or (tmp_path / "mine.txt").read_text() == "mine"


@pytest.mark.parametrize("by_another", [False, True])
def test_a_lock_that_was_taken_away_stops_the_sweep(scenario, tmp_path, whole, by_another):
    target = tmp_path / "a.h5"

    def progress(done, runs):
        if done == RUNS:
            lock_path(target).unlink()
            if by_another:
                lock_path(target).write_text(json.dumps(owner(pid=1)))

    with pytest.raises(InputProblem, match="was taken away"):
        sweep.run(scenario, plain_engine.simulate, target, progress=progress)
    assert not target.exists() and lock_path(target).exists() == by_another
    lock_path(target).unlink(missing_ok=True)
    assert sweep.run(scenario, plain_engine.unwanted, target, resume=True).content_hash == whole


@pytest.mark.parametrize("keep", [False, True])
@pytest.mark.parametrize("seed", [5, 9])
def test_a_shard_that_is_not_of_this_sweep_is_not_taken(scenario, tmp_path, whole, keep, seed):
    """While a sweep runs, a process that heeds no lock puts shards of other runs, or of another scenario, in their place."""
    other = tmp_path / "other"
    sweep.run(scenario.with_seed(seed), plain_engine.simulate, other, keep_shards=True)
    target = tmp_path / "a.h5"
    there = find(other)

    def progress(done, runs):
        if done == RUNS:
            first, last, path = there[1]
            at = shard_path(Path(f"{target}.parts"), first, last) if seed != 5 else find(Path(f"{target}.parts"))[0][2]
            os.replace(path, at)

    with pytest.raises(InputProblem, match="another scenario" if seed != 5 else "not where it belongs"):
        sweep.run(scenario, plain_engine.simulate, target, keep_shards=keep, progress=progress)
    assert not target.exists()
    report = sweep.run(scenario, plain_engine.simulate, target, keep_shards=keep, resume=True)
    assert report.content_hash == whole and 0 < report.computed < RUNS and not verify(target).damage


def changed(**values):
    def change(note):
        found = json.loads(note.read_text())
        note.write_text(note_text(found | values) if "hash" not in values else json.dumps(found | values))
    return change


def written(content):
    return lambda note: note.write_bytes(content)


NOTES = {"batch 0": changed(batch=0), "batch -5": changed(batch=-5), "chunk 0": changed(chunk=0),
         "batch text": changed(batch="5"),
         "batch 0, its hash left": changed(batch=0, hash="f" * 64), "batch 5, its hash left": changed(batch=5, hash="f" * 64),
         "empty": written(b""), "cut": written(b'{"batch": 5, "ch'), "a list": written(b"[1, 2]"),
         "bytes": written(b"\xff\xfe\0"), "nested": written(b"[" * 100_000), "gone": lambda note: note.unlink(),
         "infinite": written(b'{"batch": Infinity, "chunk": 1, "fingerprint": "", "runs": 24}')}


@pytest.mark.parametrize("name", NOTES)
def test_a_damaged_note_loses_nothing(scenario, tmp_path, whole, name):
    with pytest.raises(sweep.Interrupted) as stop:
        sweep.run(scenario, plain_engine.StopsAfter(14), tmp_path / "a.h5")
    parts = tmp_path / "a.h5.parts"
    NOTES[name](parts / "sweep.json")
    before = {path.name: path.read_bytes() for _, _, path in find(parts)}
    with pytest.raises(InputProblem, match="another scenario"):
        sweep.run(scenario.with_seed(9), plain_engine.unwanted, tmp_path / "a.h5", resume=True)
    assert before == {path.name: path.read_bytes() for _, _, path in find(parts)}
    report = sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5", resume=True)
    assert report.content_hash == whole and report.computed == RUNS - stop.value.done


def test_a_finished_folder_with_a_damaged_note_is_mended(scenario, tmp_path, whole):
    sweep.run(scenario, plain_engine.simulate, tmp_path / "a", keep_shards=True)
    (tmp_path / "a" / "sweep.json").write_text("{}")
    assert verify(tmp_path / "a").damage
    report = sweep.run(scenario, plain_engine.unwanted, tmp_path / "a", keep_shards=True, resume=True)
    assert report.content_hash == whole and not verify(tmp_path / "a").damage and read_note(tmp_path / "a")["runs"] == RUNS


def test_a_shard_that_cannot_be_read_just_now_is_not_removed(scenario, tmp_path, whole, monkeypatch):
    with pytest.raises(sweep.Interrupted):
        sweep.run(scenario, plain_engine.StopsAfter(14), tmp_path / "a.h5")
    from testbed.sweeps import shards

    with monkeypatch.context() as patch:
        patch.setattr(shards, "state", lambda path: (_ for _ in ()).throw(OSError(5, "Input/output error")))
        with pytest.raises(InputProblem, match="Input/output error"):
            sweep.run(scenario, plain_engine.unwanted, tmp_path / "a.h5", resume=True)
    before = len(find(tmp_path / "a.h5.parts"))
    report = sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5", resume=True)
    assert before and report.content_hash == whole and report.computed == 12


def test_runs_of_two_laws_under_one_name_are_not_mixed(tmp_path):
    law, folders = tmp_path / "fx" / "my_drag.py", (str(tmp_path / "fx"),)
    law.parent.mkdir()
    text = (Path(sweep.__file__).parents[1] / "effects" / "process_damping.py").read_text("utf-8")
    law.write_text(text, "utf-8")
    effect = "  effects: {my_drag: {coefficient: 1e4 N/m}}\ncut: {"
    described = sweep_kills.TEXT.replace("RUNS", "8").replace("cut: {", effect, 1)
    scenario = scenario_from(parse(described, "s.yaml"), catalogue(*folders))
    with pytest.raises(sweep.Interrupted):
        sweep.run(scenario, plain_engine.StopsAfter(5), tmp_path / "a.h5", folders=folders)
    law.write_text(text + "\n# another law\n", "utf-8")
    with pytest.raises(InputProblem, match="another scenario"):
        sweep.run(scenario, plain_engine.unwanted, tmp_path / "a.h5", folders=folders, resume=True)
    law.write_text(text, "utf-8")
    assert sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5", folders=folders, resume=True).computed < 8


def test_what_a_killed_consolidation_left_is_removed(scenario, tmp_path, whole):
    left = tmp_path / ".a.h5.abc.part"
    left.write_bytes(b"half")
    (tmp_path / ".b.h5.abc.part").write_bytes(b"another's")
    assert sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5").content_hash == whole
    assert not left.exists() and (tmp_path / ".b.h5.abc.part").exists()


def test_a_sweep_killed_outright_leaves_a_lock_that_the_next_takes(tmp_path, whole):
    target = tmp_path / "a.h5"
    process = sweep_kills.start(target, RUNS)
    while not sweep_kills.shards_there(target):
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert lock_path(target).exists()
    again = sweep_kills.start(target, RUNS)
    assert json.loads(again.stdout.read())["content_hash"] == whole and again.wait() == 0
    assert read_data_set(target).scenario_run.tolist() == list(range(RUNS)) and not lock_path(target).exists()
