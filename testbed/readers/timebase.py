"""When the samples were taken: an even rate from a time column, a header or campaign.yaml, and rows stored repeatedly.

A time column is printed with few digits, so that its steps look uneven; a line is laid through it and judged against
the printed resolution. What is left over (gaps, jumps, a time that runs back) is an error with its row.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbed.problem import InputProblem
from testbed.readers.printed import resolution_of, slopes_within
from testbed.readers.table import bare_name, simplest_between

_FEW_WRONG = 0.01  # share of wrong stamps up to which the others tell the even grid
_UNEVEN = 0.02  # of a step, that a time may be off the even grid beyond its printed digits
_AGREE = 2e-3  # relative difference of two rates that counts as rounding; one known no better is not worth having


@dataclass(frozen=True)
class TimeBase:
    """sampling_rate (Hz), start (s, time of the first sample) and notes on how they were found.

    dropped: (row, missing samples) at each gap that was found. error: how far the rate may be off, relative, as the
    printed digits of the times leave it.
    """

    sampling_rate: float
    start: float
    notes: tuple[str, ...] = ()
    dropped: tuple[tuple[int, int], ...] = ()
    error: float = 0.0


def repetition(columns: list[np.ndarray]) -> tuple[int, int]:
    """(factor, phase) of rows that are stored `factor` times each; (1, 0) where they are not.

    A row counts as repeated when every column repeats; the changes must fall on one residue of the factor.
    """
    rows = len(columns[0])
    if rows < 16:
        return 1, 0
    changed = np.zeros(rows - 1, dtype=bool)
    for values in columns:
        changed |= (values[1:] != values[:-1]) & ~(np.isnan(values[1:]) & np.isnan(values[:-1]))
    places = np.flatnonzero(changed) + 1
    if len(places) < 8:
        return 1, 0
    for factor in range(20, 1, -1):
        residues = np.bincount(places % factor, minlength=factor)
        phase = int(np.argmax(residues))
        blocks = rows / factor
        if residues[phase] >= 0.998 * len(places) and len(places) >= 0.6 * blocks:
            return factor, phase
    return 1, 0


def from_column(path: Path, time: np.ndarray, label: str) -> TimeBase:
    """Rate and start from a column of times in s, shape (rows,).

    Raises InputProblem where it is no time: not finite, constant, running back, or uneven beyond its printed digits.
    """
    rows = len(time)
    bad = np.flatnonzero(~np.isfinite(time))
    if len(bad):
        raise InputProblem(
            path,
            f"time column '{label}' has {len(bad)} rows that are no number, the first is row {bad[0] + 1}",
            "mend the file, or give `sampling_rate` and `time: none`",
        )
    if rows < 2:
        raise InputProblem(path, f"time column '{label}' has {rows} row", "a record needs many samples")
    back = np.flatnonzero(time[1:] < time[:-1])
    if len(back):
        raise InputProblem(
            path,
            f"time column '{label}' runs back at row {back[0] + 2} ({time[back[0]]:.9g} to {time[back[0] + 1]:.9g} s)",
            "split the file there, or name the right time column",
        )
    span = time[-1] - time[0]
    if span <= 0:
        raise InputProblem(path, f"time column '{label}' does not advance", "name the right time column")
    resolution = resolution_of(time)
    base = _even_base(path, time, label, resolution)
    if base is not None:
        return base
    steps = np.diff(time)
    gaps = _gaps(steps, resolution)
    wrong = _wrong_stamps(time, resolution)
    if len(wrong):
        base = _even_base(path, np.where(np.isin(np.arange(rows), wrong), _even(time), time), label, resolution)
    elif gaps:
        return _with_gaps(path, time, label, gaps, float(np.median(resolution)))
    if base is None:
        off = np.abs(time - _even(time)) / (span / (rows - 1))
        row, step = int(np.argmax(np.abs(steps - span / (rows - 1)))), span / (rows - 1)
        raise InputProblem(
            path,
            f"time column '{label}' is uneven: off a straight line by up to {off.max():.3g} steps, the "
            f"step at row {row + 2} is {steps[row]:.6g} s against {step:.6g} s",
            "resample it evenly, or give `sampling_rate` and `time: none` if the samples are even",
        )
    note = (
        f"time column '{label}' has {len(wrong)} wrong stamp{'s' * (len(wrong) > 1)}, the first at row {wrong[0] + 1} "
        f"({time[wrong[0]]:.9g} s): no sample is missing, all were kept as evenly spaced"
    )
    return replace(base, notes=(note, *base.notes))


def _even_base(path: Path, time: np.ndarray, label: str, resolution: np.ndarray) -> TimeBase | None:
    """The rate of times that lie on a straight line within their printed digits; None where they lie on none.

    Half a unit of the last digit where they were rounded, a whole one where they were cut off or the clock stepped.
    Raises InputProblem where the digits are so few that the rate is not known.
    """
    step = (time[-1] - time[0]) / (len(time) - 1)
    exact = 1e-6 * step + 4e-16 * max(abs(float(time.min())), abs(float(time.max())))
    fits = (slopes_within(time - slack, time + slack) for slack in _slacks(resolution, step, exact))
    printed, slopes = next(((number == 0, found) for number, found in enumerate(fits) if found), (False, None))
    if slopes is None:
        return None
    least = max(slopes[0], 1e-3 * step)
    low, high = (1 - 1e-9) / slopes[1], (1 + 1e-9) / least
    rate, error = simplest_between(low, high), (high - low) / (high + low)
    if error > _AGREE:
        raise InputProblem(
            path,
            f"time column '{label}' is printed with so few digits that the rate may be {low:.5g} to {high:.5g} Hz",
            "export more digits, or give `sampling_rate` and `time: none`",
        )
    coarse = float(np.median(resolution))
    notes = []
    if coarse > _UNEVEN * step and not printed:
        known = f" and lies between {low:.7g} and {high:.7g} Hz" if error > 1e-5 else ""
        notes.append(
            f"time column '{label}' is rounded to {coarse:.3g} s; the rate {rate:.7g} Hz comes from its whole length{known}"
        )
    return TimeBase(rate, float(time[0]), tuple(notes), error=error)


def _slacks(resolution: np.ndarray, step: float, exact: float) -> Iterator[float | np.ndarray]:
    """How far a time may be off a straight line (s): as exact numbers, as rounded ones, and as ones that were cut off."""
    yield exact
    yield 0.5 * resolution + exact
    yield np.maximum(1.01 * resolution, _UNEVEN * step)


def _even(time: np.ndarray) -> np.ndarray:
    """An even grid from the first time to the last."""
    return np.linspace(time[0], time[-1], len(time))


def _wrong_stamps(time: np.ndarray, resolution: np.ndarray) -> np.ndarray:
    """Rows whose time is off the even grid from the first to the last, where nearly all others lie on it.

    A time that stands twice leaves a step of twice the length behind it, where nothing is missing.
    """
    step = (time[-1] - time[0]) / (len(time) - 1)
    off = np.flatnonzero(np.abs(time - _even(time)) > np.maximum(1.01 * resolution, _UNEVEN * step))
    return off if len(off) <= _FEW_WRONG * len(time) else off[:0]


def _gaps(steps: np.ndarray, resolution: np.ndarray) -> list[int]:
    """Where steps are larger than one and a half of the usual one, beyond rounding."""
    rounding = np.maximum(resolution[:-1], resolution[1:])
    usual = float(np.median(steps))
    if usual <= rounding.max():  # several rows share a printed time
        usual = float(np.mean(steps))
        return list(np.flatnonzero(steps > 3 * np.maximum(usual, rounding)))
    return list(np.flatnonzero(steps > 1.5 * usual + rounding))


def _with_gaps(path: Path, time: np.ndarray, label: str, gaps: list[int], resolution: float) -> TimeBase:
    """Rate of the even stretches. Raises InputProblem unless the gaps are whole numbers of samples and rare."""
    steps = np.diff(time)
    inside = np.delete(steps, gaps)
    step = float(np.mean(inside)) if len(inside) else float(np.median(steps))
    missing = [max(1, round(float(steps[gap]) / step) - 1) for gap in gaps]
    first = gaps[0]
    if len(gaps) > 0.01 * len(time) or inside.std() > max(resolution, 0.05 * step):
        raise InputProblem(
            path,
            f"time column '{label}' is uneven: the step at row {first + 2} is {steps[first]:.6g} s, the usual "
            f"one {step:.6g} s",
            "resample it evenly, or give `sampling_rate` and `time: none` if the samples are even",
        )
    error = max(2 * resolution / (step * len(inside)), 1e-9)
    rate = simplest_between((1 - error) / step, (1 + error) / step)
    note = (
        f"{sum(missing)} samples are missing at {len(gaps)} place{'s' * (len(gaps) > 1)}, the first at row {first + 2} "
        f"({time[first]:.6g} s)"
    )
    dropped = tuple((gap + 1, count) for gap, count in zip(gaps, missing, strict=True))
    return TimeBase(rate, float(time[0]), (note,), dropped)


def looks_like_time(values: np.ndarray) -> float | None:
    """The even step of a rising column, or None: it may be time, an index or an angle, which only the user knows."""
    if len(values) < 8 or not np.isfinite(values).all():
        return None
    steps = np.diff(values)
    step = (values[-1] - values[0]) / (len(values) - 1)
    if step <= 0 or np.abs(steps - step).max() > 0.05 * step:
        return None
    return float(step)


def is_no_time(values: np.ndarray, stated: float) -> bool:
    """A column that only its name takes for time: it rises by exactly 1 where the stated rate is not about 1 Hz, or it
    falls as often as not (`t` may be a temperature)."""
    steps = np.diff(values)
    counts = abs(stated - 1.0) > 0.01 and len(steps) > 1 and bool((steps == 1.0).all())
    return counts or bool(len(steps) > 8 and np.mean(steps < 0) > 0.1)


def time_unit(factor: float, ratio: float) -> str | None:
    """The unit (s, ms, us) that a time column has, read with `factor` (s a unit), whose rate is `ratio` times too low.

    None where the rates do not differ by 1e3 or 1e6, to 1 %.
    """
    if not any(abs(ratio / power - 1) < 0.01 for power in (1e-6, 1e-3, 1e3, 1e6)):
        return None
    units = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
    return next((unit for unit, true in units.items() if abs(factor / ratio / true - 1) < 0.01), None)


def _unit_advice(label: str, unit: str) -> str:
    """What to write in campaign.yaml for a time column in another unit than it was read in."""
    name = bare_name(label)
    column = name if name.isidentifier() else f'"{name}"'
    return f"the time column seems to be in {unit}: write `time: {{column: {column}, unit: {unit}}}` under `channels`"


def settle(
    path: Path,
    stated: float | None,
    in_file: float | None,
    file_tolerance: float,
    column: TimeBase | None,
    read_as: tuple[str, float] | None = None,
) -> TimeBase:
    """The rate from campaign.yaml (`stated`), the file's header and its time column.

    read_as: the time column's name and the seconds a unit that it was read with.

    Raises InputProblem where there is none, or where campaign.yaml and the file contradict each other.
    """
    if column is not None:
        notes = list(column.notes)
        for rate, source, slack in ((stated, "campaign.yaml", 0.0), (in_file, "the file's header", file_tolerance)):
            if rate is not None and abs(rate / column.sampling_rate - 1) > max(_AGREE, 2 * slack, 2 * column.error):
                text = f"{source} says {rate:.7g} Hz, the time column {column.sampling_rate:.7g} Hz"
                if source == "campaign.yaml":
                    unit = time_unit(read_as[1], rate / column.sampling_rate) if read_as else None
                    ignore = "remove `sampling_rate`, or set `time: none` to ignore the time column"
                    raise InputProblem(path, text, _unit_advice(read_as[0], unit) if read_as and unit else ignore)
                notes.append(f"{text}; the time column was taken")
        near = stated is not None and abs(stated / column.sampling_rate - 1) <= max(1e-6, 2 * column.error)
        rate = stated if stated is not None and near else column.sampling_rate
        return TimeBase(rate, column.start, tuple(notes), column.dropped)
    if stated is not None:
        if in_file is not None and abs(stated / in_file - 1) > max(_AGREE, 2 * file_tolerance):
            raise InputProblem(
                path,
                f"campaign.yaml says {stated:.7g} Hz, the file {in_file:.7g} Hz",
                "remove `sampling_rate` there, or correct it",
            )
        return TimeBase(stated, 0.0)
    if in_file is not None:
        return TimeBase(in_file, 0.0, ("the sampling rate was taken from the file",))
    raise InputProblem(
        path,
        "no sampling rate: none stated, none in the file, no time column",
        "give `sampling_rate: 12800 Hz`, or `time: {column: 1, unit: s}`, in campaign.yaml under `channels`",
    )
