"""The shards of a sweep: files named by the runs they hold, found and looked over."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np

from testbed.problem import InputProblem
from testbed.seal import state

_NAME = re.compile(r"runs-(\d{8,})-(\d{8,})\.h5")
Span = tuple[int, int]  # runs `first` up to, not including, `last`
Shard = tuple[int, int, Path]
NOTE = "sweep.json"
INDEX = "index.h5"  # all tables of a data set that stays a folder of shards


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
    except OSError as problem:
        return f"cannot be read ({problem.strerror})"
    if found != "whole":
        return "is damaged: not as it was written" if found == "broken" else "is cut short or no shard: it has no seal"
    with h5py.File(path, "r") as file:  # the seal holds, so these are the bytes that were written
        if fingerprint is not None and str(file.attrs["scenario_fingerprint"]) != fingerprint:
            return "belongs to another scenario"
        runs = file["scenario_run"][()]
    span = named_span(path)
    if span is None or not np.array_equal(runs, np.arange(*span)):
        return f"is not where it belongs: it holds runs {runs[0]} to {runs[-1]}"
    return None


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
            if shard[1] > runs or fault(shard[2], fingerprint) is not None:
                shard[2].unlink()
            else:
                sound.append(shard)
        for shard in overlaps(sound):
            shard[2].unlink()
            sound.remove(shard)
    except OSError as problem:
        raise InputProblem(problem.filename or folder, f"cannot be read or removed ({problem.strerror})",
                           "give yourself the permission, or choose another name with -o") from None
    return sound
