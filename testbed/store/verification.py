"""Is a data set, to the last bit, what was written? And if not: which runs are touched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import h5py

from testbed.files.hdf5_guard import opened
from testbed.problem import InputProblem
from testbed.recording import CHANNEL_UNITS
from testbed.store.content_hash import ATTRIBUTE, DIGEST, content_hash, kept_rows, row_digest
from testbed.store.data_set import DataSet, look_over, read_data_set
from testbed.store.rows import CHANGED
from testbed.store.seal import State, cut_off, state
from testbed.store.store import FORMAT, SEALED_FROM
from testbed.sweeps.shards import INDEX, NOTE, STRANGE, fault, find, gaps, named_span, overlaps, read_note

_MOST_MAKERS = 6  # spans told
Progress = Callable[[int, int], None]


@dataclass
class Findings:
    """damage: one line for each thing found, empty where all is well. runs: how many were looked at. notes: harmless."""

    path: Path
    runs: int = 0
    files: int = 0
    content_hash: str = ""
    damage: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    damaged_runs: list[int] = field(default_factory=list)


def verify(path: str | Path, quick: bool = False, threads: int = 2, progress: Progress | None = None) -> Findings:
    """Check a data set, or the folder of shards of an unfinished sweep.

    quick: the seal alone, not the values behind it. InputProblem where the path is neither.
    """
    place = Path(path)
    if place.name == INDEX and (place.parent / NOTE).is_file():
        place = place.parent  # the tables of a folder of shards: alone they are not what the content hash is of
    if place.is_dir():
        return _folder(place, quick, progress or (lambda done, total: None))
    return _file(place, quick, threads)


def _file(path: Path, quick: bool, threads: int) -> Findings:
    found = Findings(path, files=1)
    if not path.is_file():
        raise InputProblem(path, "there is no such file", "check the path")
    try:
        seal: State = state(path, threads)
        if seal == "absent" and cut_off(path):
            seal = "broken"
    except OSError as problem:
        raise InputProblem(path, f"cannot be read ({problem.strerror})", "check its permissions") from None
    if seal == "broken":
        found.damage.append("the file's bytes are not those that were written")
    try:
        if seal != "whole":
            look_over(path, trusted=False)
        data = read_data_set(path, checked=True)
        found.runs, found.content_hash = len(data), data.content_hash
        if seal == "whole" and quick:
            return found
        found.notes += _notes(data)
        with opened(path) as file:
            if seal == "absent" and data.format >= SEALED_FROM:
                found.damage.append("the seal at its end is damaged, or another program has changed the file since")
            if not _same_content(file):
                found.damage.append("the content is not that of the content hash that was written with it")
            if found.damage:
                found.damage += _rows(file, found.damaged_runs)
            elif seal == "absent":
                found.notes.append("has no seal, as old files: only the content was checked")
            elif data.format < FORMAT:
                found.notes.append(f"its content hash by today's rule is {content_hash(file, kept_rows(file), today=True)}")
    except InputProblem as problem:
        if seal == "absent" and not _ours(path):
            raise
        found.damage.append(problem.what if problem.what.startswith(CHANGED) else
                            f"the HDF5 inside cannot be read: {problem.what}")
    return found


def _notes(data: DataSet) -> list[str]:
    """What is to be known of who made a data set."""
    old = ["is of an older testbed: which versions made which run is not in it"] if data.format < FORMAT else []
    if len(data.made) < 2:
        return old
    told = (f"{first} to {last - 1} by {', '.join(' '.join(item) for item in sorted(maker.items()))}"
            for first, last, maker in data.made[:_MOST_MAKERS])
    more = f"; and {len(data.made) - _MOST_MAKERS} more spans" if len(data.made) > _MOST_MAKERS else ""
    return [*old, f"its runs were made by several versions: runs {'; '.join(told)}{more}"]


def _same_content(file: h5py.File) -> bool:
    try:
        return content_hash(file) == str(file.attrs.get(ATTRIBUTE, ""))
    except (OSError, RuntimeError, ValueError, KeyError):  # h5py's words for bytes that make no sense
        return False


def _ours(path: Path) -> bool:
    """True where a file without a seal was a data set once: its first bytes name the attributes of one."""
    with path.open("rb") as file:
        return b"scenario_fingerprint" in file.read(1_000_000)


def _rows(file: h5py.File, damaged: list[int]) -> list[str]:
    """Which runs' samples differ from the hashes kept of them."""
    said = []
    for name in file:
        if name not in CHANNEL_UNITS or DIGEST + name not in file:
            continue
        kept, data = file[DIGEST + name][()], file[name]
        wrong = []
        for first in range(0, data.shape[0], data.chunks[0]):
            last = min(first + data.chunks[0], data.shape[0])
            try:
                rows = data[first:last]
                wrong += [first + k for k, row in enumerate(rows) if row_digest(row) != kept[first + k].tobytes()]
            except (OSError, RuntimeError):  # the checksum of a chunk: any of its runs
                wrong += range(first, last)
        damaged += wrong
        said.append(f"{name}: " + (f"runs touched: {_listed(wrong)}" if wrong else "every run's samples are whole"))
    return said


def _listed(numbers: list[int], most: int = 12) -> str:
    shown = ", ".join(map(str, numbers[:most]))
    return shown + (f" and {len(numbers) - most} more" if len(numbers) > most else "")


def _folder(folder: Path, quick: bool, progress: Progress) -> Findings:
    found = Findings(folder)
    try:
        note = read_note(folder)
        runs, fingerprint = note["runs"], note["fingerprint"]
    except FileNotFoundError:
        raise InputProblem(folder, f"holds no {NOTE}: it is no folder of a sweep", "give DATA.h5 or DATA.h5.parts") from None
    except ValueError:
        found.damage.append(f"{NOTE} is not as it was written")
        return found
    shards = find(folder)
    for number, (first, last, path) in enumerate(shards):
        wrong = "holds runs that the scenario has not" if last > runs else fault(path, fingerprint)
        if wrong is not None:
            found.damage.append(f"{path.name} {wrong}")
            found.damaged_runs += range(first, min(last, runs))
        progress(number + 1, len(shards))
    if (folder / INDEX).exists() and state(folder / INDEX) != "whole":
        found.damage.append(f"{INDEX} is not as it was written")
    found.files, found.runs = len(shards), sum(last - first for first, last, _ in shards)
    found.damage += [f"{path.name} holds runs {first} to {last - 1}, which another shard holds too"
                     for first, last, path in overlaps(shards)]
    found.damage += [f"runs {first} to {last - 1} are missing: no shard holds them" for first, last in gaps(shards, runs)]
    for other in sorted(folder.iterdir()):
        if other.name.endswith(".part"):
            found.notes.append(f"{other.name} was left by a process that was killed while it wrote; --resume removes it")
        elif named_span(other) is None and other.name not in (NOTE, INDEX):
            found.damage.append(f"{other.name} does not belong here: a shard is named runs-FIRST-LAST.h5")
    if (folder / INDEX).exists() and not found.damage:
        try:
            data = read_data_set(folder)
            if data.fingerprint != fingerprint:
                found.damage.append(f"{INDEX} {STRANGE}")
            for _ in () if quick else data:  # every run's samples against the hash that the index has of them
                pass
            found.content_hash = data.content_hash
            found.notes += _notes(data)
        except InputProblem as problem:
            found.damage.append(f"{Path(problem.place).name} {problem.what}")
    return found
