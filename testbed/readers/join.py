"""Channels of one record that stand in several files: brought together where the files show the same instants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

from testbed.problem import InputProblem
from testbed.readers.calibrate import time_factor
from testbed.readers.source import Source
from testbed.readers.table import NO_SPECTRA, Table
from testbed.readers.timebase import TimeBase, from_column

_SAME_INSTANT = 0.5  # of a step, that two files may begin apart
_DRIFT = 0.5  # of a step, that two rates may differ by at the end of the record


def joined(
    table: Table, sources: Mapping[str, Source], others: Mapping[str, Table], time: Source | None | Literal["none"]
) -> tuple[Table, dict[str, Source]]:
    """The record's table with the columns of other files, and the sources that name them there.

    others: channel -> the table of its file, which may be the record's. Raises InputProblem where a file has another number
    of samples, another rate or another first time than the record's.
    """
    found = dict(sources)
    mine = None if time == "none" else _clock(table, time)
    rows = max(len(values) for values in table.columns.values())
    columns, units, full_scale = dict(table.columns), dict(table.units), dict(table.full_scale)
    notes = list(table.notes)
    own = table
    for channel, other in others.items():
        if other is own:
            continue
        column = other.find(sources[channel].column)
        if column in other.spectra:
            raise InputProblem(other.path, f"'{column}' is {other.spectra[column]}: {NO_SPECTRA}", "give the time record")
        if len(other.columns[column]) != rows:
            raise InputProblem(
                other.path,
                f"channel {channel} has {len(other.columns[column])} samples, {table.path.name} {rows}",
                "channels of one record are sampled together: give files of one length",
            )
        theirs = None if time == "none" else _clock(other, time)
        if mine is not None and theirs is not None:
            _same_clock(table, other, mine, theirs, rows)
        elif theirs is not None:
            mine = theirs
            table = replace(table, sampling_rate=theirs.sampling_rate, rate_tolerance=theirs.error)
        label = f"{other.path.name}: {column}"
        columns[label], units[label] = other.columns[column], other.units.get(column, "")
        if column in other.full_scale:
            full_scale[label] = other.full_scale[column]
        notes += [f"{other.path.name}: {note}" for note in other.notes]
        found[channel] = replace(sources[channel], column=label)
    return replace(table, columns=columns, units=units, full_scale=full_scale, notes=tuple(dict.fromkeys(notes))), found


def _clock(table: Table, time: Source | None | Literal["none"]) -> TimeBase | None:
    """When a file's samples were taken, by its time column or its header; None where it does not say."""
    label = table.find(time.column) if isinstance(time, Source) else table.time_column()
    if label is not None:
        seconds = time_factor(table, label, time if isinstance(time, Source) else None, [])
        return from_column(table.path, table.columns[label] * seconds, label)
    return None if table.sampling_rate is None else TimeBase(table.sampling_rate, float("nan"), error=table.rate_tolerance)


def _same_clock(table: Table, other: Table, mine: TimeBase, theirs: TimeBase, rows: int) -> None:
    off = abs(mine.sampling_rate / theirs.sampling_rate - 1)
    if off > max(2 * (mine.error + theirs.error), _DRIFT / rows):
        raise InputProblem(
            other.path,
            f"sampled at {theirs.sampling_rate:.7g} Hz, {table.path.name} at {mine.sampling_rate:.7g} Hz",
            "channels of one record are sampled together: resample one file, or set `time: none` with `sampling_rate`",
        )
    apart = abs(mine.start - theirs.start)  # not a number where a header gives the rate alone
    if apart > _SAME_INSTANT / mine.sampling_rate + 2 * rows / mine.sampling_rate * (mine.error + theirs.error):
        raise InputProblem(
            other.path,
            f"begins at {theirs.start:.6g} s, {table.path.name} at {mine.start:.6g} s",
            "cut both files at the same time, or set `time: none` with `sampling_rate` where both begin together",
        )
