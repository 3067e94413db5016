"""From a data set to a folder of Parquet shards: one pass over the runs, the folder appears whole or not at all."""

from __future__ import annotations

import json
import math
import os
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from testbed.export.groups import SPLITS, groups_of, split_of
from testbed.export.schema import FORMAT, Column, arrow_schema, columns, truth_column
from testbed.export.shards import ShardWriter
from testbed.problem import InputProblem
from testbed.recording import CHANNEL_UNITS, Recording
from testbed.store.store import truth_units

MANIFEST = "export.json"
DATA = "data"
Labelled = Callable[[int, Recording], Mapping[str, Any]]


@dataclass(frozen=True)
class Plan:
    """What goes where: group and split of every run (runs,), the columns, and what is told of the source."""

    group: list[str]
    split: list[str]
    columns: tuple[Column, ...]
    about: Mapping[str, Any]

    def counts(self) -> dict[str, dict[str, int]]:
        """Runs and groups of each split, in order."""
        return {name: {"runs": self.split.count(name),
                       "groups": len({group for group, split in zip(self.group, self.split, strict=True) if split == name})}
                for name in SPLITS}


def plan(source: Any, catalogue: Mapping[str, Any], shares: Sequence[float], seed: int) -> Plan:
    """Divide a DataSet by operating condition. catalogue: the effects, for the units of their parameters."""
    group = groups_of(source.conditions, source.flutes)
    place = {name: split_of(name, shares, seed) for name in set(group)}
    units = {"mark_angle": "rad", **truth_units(source.true_model(catalogue), catalogue)}
    units = {path: units[path] for path in source.truth}
    listed = columns({name: CHANNEL_UNITS[name] for name in source.channels}, units)
    about = {"name": source.name, "sampling_rate": source.sampling_rate, "sampling_rate_unit": "Hz",
             "units": {each.name: each.unit for each in listed}, "engine": source.engine, "seed": source.seed,
             "source_content_hash": source.content_hash, "origin": "synthetic", "split_seed": seed,
             "shares": dict(zip(SPLITS, map(float, shares), strict=True)), "versions": dict(source.versions)}
    return Plan(group, [place[name] for name in group], listed, about)


@contextmanager
def new_folder(path: str | Path) -> Iterator[Path]:
    """A folder beside `path` to fill; renamed to `path` on success, removed on any failure. InputProblem if it exists."""
    target = Path(path)
    if target.exists():
        raise InputProblem(path, "exists already", "remove it, or choose another name with -o")
    try:
        temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part"))
    except OSError as problem:
        raise InputProblem(path, f"cannot be made ({problem.strerror})", "choose another place with -o") from None
    try:
        yield temporary
        temporary.chmod(0o755)
        os.rename(temporary, target)
    except OSError as problem:
        raise InputProblem(path, f"cannot be written ({problem.strerror or problem})",
                           "free some space, or choose another place with -o") from None
    except MemoryError:
        raise InputProblem(path, "memory is at an end", "end other programs, or take a machine with more") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_shards(source: Any, folder: Path, planned: Plan, labelled: Labelled,
                 progress: Callable[[int, int], None] | None = None) -> dict[str, dict[str, int]]:
    """Write every run into `folder`/data; returns split -> file name -> rows.

    labelled(index, recording): the `label` columns of a run.
    """
    target = folder / DATA
    target.mkdir()
    schema = arrow_schema(planned.columns, planned.about)
    longest = _longest(source)
    totals = Counter(planned.split)
    writers = {name: ShardWriter(target, name, planned.columns, schema, totals[name], longest * 4 * len(source.channels))
               for name in SPLITS if totals[name]}
    try:
        for index, recording in enumerate(source):
            row = _row(source, planned, index, recording)
            writers[planned.split[index]].add(row | dict(labelled(index, recording)))
            if progress:
                progress(index + 1, len(source))
        for writer in writers.values():
            writer.close()
    finally:
        for writer in writers.values():
            writer.abandon()
    return {name: writer.written for name, writer in writers.items()}


def _longest(source: Any) -> int:
    """Samples of the longest run, from the conditions."""
    speeds = np.asarray(source.conditions["spindle_speed"], float)
    passes = sum(np.asarray(source.conditions[name], float) for name in ("idle_passes", "passes", "ring_down_passes"))
    return math.ceil(float(np.max(passes * 2 * math.pi / (source.flutes * speeds))) * source.sampling_rate) + 1


def _row(source: Any, planned: Plan, index: int, recording: Recording) -> dict[str, Any]:
    row: dict[str, Any] = {"run": int(source.scenario_run[index]), "group": planned.group[index]}
    row |= {name: values[index].item() for name, values in source.conditions.items()}
    row |= {"flutes": source.flutes, "sampling_rate": recording.sampling_rate, "start": recording.start}
    row |= {name: np.asarray(values, np.float32) for name, values in recording.channels.items()}
    row |= {"marks": recording.marks, "pass_times": recording.pass_times}
    row |= {truth_column(path): given(values[index]) for path, values in source.truth.items()}
    row |= {f"noise_{name}": given(source.noise[name][index]) if name in source.noise else None
            for name in source.channels}
    return row | {"outcome": str(recording.outcome), "outcome_time": given(recording.outcome_time)}


def given(value: Any) -> float | None:
    """A number, or None for NaN: a null says `there is none`, which a NaN leaves open."""
    number = float(value)
    return None if math.isnan(number) else number


def write_manifest(folder: Path, planned: Plan, written: Mapping[str, Mapping[str, int]],
                   more: Mapping[str, Any]) -> dict[str, Any]:
    """Write `export.json`: columns, splits, the shards with their rows and SHA-256, and `more`; returns its content."""
    shards = {f"{DATA}/{name}": {"split": split, "rows": rows, "bytes": (folder / DATA / name).stat().st_size,
                                 "sha256": file_hash(folder / DATA / name)}
              for split, files in written.items() for name, rows in files.items()}
    content = {"format": FORMAT, "about": dict(planned.about), "splits": planned.counts(), "shards": shards,
               "columns": [vars(each) for each in planned.columns], **more}
    content["hash"] = manifest_hash(content)
    (folder / MANIFEST).write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return content


def manifest_hash(content: Mapping[str, Any]) -> str:
    """SHA-256 of what `export.json` says, apart from this."""
    said = json.loads(json.dumps({key: value for key, value in content.items() if key != "hash"}))  # keys as in the file
    return sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def file_hash(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal, read a piece at a time."""
    digest = sha256()
    with path.open("rb") as stream:
        while piece := stream.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()
