"""What was read, before anything is fitted: record by record, in SI units."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbed.api.believed import DataLike, File
from testbed.api.quantity import Quantity
from testbed.api.result import Result, Table, plain, shown_here
from testbed.api.watch import Progress
from testbed.api.working import working
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbed.analysis.records.inspection import Inspection as Seen
    from testbed.analysis.records.record_report import RecordReport

FASTEST = 1e9  # Hz: no recorder of vibration comes near it


@dataclass(frozen=True, repr=False, eq=False)
class Inspection(Result):
    """A campaign, a data set or a bare file, as it was read.

    records: a report of each (name, kind, recording, channels, conditions, speed_found, segments, noise, lines, chatter,
    notes); none of what `testbed export` wrote. total: how many there are. columns: name -> unit, of a
    bare file. notes: on the whole; each record has its own.
    """

    path: Path
    total: int
    records: tuple[RecordReport, ...]
    columns: Mapping[str, str]
    notes: tuple[str, ...]
    said: Mapping[str, Any] = field(repr=False)

    def record(self, name: str) -> RecordReport:
        """The report of one record; KeyError where there is none of that name."""
        for one in self.records:
            if one.name == name:
                return one
        raise KeyError(name)

    def plot(self, name: str | None = None) -> Figure:
        """One record, by default the first: its channels over time with the segments shaded, and its spectrum."""
        from testbed.analysis.records.inspection_plot import draw

        if not self.records:
            raise InputProblem(self.path, "holds no record to be drawn", "give its sampling rate")
        return shown_here(draw(self.records[0] if name is None else self.record(name)))  # type: ignore[no-any-return]

    def save_plots(self, folder: File, progress: Progress = None) -> list[Path]:
        """Draw every record as PNG and SVG into a folder that is there; the paths written."""
        from testbed.analysis.records.inspection_plot import save

        written: list[Path] = []
        with working(progress) as watch, watch.counted("drawing") as tell:
            for number, record in enumerate(self.records, 1):
                written += save(record, Path(folder))
                tell(number, len(self.records))
        return written

    def _answer(self) -> Mapping[str, Any]:
        return self.said

    def _table(self) -> Table:
        def stated(one: RecordReport, name: str) -> float:
            return float(one.conditions.get(name) or "nan")

        records = self.records
        return Table("name", {
            "name": [one.name for one in records], "kind": [one.kind for one in records],
            "samples": [len(one.recording) for one in records],
            "sampling_rate": [one.recording.sampling_rate for one in records],
            "channels": [", ".join(one.channels) for one in records],
            "spindle_speed": [stated(one, "spindle_speed") for one in records],
            "speed_found": [one.speed_found if one.speed_found is not None else float("nan") for one in records],
            "axial_depth_of_cut": [stated(one, "axial_depth_of_cut") for one in records],
            "noise": [one.noise.rms if one.noise is not None and one.noise.known else float("nan") for one in records],
            "chatter": [one.chatter.verdict if one.chatter is not None else None for one in records],
        }, {"sampling_rate": "Hz", "spindle_speed": "rad/s", "speed_found": "rad/s", "axial_depth_of_cut": "m"})

    def _headline(self) -> str:
        some = f", the first {len(self.records)} looked at" if 0 < len(self.records) < self.total else ""
        return f"{self.path}, {self.total} records{some}"


def inspect(data: DataLike, *, folder: File | None = None, rate: Quantity | None = None, records: int = 12) -> Inspection:
    """Look over what was measured or simulated: channels, units, conditions, speed, segments, noise floor, chatter.

    data: a campaign.yaml, a data set (a file or a folder of shards), one measured file of any format, or what `testbed export`
    wrote; or what testbed.load made of one. folder: where a campaign's files are, if not beside it. rate: sampling rate of a
    bare file that states none, `"12800 Hz"` or Hz. records: how many records of a data set to look at. Raises InputProblem.
    """
    hertz = None if rate is None else sampling_rate(rate, "rate")
    with working():
        if isinstance(data, (str, os.PathLike)) and is_exported(data):
            from testbed.exports.reading import describe

            said = plain(describe(os.fspath(data)))
            return Inspection(Path(data), said["runs"], (), {one["name"]: one["unit"] for one in said["columns"]}, (), said)
        found = _seen(data, folder, hertz, records)
        return Inspection(found.path, found.total, found.records, found.columns, found.notes, found.as_json())


def _seen(data: DataLike, folder: File | None, hertz: float | None, most: int) -> Seen:
    from testbed.analysis.records.inspection import inspect as looked_over
    from testbed.analysis.records.inspection import inspect_campaign, inspect_data_set
    from testbed.files.campaign import Campaign

    if isinstance(data, (str, os.PathLike)):
        return looked_over(Path(data), folder=None if folder is None else Path(folder), sampling_rate=hertz, most=most)
    return inspect_campaign(data) if isinstance(data, Campaign) else inspect_data_set(data, data.path, most)


def sampling_rate(given: Quantity, name: str) -> float:
    """A sampling rate in Hz. InputProblem names what was given."""
    from testbed.api.quantity import si_number
    from testbed.units import UnitProblem, parse_sampling_rate

    try:
        hertz = parse_sampling_rate(given) if isinstance(given, str) else si_number(given, name, "Hz")
    except UnitProblem as problem:
        raise InputProblem(name, problem.what, problem.do) from None
    if not 0.0 < hertz <= FASTEST:
        raise InputProblem(name, f"'{given}' must be above 0 and at most {FASTEST:g} Hz", "correct the value")
    return hertz


def is_exported(data: File) -> bool:
    """True for what `testbed export` wrote; a file of another kind is not opened for it."""
    place = Path(data)
    if not place.is_dir() and place.suffix != ".parquet":
        return False
    from testbed.exports.reading import is_export

    return is_export(place)
