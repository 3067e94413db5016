"""From a table to a recording: channels in SI, an even time base, the marks of the tachometer, and what was noticed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from testbed.files.door import room
from testbed.problem import InputProblem
from testbed.readers import checks, tachometer
from testbed.readers.bridge import bridged, unmeasured
from testbed.readers.calibrate import unit_of
from testbed.readers.sampling import time_base
from testbed.readers.source import Source, base_name
from testbed.readers.table import NO_SPECTRA, Table, listed
from testbed.readers.timebase import TimeBase
from testbed.recording import Recording

_AT_WORK = 20  # columns' worth of intermediate results that any look at a record takes: the spectrum of four times its length


def assemble(
    table: Table,
    sources: Mapping[str, Source],
    *,
    time: Source | None | Literal["none"] = None,
    sampling_rate: float | None = None,
    start: float | None = None,
    stop: float | None = None,
    optional: tuple[str, ...] = (),
    conditions: Mapping[str, Any] | None = None,
) -> tuple[Recording, tuple[str, ...]]:
    """A measured recording from `table`, with notes.

    sources: channel -> Source. time: a Source for the time column, "none" to ignore one, None to look for one.
    sampling_rate in Hz, start and stop in s of the file's own time. optional: channels that may be missing.
    Raises InputProblem for everything that would make the numbers wrong.
    """
    path, notes = table.path, list(table.notes)
    columns, sources = _columns(table, sources, optional, notes)
    checks.equal_lengths(path, columns)
    room(path, 8.0 * (len(columns) + _AT_WORK) * max(map(len, columns.values())))  # bytes a number
    labels = tuple(table.find(source.column) for source in sources.values())
    base, columns, base_notes = time_base(table, columns, time, sampling_rate, start, stop, labels)
    notes += base_notes
    channels, units, wrong = _channels(table, columns, sources, base, optional, notes)
    filled = np.empty(0, dtype=int)
    if base.dropped:
        channels, wrong, filled = _filled(path, channels, wrong, base, notes)
    repeats = checks.repeated_samples(
        [values for name, values in channels.items() if base_name(name) != "tachometer"] or list(channels.values())
    )
    if repeats:
        notes.append(
            f"{repeats} of {len(next(iter(channels.values())))} samples repeat the one before: samples may be doubled"
        )
    channels = {name: bridged(values, wrong[name]) for name, values in channels.items()}
    filled = np.union1d(filled, np.flatnonzero(np.any(list(wrong.values()), axis=0)))
    found, pulses = np.empty(0), 1
    if "tachometer" in channels:
        source = sources["tachometer"]
        found, pulses, more = tachometer.marks(
            channels["tachometer"],
            base.sampling_rate,
            base.start,
            rising=source.edge == "rising",
            pulses_per_revolution=source.pulses_per_revolution,
        )
        notes += more
    facts = dict(conditions or {})
    notes += checks.speed_notes(facts.get("spindle_speed"), tachometer.speed(found), "tachometer")
    recording = Recording(
        channels,
        base.sampling_rate,
        {name: units[name] for name in channels},
        "measured",
        start=base.start,
        marks=found,
        conditions={**facts, "dropped_samples": sum(count for _, count in base.dropped), "repeated_samples": repeats},
        pulses_per_revolution=pulses,
        filled=filled,
        on_tool=tuple(name for name in channels if sources[name].on == "tool"),
    )
    return recording, tuple(dict.fromkeys(notes))


def _channels(
    table: Table,
    columns: dict[str, np.ndarray],
    sources: Mapping[str, Source],
    base: TimeBase,
    optional: tuple[str, ...],
    notes: list[str],
) -> tuple[dict[str, np.ndarray], dict[str, str], dict[str, np.ndarray]]:
    """Channels that carry a signal, in SI, their units, and which of their samples are not the motion's."""
    channels, units, wrong = {}, {}, {}
    for name, values in columns.items():
        factor, units[name] = unit_of(table, name, sources[name], notes)
        if base_name(name) != "tachometer" and name not in optional:
            checks.usable(table.path, name, values, base.sampling_rate, base.start)
        elif not np.isfinite(values).all() or len(values) < 2 or values.min() == values.max():
            bad = np.flatnonzero(~np.isfinite(values))
            why = f"sample {bad[0] + 1} is no number ({len(bad)} in all)" if 0 < len(bad) < len(values) else "no signal"
            notes.append(f"channel {name}: {why}, left out")
            continue
        full_scale = table.full_scale.get(table.find(sources[name].column))
        notes += checks.channel_notes(name, values, full_scale)
        channels[name] = values * factor
        wrong[name] = unmeasured(name, values, full_scale)
        if wrong[name].any():
            count = int(np.count_nonzero(wrong[name]))
            notes.append(f"channel {name}: {count} sample{'s' * (count > 1)} bridged from the neighbours and left out of fits")
    if not channels:
        raise InputProblem(table.path, "no channel with a signal", "check the columns named in `channels`")
    return channels, units, wrong


def _no_spectra(table: Table, wanted: list[str]) -> None:
    """Raises InputProblem where a wanted column, or all that the file holds, is no function of time."""
    every = [name for name in table.columns if name in table.spectra]
    named = [name for name in wanted if name in table.spectra] or (every[:1] if len(every) == len(table.columns) else [])
    if named:
        what = f"'{named[0]}' is {table.spectra[named[0]]}: {NO_SPECTRA}"
        raise InputProblem(table.path, what, "give the time record of the blow")


def _columns(
    table: Table, sources: Mapping[str, Source], optional: tuple[str, ...], notes: list[str]
) -> tuple[dict[str, np.ndarray], dict[str, Source]]:
    columns, kept = {}, {}
    _no_spectra(table, [str(source.column).strip() for source in sources.values()])
    for name, source in sources.items():
        try:
            columns[name] = table.columns[table.find(source.column)]
        except InputProblem as problem:
            if name not in optional:
                raise InputProblem(table.path, f"channel {name}: {problem.what}", problem.do) from None
            notes.append(f"channel {name}: {problem.what}, left out")
            continue
        kept[name] = source
    if not columns:
        raise InputProblem(
            table.path, "none of the channels is in the file", f"the file has {listed(table.columns)}"
        )
    return columns, kept


def _filled(
    path: Any, channels: dict[str, np.ndarray], wrong: dict[str, np.ndarray], base: TimeBase, notes: list[str]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]:
    """Missing samples put in by straight lines: channels, what is wrong of them, and the places of what was put in.

    Raises InputProblem where too much is missing for that.
    """
    missing = sum(count for _, count in base.dropped)
    rows = len(next(iter(channels.values())))
    longest = max(base.dropped, key=lambda gap: gap[1])
    if missing > 0.002 * rows or longest[1] > 8:
        raise InputProblem(
            path,
            f"{missing} samples are missing, {longest[1]} of them after row {longest[0]} "
            f"({base.start + longest[0] / base.sampling_rate:.6g} s)",
            "read the even part with from/to, or measure again",
        )
    places = np.arange(rows, dtype=float)
    for row, count in base.dropped:
        places[row:] += count
    even = np.arange(math.floor(places[-1]) + 1)
    notes.append("the missing samples were filled with straight lines")
    moved = {name: np.isin(even, places[mask]) for name, mask in wrong.items()}
    return {name: np.interp(even, places, values) for name, values in channels.items()}, moved, np.setdiff1d(even, places)
