"""Edited data sets, two writers at once, damaged notes and shards: what is answered?"""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from testbed.cli import main
from testbed.problem import InputProblem
from testbed.store.data_set import read_data_set
from testbed.store.seal import seal
from testbed.store.store import CONDITIONS
from testbed.store.verification import verify
from testbed.sweeps import sweep
from testbed.sweeps.shards import find, shard_path
from testbed.system.one_writer import lock_path
from tests.store.test_seals import COMMANDS, MODEL, doubled_damping
from tests.support import plain_engine, sweep_kills
from tests.system import test_one_writer as writers

ALWAYS = ("verify", "inspect", "export")  # the others take their turns, but for these edits:
BY_ALL = ("all damping ratios doubled", "a sample changed", "spindle_speed changed", "displacement's scale_factor changed",
          "model_text changed", "attribute content_hash changed")
Probe = tuple[str, bool, str]
RUNS = 8  # of a sweep
TRUTH = ("damping_ratio", "natural_frequency", "mass", "immersion", "tangential_coefficient", "normal_coefficient",
         "mark_angle")
TABLES = (*CONDITIONS, *(f"truth.{name}" for name in TRUTH), "noise_displacement", "start", "sample_count", "outcome",
          "outcome_time", "marks", "pass_times", "scenario_run", "run", "time", "digest_displacement")
ATTRIBUTES = {"seed": 6, "sampling_rate": 4000.0, "flutes": 2, "title": "another", "engine": "mujoco", "format": 2,
              "scenario_fingerprint": "0" * 64, "content_hash": "0" * 64, "provenance_hash": "0" * 64, "origin": "measured"}
CHANNEL = {"units": "mm", "scale_factor": 1.0, "add_offset": 1e-3, "_FillValue": np.int16(7), "long_name": "another"}
TEXTS = ("scenario_text", "model_text", "model_xml", "provenance")


def run() -> Iterator[Probe]:
    """Every probe: name, answered as asked, what was seen."""
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        place = Path(name)
        scenario = sweep_kills.scenario(RUNS)
        whole = sweep.run(scenario, plain_engine.simulate, place / "whole.h5").content_hash
        sweep.run(scenario, plain_engine.simulate, place / "whole", keep_shards=True)
        (place / "model.yaml").write_text(MODEL)
        kinds = {"an edit": _edits(), "an edit of shards": _shard_edits(), "two writers": _writers(place, whole),
                 "a note": _notes(place, whole), "a shard": _shards(place, whole)}
        for kind, found in kinds.items():
            yield from ((f"{kind}: {name}", right, seen) for name, right, seen in found)


def edits() -> dict[str, Callable[[h5py.File], None]]:
    """One edit of each kind of value and attribute, by what it does."""
    found: dict[str, Callable[[h5py.File], None]] = {}
    for name in TABLES:
        found[f"{name} changed"] = lambda file, name=name: _first_changed(file[name])
    for key, value in ATTRIBUTES.items():
        found[f"attribute {key} changed"] = lambda file, key=key, value=value: file.attrs.__setitem__(key, value)
    for key, value in CHANNEL.items():
        found[f"displacement's {key} changed"] = lambda file, key=key, value=value: \
            file["displacement"].attrs.__setitem__(key, value)
    for name in TEXTS:
        found[f"{name} changed"] = lambda file, name=name: file[name].__setitem__((), file[name].asstr()[()] + " ")
    return found | {
        "a sample changed": lambda file: _first_changed(file["displacement"]),
        "two runs' samples exchanged": _exchanged,
        "all damping ratios doubled": doubled_damping,
        "an attribute added": lambda file: file.attrs.__setitem__("remark", "mine"),
        "a data set added": lambda file: file.create_dataset("mine", data=[1.0]),
        "a group added": lambda file: file.create_group("mine"),
        "a truth removed": lambda file: file.__delitem__("truth.mass"),
        "the hashes of rows removed": lambda file: file.__delitem__("digest_displacement"),
        "the content hash removed": lambda file: file.attrs.__delitem__("content_hash"),
    }


def _first_changed(data: h5py.Dataset) -> None:
    values = data[()]
    values.flat[0] = np.nan_to_num(values).flat[0] + np.asarray(1, values.dtype)
    data[...] = values


def _exchanged(file: h5py.File) -> None:
    file["displacement"][:2] = file["displacement"][:2][::-1]


def _answer(*arguments: object) -> tuple[object, str]:
    """Exit code and standard error of a command line."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as stop:
            return stop.code, said.getvalue()
        except BaseException as problem:  # a fault of the program, which is to be counted
            return type(problem).__name__, said.getvalue()


def _refused(name: str, code: object, err: str, *new: str) -> Probe:
    lines = [line for line in err.splitlines() if line.startswith("error: ")]
    left = [path for path in new if Path(path).exists()]
    shutil.rmtree("new", ignore_errors=True)
    return name, code == 2 and len(lines) == 1 and "Traceback" not in err and not left, f"{code}: {(lines or [err])[0][:90]}"


def _edits() -> Iterator[Probe]:
    for name in ALWAYS:
        code, err = _answer(name, "whole.h5", *COMMANDS[name])
        yield f"untouched, then {name}", code == 0 and not err, f"{code} {err[:90]}"
    shutil.rmtree("new", ignore_errors=True)
    in_turn = itertools.cycle(("identify", "score", "compare", "diagnose", "chart --data", "add"))
    for what, edit in edits().items():
        asked = {*ALWAYS, next(in_turn)} if what not in BY_ALL else None
        for sealed in (False, True):
            shutil.copy("whole.h5", "a.h5")
            with h5py.File("a.h5", "r+") as file:
                edit(file)
            if sealed:
                seal(Path("a.h5"))
            lines = {"chart --data": ("chart", "model.yaml", "--speed", "5000:6000:3", "--depth", "1:2:3", "--data", "a.h5",
                                      "-o", "new"),
                     "add": ("add", "cubic_stiffness", "-m", "model.yaml", "-c", "a.h5", "-o", "new.yaml"),
                     **{command: (command, "a.h5", *more) for command, more in COMMANDS.items()}}
            for command, line in lines.items():
                if command not in (ALWAYS if sealed else asked or lines):
                    continue
                yield _refused(f"{what}{', sealed anew' if sealed else ''}, then {command}", *_answer(*line), "new", "new.yaml")


def _shard_edits() -> Iterator[Probe]:
    """Edits of one file in a folder of shards."""
    for which in ("index.h5", find(Path("whole"))[1][2].name):
        for what, edit in edits().items():
            if which == "index.h5" and what.startswith(("displacement's", "a sample", "two runs")):
                continue  # of the shards alone
            shutil.rmtree("f", ignore_errors=True)
            shutil.copytree("whole", "f")
            with h5py.File(f"f/{which}", "r+") as file:
                edit(file)
            seal(Path("f") / which)
            yield _refused(f"a folder's {which.split('-')[0]}: {what}, sealed anew, then verify", *_answer("verify", "f"))


def _continued(name: str, target: Path, whole: str, work: Callable[[], Any]) -> Probe:
    """That what is there is continued to the same content, or refused in one line with every shard left as it is."""
    parts = Path(f"{target}.parts")
    before = {path.name: path.read_bytes() for _, _, path in find(parts) if path.is_file()} if parts.is_dir() else {}
    try:
        report = work()
    except InputProblem as problem:
        after = {path.name: path.read_bytes() for _, _, path in find(parts) if path.is_file()} if parts.is_dir() else {}
        return name, "\n" not in str(problem) and before == after, str(problem)[-90:]
    except BaseException as problem:
        return name, False, f"{type(problem).__name__}: {problem}"[:90]
    good = report.content_hash == whole and not verify(target).damage
    return name, good, f"{report.computed} computed, content {'the same' if good else 'ANOTHER'}"


def _writers(place: Path, whole: str) -> Iterator[Probe]:
    scenario, target = sweep_kills.scenario(RUNS), place / "w.h5"
    others = {"the same": scenario, "another seed": scenario.with_seed(9), "another scenario": sweep_kills.scenario(5)}
    for (what, other), resume, keep in itertools.product(others.items(), (False, True), (False, True)):
        seen: list[str] = []

        def meanwhile(done: int, runs: int, other: Any = other, resume: bool = resume, keep: bool = keep,
                      seen: list[str] = seen) -> None:
            try:
                sweep.run(other, plain_engine.unwanted, target, resume=resume, keep_shards=keep)
                seen.append("let in")
            except InputProblem as problem:
                seen.append(str(problem))

        report = sweep.run(scenario, plain_engine.simulate, target, progress=meanwhile)
        good = report.content_hash == whole and all("another sweep writes to it" in line for line in seen) and bool(seen)
        yield (f"a second sweep of {what}{', --resume' if resume else ''}{', --shards' if keep else ''}", good,
               f"{len(seen)} tries refused; content {'the same' if good else 'ANOTHER'}")
        target.unlink()
    started = [sweep_kills.start(target, RUNS) for _ in range(3)]
    codes = [process.wait() for process in started]
    good = 0 in codes and not verify(target).damage and read_data_set(target).content_hash == whole
    yield "three processes at once", good, f"exit codes {codes}"
    target.unlink()
    process = writers.holder(target)
    process.send_signal(signal.SIGKILL)
    process.wait()
    yield _continued("the lock of a killed process", target, whole, lambda: sweep.run(scenario, plain_engine.simulate, target))
    for make in (writers.text, writers.number, writers.nested, writers.nothing, writers.zeros, writers.link, writers.folder,
                 writers.fifo):
        folder = Path(tempfile.mkdtemp(dir=place))
        make(lock_path(folder / "a.h5"))
        yield _continued(f"a lock that is none: {make.__name__}", folder / "a.h5", "", lambda folder=folder: sweep.run(
            scenario, plain_engine.unwanted, folder / "a.h5"))
    far = place / "b.h5"
    lock_path(far).write_text(json.dumps(writers.owner(host="node17")))
    yield _continued("a lock of another machine", far, "", lambda: sweep.run(scenario, plain_engine.unwanted, far))


def _begun(place: Path) -> Path:
    """A sweep stopped half-way."""
    folder = Path(tempfile.mkdtemp(dir=place))
    with contextlib.suppress(sweep.Interrupted):
        sweep.run(sweep_kills.scenario(RUNS), plain_engine.StopsAfter(5), folder / "a.h5")
    return folder / "a.h5"


def _notes(place: Path, whole: str) -> Iterator[Probe]:
    for (what, harm), seed in itertools.product(writers.NOTES.items(), (5, 9)):
        target = _begun(place)
        harm(Path(f"{target}.parts") / sweep.NOTE)
        scenario = sweep_kills.scenario(RUNS).with_seed(seed)
        name = f"the note: {what}; continued{'' if seed == 5 else ' with another seed'}"
        found = _continued(name, target, whole, lambda target=target, scenario=scenario: sweep.run(
            scenario, plain_engine.simulate, target, resume=True))
        yield found if seed == 5 else (name, found[1] and "another scenario" in found[2], found[2])


def _shards(place: Path, whole: str) -> Iterator[Probe]:
    other = place / "other"
    sweep.run(sweep_kills.scenario(RUNS).with_seed(9), plain_engine.simulate, other, keep_shards=True)

    def edited(path: Path) -> None:
        with h5py.File(path, "r+") as file:
            _first_changed(file["truth.damping_ratio"])

    def resealed(path: Path) -> None:
        edited(path)
        seal(path)

    harms: dict[str, Callable[[Path], object]] = {
        "cut short": lambda path: os.truncate(path, path.stat().st_size // 2),
        "empty": lambda path: path.write_bytes(b""), "text": lambda path: path.write_text("mine"),
        "a bit flipped": lambda path: _flip(path), "edited": edited, "edited, sealed anew": resealed,
        "removed": lambda path: path.unlink(), "of another seed": lambda path: shutil.copy(other / path.name, path),
        "sealed text": lambda path: (path.write_text("mine"), seal(path)),
        "moved": lambda path: path.rename(shard_path(path.parent, 6, 8)),
        "beyond the scenario": lambda path: shutil.copy(path, shard_path(path.parent, 8, 10)),
        "twice": lambda path: shutil.copy(path, shard_path(path.parent, 0, 3)),
        "a half beside it": lambda path: (path.parent / f".{path.name}.x.part").write_bytes(b"half"),
    }
    for what, harm in harms.items():
        target = _begun(place)
        harm(find(Path(f"{target}.parts"))[0][2])
        yield _continued(f"a shard {what}, then --resume", target, whole, lambda target=target: sweep.run(
            sweep_kills.scenario(RUNS), plain_engine.simulate, target, resume=True))


def _flip(path: Path) -> None:
    """One bit in the middle of a file."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)
