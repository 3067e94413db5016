"""The shards of a sweep: files named by the runs they hold, found and looked over."""

from __future__ import annotations

import json
import re
from collections.abc import Generator
from hashlib import sha256
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from testbed.problem import InputProblem
from testbed.store.content_hash import contradiction
from testbed.store.rows import CHANGED
from testbed.store.seal import state

_NAME = re.compile(r"runs-(\d{8,})-(\d{8,})\.h5")
Span = tuple[int, int]  # runs `first` up to, not including, `last`
Spans = Generator[Span, None, None]
Shard = tuple[int, int, Path]
NOTE = "sweep.json"
INDEX = "index.h5"  # all tables of a data set that stays a folder of shards
STRANGE = "belongs to another scenario"
UNREADABLE = "cannot be read"
_COUNTS = ("runs", "batch", "chunk")


def parts_folder(target: Path) -> Path:
    """Where the shards of a data set stand until it is whole."""
    return target.with_name(target.name + ".parts")


def shard_path(folder: Path, first: int, last: int) -> Path:
    """The file of a batch's runs; its name says which they are."""
    return folder / f"runs-{first:08d}-{last:08d}.h5"


def named_span(path: Path) -> Span | None:
    """The runs that a file's name claims, or None where it is no shard's name."""
    match = _NAME.fullmatch(path.name)
    return (int(match[1]), int(match[2])) if match and int(match[1]) < int(match[2]) else None


def find(folder: Path) -> list[Shard]:
    """All files with a shard's name, in order."""
    spans = ((named_span(path), path) for path in folder.iterdir())
    return sorted((*span, path) for span, path in spans if span is not None)


def fault(path: Path, fingerprint: str | None = None) -> str | None:
    """What is wrong with a shard, or None: its bytes against its seal, its runs against its name, its scenario."""
    try:
        found = state(path)
        if found != "whole":
            return "is damaged: not as it was written" if found == "broken" else "is cut short or no shard: it has no seal"
        with h5py.File(path, "r") as file:  # the seal holds, so it does not bring the library down
            if (edited := contradiction(file)) is not None:
                return f"{CHANGED}: {edited}"
            if fingerprint is not None and str(file.attrs["scenario_fingerprint"]) != fingerprint:
                return STRANGE
            runs = file["scenario_run"][()]
    except OSError as problem:
        return f"{UNREADABLE} ({problem.strerror})" if problem.errno else "is no shard: no HDF5 file"
    except (KeyError, RuntimeError) as problem:
        return f"is no shard ({problem})"
    span = named_span(path)
    if span is None or not np.array_equal(runs, np.arange(*span)):
        return f"is not where it belongs: it holds runs {runs[0]} to {runs[-1]}"
    return None


def remove(path: Path, wrong: str) -> None:
    """Remove a shard with this fault. InputProblem where it can only not be read just now: it may be whole."""
    if wrong.startswith(UNREADABLE):
        raise InputProblem(path, wrong, "mend the disk or give the permission, then continue with --resume")
    path.unlink()


def note_text(note: dict[str, Any]) -> str:
    """The text of a sweep's note, with a hash of its own."""
    said = {key: value for key, value in note.items() if key != "hash"}
    plain = json.dumps(said, sort_keys=True)
    return json.dumps({**said, "hash": sha256(plain.encode()).hexdigest()}, sort_keys=True) + "\n"


def read_note(folder: Path) -> dict[str, Any]:
    """What a folder of shards is of: fingerprint of the scenario, runs, runs in a batch and in a chunk.

    FileNotFoundError where there is no note, ValueError where it is not as a sweep writes it.
    """
    path = folder / NOTE
    if path.exists() and not path.is_file():
        raise ValueError("no file")
    try:
        text = path.read_text(encoding="utf-8")
        note = json.loads(text)
        if note_text(note) != text or not isinstance(note["fingerprint"], str) or \
                not all(isinstance(note[name], int) and note[name] > 0 for name in _COUNTS):
            raise ValueError("not as it was written")
    except FileNotFoundError:
        raise
    except (KeyError, TypeError, AttributeError, RecursionError, OSError) as problem:
        raise ValueError("not as it was written") from problem
    return note


def gaps(shards: list[Shard], runs: int) -> list[Span]:
    """The runs that no shard holds."""
    missing, reached = [], 0
    for first, last, _ in shards:
        if first > reached:
            missing.append((reached, first))
        reached = max(reached, last)
    return missing + ([(reached, runs)] if reached < runs else [])


def overlaps(shards: list[Shard]) -> list[Shard]:
    """Shards that hold runs which a shard before them holds already."""
    twice, reached = [], 0
    for shard in shards:
        if shard[0] < reached:
            twice.append(shard)
        else:
            reached = shard[1]
    return twice


def kept(folder: Path, runs: int, fingerprint: str) -> list[Shard]:
    """The whole shards of an unfinished sweep; what is damaged, misplaced or double is removed, to be computed again."""
    try:
        for left in folder.glob(".*.part"):  # of a process that was killed while it wrote
            left.unlink(missing_ok=True)
        sound = []
        for shard in find(folder):
            wrong = "holds runs that the scenario has not" if shard[1] > runs else fault(shard[2], fingerprint)
            if wrong is not None:
                remove(shard[2], wrong)
            else:
                sound.append(shard)
        for shard in overlaps(sound):
            shard[2].unlink()
            sound.remove(shard)
    except OSError as problem:
        raise InputProblem(problem.filename or folder, f"cannot be read or removed ({problem.strerror})",
                           "give yourself the permission, or choose another name with -o") from None
    return sound
