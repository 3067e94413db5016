"""From a table to a recording: channels in SI, an even time base, the marks of the tachometer, and what was noticed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from testbed.problem import InputProblem
from testbed.readers import checks, tachometer
from testbed.readers.bridge import bridged, unmeasured
from testbed.readers.source import Source, base_name
from testbed.readers.table import Table
from testbed.readers.timebase import TimeBase, from_column, is_no_time, looks_like_time, repetition, settle
from testbed.recording import CHANNEL_UNITS, Recording
from testbed.units import UnitProblem, channel_unit, unit_named

_UNCALIBRATED = ("V", "rad", "1")


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
    base, columns, base_notes = _time_base(table, columns, time, sampling_rate, start, stop)
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
        factor, units[name] = _unit(table, name, sources[name], notes)
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


def _columns(
    table: Table, sources: Mapping[str, Source], optional: tuple[str, ...], notes: list[str]
) -> tuple[dict[str, np.ndarray], dict[str, Source]]:
    columns, kept = {}, {}
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
            table.path, "none of the channels is in the file", f"the file has {', '.join(table.columns)}"
        )
    return columns, kept


def _time_base(
    table: Table,
    columns: dict[str, np.ndarray],
    time: Source | None | Literal["none"],
    stated: float | None,
    start: float | None,
    stop: float | None,
) -> tuple[TimeBase, dict[str, np.ndarray], list[str]]:
    """The time base and the columns within from/to, each stored sample once."""
    notes: list[str] = []
    label = None if time == "none" else table.find(time.column) if isinstance(time, Source) else table.time_column()
    rows = len(next(iter(columns.values())))
    moments, seconds = None, 1.0
    if label is not None:
        seconds = _time_factor(table, label, time if isinstance(time, Source) else None, notes)
        moments = table.columns[label] * seconds
        if len(moments) != rows:
            raise InputProblem(
                table.path,
                f"time column '{label}' has {len(moments)} rows, the channels {rows}",
                "the file was cut off: measure or export it again",
            )
        if not isinstance(time, Source) and stated is not None and is_no_time(table.columns[label], stated):
            notes.append(f"column '{label}' counts samples or is no time; the sampling rate of campaign.yaml was taken")
            moments, label = None, None
    factor, phase = repetition(list(columns.values()))
    if factor > 1:
        columns = {name: values[phase::factor] for name, values in columns.items()}
        moments = moments[phase::factor] if moments is not None else None
    if moments is not None and label is not None:
        inside = _window(moments, start, stop)
        moments, columns = moments[inside], {name: values[inside] for name, values in columns.items()}
        if len(moments) < 2:
            raise InputProblem(
                table.path,
                f"no samples between from = {start} and to = {stop}",
                "the record's time is that of the file",
            )
        column = from_column(table.path, moments, label)
        if factor > 1 and stated is not None and abs(stated / factor / column.sampling_rate - 1) < 2e-3:
            stated = stated / factor
        in_file = None if table.sampling_rate is None or factor > 1 else table.sampling_rate
        base = settle(table.path, stated, in_file, table.rate_tolerance, column, (label, seconds))
    else:
        base = _stated_base(table, stated)
        base = replace(base, sampling_rate=base.sampling_rate / factor, start=phase / base.sampling_rate)
        inside = _window(base.start + np.arange(len(next(iter(columns.values())))) / base.sampling_rate, start, stop)
        columns = {name: values[inside] for name, values in columns.items()}
        base = replace(base, start=base.start + (inside.start or 0) / base.sampling_rate)
    if factor > 1:
        notes.append(
            f"every sample is stored {'twice' if factor == 2 else f'{factor} times'}: kept once, the true "
            f"sampling rate is "
            f"{base.sampling_rate:.7g} Hz"
        )
    return base, columns, [*notes, *base.notes]


def _stated_base(table: Table, stated: float | None) -> TimeBase:
    try:
        return settle(table.path, stated, table.sampling_rate, table.rate_tolerance, None)
    except InputProblem as problem:
        for label, values in table.columns.items():
            step = looks_like_time(values)
            if step is not None and stated is None and table.sampling_rate is None:
                raise InputProblem(
                    table.path,
                    f"no sampling rate; column '{label}' rises evenly by {step:.6g}",
                    f"if it is time write `time: {{column: {label}, unit: s}}` under `channels`, else give "
                    "`sampling_rate`",
                ) from None
        raise problem


def _time_factor(table: Table, label: str, source: Source | None, notes: list[str]) -> float:
    """Seconds per unit of the time column. Raises InputProblem for a unit that is no time."""
    text = (source.unit if source and source.unit else None) or table.units.get(label, "")
    if not text:
        suffix = label.rpartition("_")[2]
        text = suffix if suffix in ("ms", "us", "s", "min") else "s"
        if text != "s" or source is not None:
            notes.append(f"time column '{label}' was read as {text}")
    try:
        unit = unit_named(text)
    except UnitProblem as problem:
        raise InputProblem(
            table.path, f"time column '{label}': {problem.what}", "give its unit as s, ms or us"
        ) from None
    if unit.si != "s":
        raise InputProblem(
            table.path,
            f"time column '{label}' is in {text}, which is no time",
            "name the right column, or `time: none`",
        )
    return unit.factor * (source.scale if source else 1.0)


def _window(moments: np.ndarray, start: float | None, stop: float | None) -> slice:
    """Rows with start <= time < stop; a NaN time or one running back is left for the checks to say."""
    first = 0 if start is None else int(np.searchsorted(moments, start - 1e-12, side="left"))
    last = len(moments) if stop is None else int(np.searchsorted(moments, stop - 1e-12, side="left"))
    return slice(first, last)


def _unit(table: Table, name: str, source: Source, notes: list[str]) -> tuple[float, str]:
    """Factor to SI and the SI unit of a channel; its own unit where it is uncalibrated."""
    wanted = CHANNEL_UNITS.get(base_name(name), "1")
    in_file = table.units.get(table.find(source.column), "")
    text = source.unit if source.unit is not None else in_file
    if not text and base_name(name) == "tachometer":
        return source.scale, "V"
    if not text:
        raise InputProblem(
            table.path,
            f"channel {name}: no unit, neither in campaign.yaml nor in the file",
            f"give `unit: {wanted}`, or `unit: V` for an uncalibrated channel",
        )
    try:
        unit = channel_unit(text)
    except UnitProblem as problem:
        raise InputProblem(table.path, f"channel {name}: {problem.what}", problem.do) from None
    if source.unit is not None and in_file:
        _compare_units(name, source, in_file, unit.si, unit.factor, notes)
    if unit.si == wanted:
        return unit.factor * source.scale, unit.si
    if unit.si in _UNCALIBRATED:
        if base_name(name) != "tachometer":
            shown = "arbitrary units" if unit.si == "1" else unit.si
            notes.append(f"channel {name} is uncalibrated: it stays in {shown}, and so do parameters that depend on it")
        return unit.factor * source.scale, unit.si
    if base_name(name) == "tachometer":
        return unit.factor * source.scale, unit.si
    raise InputProblem(
        table.path,
        f"channel {name}: a {base_name(name)} cannot be in {text}",
        f"give a unit of {wanted}, or V or rad for an uncalibrated channel",
    )


def _compare_units(name: str, source: Source, in_file: str, si: str, factor: float, notes: list[str]) -> None:
    """A note where the file's own unit is another than the campaign's; with a `scale` they may differ."""
    try:
        theirs = channel_unit(in_file)
    except UnitProblem:
        return
    if source.scale == 1.0 and (theirs.si, theirs.factor) != (si, factor):
        notes.append(
            f"channel {name}: campaign.yaml says {source.unit}, the file {in_file}; that of campaign.yaml was taken"
        )


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
