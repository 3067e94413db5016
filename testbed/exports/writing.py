"""From a data set to a folder of Parquet shards: one pass over the runs, the folder appears whole or not at all."""

from __future__ import annotations

import json
import math
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from testbed.exports.groups import SPLITS, groups_of, machines_of, split_of
from testbed.exports.schema import FORMAT, Column, arrow_schema, columns, truth_column
from testbed.exports.shards import ShardWriter
from testbed.exports.windows import Windowing, labelled, ratio_of, resampled, windows_of
from testbed.problem import InputProblem
from testbed.recording import CHANNEL_UNITS, Recording
from testbed.store.store import truth_units

MANIFEST = "export.json"
DATA = "data"
Labelled = Callable[[int, Recording], Mapping[str, Any]]
SPLIT_BY = ("condition", "machine")


@dataclass(frozen=True)
class Order:
    """What is asked for. shares: of train, validation, test; seed: of the division; by: what a split keeps together, one of
    SPLIT_BY; windows: a row is one, None: a run; rate: of the signals (Hz), None: as they were recorded."""

    shares: Sequence[float]
    seed: int = 0
    by: str = "condition"
    windows: Windowing | None = None
    rate: float | None = None


@dataclass(frozen=True)
class Plan:
    """What goes where: condition, machine, group and split of every run (runs,), the columns, what is told of the source."""

    condition: list[str]
    machine: list[str]
    group: list[str]
    split: list[str]
    columns: tuple[Column, ...]
    about: Mapping[str, Any]
    order: Order

    def counts(self) -> dict[str, dict[str, int]]:
        """Runs and groups of each split, in order."""
        return {name: {"runs": self.split.count(name),
                       "groups": len({group for group, split in zip(self.group, self.split, strict=True) if split == name})}
                for name in SPLITS}


def plan(source: Any, catalogue: Mapping[str, Any], order: Order) -> Plan:
    """Divide a DataSet. catalogue: the effects, for the units of their parameters. InputProblem where it cannot be done."""
    condition = groups_of(source.conditions, source.flutes)
    machine = machines_of(source.truth, _of_record(catalogue), source.flutes)
    group = {"condition": condition, "machine": machine}[order.by]
    if len(set(group)) == 1 and len(group) > 1:
        raise InputProblem(source.path, f"all its runs are of one {order.by}: there is nothing to hold out",
                           f"split by {SPLIT_BY[1 - SPLIT_BY.index(order.by)]}")
    rate = order.rate or source.sampling_rate
    _feasible(source, order, rate)
    place = {name: split_of(name, order.shares, order.seed) for name in set(group)}
    units = {"mark_angle": "rad", **truth_units(source.true_model(catalogue), catalogue)}
    units = {path: units[path] for path in source.truth}
    listed = columns({name: CHANNEL_UNITS[name] for name in source.channels}, units, order.windows is not None)
    about = {"name": source.name, "sampling_rate": rate, "sampling_rate_unit": "Hz",
             "units": {each.name: each.unit for each in listed}, "engine": source.engine, "seed": source.seed,
             "source_content_hash": source.content_hash, "origin": "synthetic", "split_seed": order.seed, "split_by": order.by,
             "shares": dict(zip(SPLITS, map(float, order.shares), strict=True)), "versions": dict(source.versions)}
    if order.windows is not None:
        about["window"] = vars(order.windows)
    if rate != source.sampling_rate:
        about["recorded_at"] = source.sampling_rate
    return Plan(condition, machine, group, [place[name] for name in group], listed, about, order)


def _of_record(catalogue: Mapping[str, Any]) -> list[str]:
    """Paths of true values that are a record's own and say nothing of its machine: the tachometer's mark, an effect's phase."""
    return ["mark_angle", *(f"{name}.{one.name}" for name, effect in catalogue.items() for one in effect.parameters
                            if one.each_record)]


def _feasible(source: Any, order: Order, rate: float) -> None:
    if ratio_of(rate, source.sampling_rate) is None:
        raise InputProblem(source.path, f"was sampled at {source.sampling_rate:g} Hz and is not brought to {rate:g} Hz",
                           "give a lower --rate that is to it as two whole numbers up to 1000")
    most = longest(source, rate)
    if order.windows is not None and order.windows.length > most:
        raise InputProblem(source.path, f"its longest run has {most} samples, too few for a window of "
                           f"{order.windows.length}", "give a shorter --window")


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


def write_shards(source: Any, folder: Path, planned: Plan, labels_of: Labelled,
                 progress: Callable[[int, int], None] | None = None,
                 seen: Callable[[int, Mapping[str, Any]], None] | None = None) -> dict[str, dict[str, int]]:
    """Write every run, or every window of it, into `folder`/data; returns split -> file name -> rows.

    labels_of(index, recording): the `label` columns of a run. seen(index, row): is shown every row as it is written.
    """
    target = folder / DATA
    target.mkdir()
    schema = arrow_schema(planned.columns, planned.about)
    windows, rate = planned.order.windows, planned.about["sampling_rate"]
    most = windows.length if windows else longest(source, rate)
    writers = {name: ShardWriter(target, name, planned.columns, schema, most * 4 * len(source.channels))
               for name in SPLITS if name in planned.split}
    try:
        for index, recording in enumerate(source):
            run = dict(labels_of(index, recording))
            run = _of_run(source, planned, index, recording) | run
            writer = writers[planned.split[index]]
            for row in _rows(run, resampled(recording, rate), windows):
                writer.add(row)
                if seen:
                    seen(index, row)
            if progress:
                progress(index + 1, len(source))
        for writer in writers.values():
            writer.close()
    finally:
        for writer in writers.values():
            writer.abandon()
    written = {name: writer.written for name, writer in writers.items()}
    if not any(written.values()):
        raise InputProblem(source.path, "holds no whole window", "give a shorter --window")
    return written


def _rows(run: Mapping[str, Any], recording: Recording, windows: Windowing | None) -> Iterator[dict[str, Any]]:
    """The row of a run, or those of its windows. run: the columns that all of them share."""
    kept = {name: np.asarray(values, np.float32) for name, values in recording.channels.items()}
    recording = replace(recording, channels=kept)
    if windows is None:
        yield {**run, **kept, "start": recording.start, "sampling_rate": recording.sampling_rate}
        return
    for own in windows_of(recording, windows):
        yield {**run, **own, **labelled(run, own["segment"]), "sampling_rate": recording.sampling_rate}


def longest(source: Any, rate: float) -> int:
    """Samples of the longest run at a rate (Hz), from the conditions."""
    speeds = np.asarray(source.conditions["spindle_speed"], float)
    passes = sum(np.asarray(source.conditions[name], float) for name in ("idle_passes", "passes", "ring_down_passes"))
    return math.ceil(float(np.max(passes * 2 * math.pi / (source.flutes * speeds))) * rate) + 1


def _of_run(source: Any, planned: Plan, index: int, recording: Recording) -> dict[str, Any]:
    row: dict[str, Any] = {"run": int(source.scenario_run[index]), "group": planned.group[index],
                           "condition_id": planned.condition[index], "machine_id": planned.machine[index]}
    row |= {name: values[index].item() for name, values in source.conditions.items()}
    row |= {"flutes": source.flutes, "marks": recording.marks, "pass_times": recording.pass_times}
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
    rows = {split: sum(files.values()) for split, files in written.items()}
    splits = {split: {**counts, "rows": rows.get(split, 0)} for split, counts in planned.counts().items()}
    content = {"format": FORMAT, "about": dict(planned.about), "splits": splits, "shards": shards,
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
