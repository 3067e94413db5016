"""The even time base of a table's columns: from its time column, its header or campaign.yaml, within from and to."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from testbed.problem import InputProblem
from testbed.readers.calibrate import time_factor
from testbed.readers.source import Source
from testbed.readers.table import NO_SPECTRA, Table
from testbed.readers.timebase import TimeBase, from_column, is_no_time, looks_like_time, repetition, settle


def time_base(
    table: Table,
    columns: dict[str, np.ndarray],
    time: Source | None | Literal["none"],
    stated: float | None,
    start: float | None,
    stop: float | None,
    labels: tuple[str, ...] = (),
) -> tuple[TimeBase, dict[str, np.ndarray], list[str]]:
    """The time base and the columns within from/to, each stored sample once. labels: the columns' names in the table."""
    notes: list[str] = []
    label = None if time == "none" else table.find(time.column) if isinstance(time, Source) else _time_label(table, labels)
    columns = _without_empty_end(columns)
    rows = len(next(iter(columns.values())))
    moments, seconds = None, 1.0
    if label is not None:
        seconds = time_factor(table, label, time if isinstance(time, Source) else None, notes)
        moments = table.columns[label] * seconds
        moments = moments[:rows] if len(moments) > rows and np.isnan(moments[rows:]).all() else moments
        if len(moments) != rows:
            raise InputProblem(
                table.path,
                f"time column '{label}' has {len(moments)} rows, the channels {rows}",
                "the file was cut off: measure or export it again",
            )
        if not isinstance(time, Source) and stated is not None and is_no_time(table.columns[label], stated):
            notes.append(f"column '{label}' counts samples or is no time; the sampling rate of campaign.yaml was taken")
            moments, label = None, None
        elif label in table.clocks and (stated or table.sampling_rate) and np.mean(np.diff(moments) == 0) > 0.5:
            notes.append(f"column '{label}' tells the time of day too coarsely: the sampling rate stated was taken")
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


def _time_label(table: Table, labels: tuple[str, ...]) -> str | None:
    """The time column that the wanted columns share. Raises InputProblem where each has one of its own and they differ."""
    times = list(dict.fromkeys(table.time_column(label) for label in labels or (None,)))
    first = table.columns[times[0]] if times[0] is not None else np.empty(0)
    step = np.nanmedian(np.abs(np.diff(first))) if len(first) > 1 else 0.0
    for other in times[1:]:
        own = table.columns[other] if other is not None else np.empty(0)
        if len(own) != len(first) or not np.allclose(own, first, rtol=1e-9, atol=0.1 * step, equal_nan=True):
            raise InputProblem(
                table.path,
                f"the channels have times of their own that differ ('{times[0]}' and '{other}')",
                "name channels of one of them, or `time: none` with `sampling_rate`",
            )
    return times[0]


def _without_empty_end(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns without the rows at the end that are empty in all of them: others of the table are longer."""
    filled = np.flatnonzero(np.any([~np.isnan(values) for values in columns.values()], axis=0))
    end = filled[-1] + 1 if len(filled) else len(next(iter(columns.values())))
    return {name: values[:end] for name, values in columns.items()}


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
                    f"`sampling_rate`; if it is a frequency, {NO_SPECTRA}",
                ) from None
        raise problem


def _window(moments: np.ndarray, start: float | None, stop: float | None) -> slice:
    """Rows with start <= time < stop; a NaN time or one running back is left for the checks to say."""
    first = 0 if start is None else int(np.searchsorted(moments, start - 1e-12, side="left"))
    last = len(moments) if stop is None else int(np.searchsorted(moments, stop - 1e-12, side="left"))
    return slice(first, last)
