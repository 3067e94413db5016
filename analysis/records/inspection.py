"""What was read, before anything is fitted: a campaign, a data set or a bare file, record by record."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbed.analysis.records.record_report import RecordReport, report
from testbed.files.campaign import Campaign, load_campaign
from testbed.problem import InputProblem
from testbed.readers import checks, read_table
from testbed.readers.table import Table
from testbed.readers.timebase import TimeBase, from_column, looks_like_time
from testbed.recording import Recording
from testbed.sweeps.shards import NOTE

if TYPE_CHECKING:
    from testbed.store.data_set import DataSet

_MANIFESTS = (".yaml", ".yml")


@dataclass(frozen=True)
class Inspection:
    """All records of a campaign, a data set or a bare file. total: how many it has, where not all were looked at.

    time: of a bare file, the column that is its time; rate: its sampling rate (Hz), where it is known.
    """

    name: str
    path: Path
    records: tuple[RecordReport, ...]
    total: int
    columns: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    time: str | None = None
    rate: float | None = None

    def as_json(self) -> dict[str, Any]:
        """SI values, for `--json`."""
        return {
            "name": self.name,
            "file": str(self.path),
            "total": self.total,
            "columns": dict(self.columns),
            "notes": list(self.notes),
            "records": [record.as_json() for record in self.records],
        }


def inspect(
    path: str | Path, *, folder: str | Path | None = None, sampling_rate: float | None = None, most: int = 12
) -> Inspection:
    """Look over a campaign.yaml, a data set of `testbed run` (a file or a folder of shards), or a bare file of any format.

    folder: where a campaign's files are. sampling_rate (Hz): of a bare file that states none. most: records of a data
    set to look at. Raises InputProblem.
    """
    path = Path(path)
    if path.suffix.lower() in _MANIFESTS:
        return inspect_campaign(load_campaign(path, folder))
    from testbed.store.data_set import is_data_set, read_data_set

    if is_data_set(path) or (path / NOTE).is_file():  # a file, or a folder of shards, also an unfinished one, which says so
        return inspect_data_set(read_data_set(path), path, most)
    return _bare(path, sampling_rate)


def inspect_campaign(campaign: Campaign) -> Inspection:
    """Look over the records of a campaign."""
    reports = tuple(report(record.recording, record.name, record.kind, record.notes) for record in campaign.records)
    return Inspection(campaign.name, campaign.file, reports, len(reports))


def inspect_data_set(data: DataSet, path: Path, most: int) -> Inspection:
    """Look over at most so many runs of a data set."""
    some = itertools.islice(data.recordings(0, most), most)
    reports = tuple(
        report(recording, f"run {recording.conditions.get('run', index)}", "cut", ())
        for index, recording in enumerate(some)
    )
    return Inspection(data.name, path, reports, len(data))


def _bare(path: Path, sampling_rate: float | None) -> Inspection:
    """A file without a manifest: its columns as they are, and their time if the file gives one."""
    table = read_table(path)
    columns = {name: table.units.get(name, "") for name in table.columns}
    base, label, notes = _bare_time(table, sampling_rate)
    if base is None:
        return Inspection(path.stem, path, (), 0, columns, (*table.notes, *notes), label)
    channels = {name: values for name, values in _same_length(table) if name != label and np.isfinite(values).all()}
    notes += [_why_not(name, values) for name, values in table.columns.items() if name not in channels and name != label]
    if not channels:
        return Inspection(path.stem, path, (), 0, columns, (*table.notes, *notes), label, base.sampling_rate)
    recording = Recording(
        channels, base.sampling_rate, {name: columns[name] for name in channels}, "measured", start=base.start
    )
    more = [note for name, values in channels.items() for note in checks.channel_notes(name, values)]
    whole = report(recording, path.stem, "file", tuple(more))
    return Inspection(path.stem, path, (whole,), 1, columns, (*table.notes, *notes, *base.notes), label, base.sampling_rate)


def _why_not(name: str, values: np.ndarray) -> str:
    """Why a column is not looked at."""
    empty = np.flatnonzero(~np.isfinite(values))
    if not empty.size:
        return f"{name} is not looked at: it has another length than the longest"
    return (f"{name} is not looked at: {empty.size} of {len(values)} samples are no number, the first is sample "
            f"{empty[0] + 1}; mend the file, or read around it with from and to in a campaign.yaml")


def _same_length(table: Table) -> Iterator[tuple[str, np.ndarray]]:
    longest = max(len(values) for values in table.columns.values())
    return ((name, values) for name, values in table.columns.items() if len(values) == longest)


def _bare_time(table: Table, stated: float | None) -> tuple[TimeBase | None, str | None, list[str]]:
    """Time base, the time column's name and notes; None where nothing says what the time is."""
    label = table.time_column()
    if stated is not None:
        return TimeBase(stated, 0.0), label, []
    if label is not None:
        factor = {"ms": 1e-3, "us": 1e-6, "min": 60.0}.get(table.units.get(label, ""), 1.0)
        try:
            return from_column(table.path, table.columns[label] * factor, label), label, []
        except InputProblem as problem:
            return None, label, [f"{problem.what}: {problem.do}"]
    if table.sampling_rate is not None:
        return TimeBase(table.sampling_rate, 0.0, ("the sampling rate was taken from the file",)), None, []
    first = next(iter(table.columns))
    step = looks_like_time(table.columns[first])
    if step is not None and step < 0.05 and len(table.columns) > 1:
        base = from_column(table.path, table.columns[first], first)
        taken = f"taken for time in s, {base.sampling_rate:.7g} Hz; say so in a campaign.yaml"
        note = f"column '{first}' rises evenly by {step:.6g}: {taken}"
        return base, first, [note]
    return None, None, ["nothing says what the sampling rate is: give --rate, or a campaign.yaml"]
