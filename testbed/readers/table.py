"""What a reader hands on: named columns, the units and the sampling rate the file states, and what was noticed."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from testbed.files.channel_units import channel_unit, is_channel_unit
from testbed.problem import InputProblem

FORMATS_EXTRA = 'pip install "machining-testbed[formats]"'
DECIMAL_COMMAS = "if its commas are decimal ones, write decimals with a point, or separate columns by semicolons"
NO_SPECTRA = "a frequency response is for `testbed tap`, a spectrum for no command"
_MOST_LISTED = 12  # names in a message
_BRACKETS = re.compile(r"\s*[\[(<{]([^\[\]()<>{}]*(?:\([^()]*\))?)[\])>}]\s*")
_BEHIND = re.compile(r"\s*[,;:/]\s*|\s+in\s+")  # `Force, N`, `Kraft / N`, `Zeit in s`
_TIME_NAMES = {
    "time", "t", "zeit", "temps", "tiempo", "tempo", "tid", "x_value", "x_values", "timestamp", "time_stamp", "elapsed",
    "elapsed time", "relative time", "rel time", "absolute time", "abs time", "time_axis", "date_time", "datetime", "date",
    "clock", "uhrzeit", "time_s", "t_s", "sec", "seconds", "time_ms", "time_us", "time_sec",
}  # fmt: skip
_FREQUENCY_NAMES = {"frequency", "freq", "f", "hz", "frequenz", "frequence", "fréquence", "frequency_hz", "freq_hz"}


@dataclass(frozen=True)
class Table:
    """Columns of one file, not yet judged.

    columns: name -> float array (rows,), NaN where a field was empty; lengths may differ (TDMS, UFF).
    units: name -> unit as the file writes it ("" where it says nothing).
    sampling_rate: Hz as the file states it, None where it does not; rate_tolerance: the relative error that the
    printed digits leave in it. notes: what the reader met and mended. full_scale: name -> value at which the
    converter saturates, where the format knows it. misfit: names that a header gives, where they are more or fewer
    than the `fields` of a line, whose columns are named by number then. unread: names of what else is in the file, and why
    it is no column, such as `has 100 values against 8459`. commas: whether commas stand between the fields of a line.
    spectra: names of columns over frequency, and what each is. clocks: names of columns that were written as times of day.
    order: names of all columns as they stand in the file, also of those left out. directions: of functions, a UFF file's codes
    of the response's and the force's direction: 1, 2, 3 for x, y, z, negative the other way, 0 not said.
    """

    path: Path
    columns: Mapping[str, np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)
    sampling_rate: float | None = None
    rate_tolerance: float = 0.0
    notes: tuple[str, ...] = ()
    full_scale: Mapping[str, float] = field(default_factory=dict)
    misfit: tuple[str, ...] = ()
    fields: int = 0
    unread: Mapping[str, str] = field(default_factory=dict)
    commas: bool = False
    spectra: Mapping[str, str] = field(default_factory=dict)
    clocks: tuple[str, ...] = ()
    order: tuple[str, ...] = ()
    directions: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.columns or all(len(values) == 0 for values in self.columns.values()):
            raise InputProblem(self.path, "no samples in the file", "check that the export was finished")

    def find(self, name: str | int) -> str:
        """The full name of a column asked for by name, by name without its unit, or by number from 1.

        Raises InputProblem, listing the columns there are.
        """
        names = list(self.columns)
        wanted = str(name).strip()
        if wanted in self.columns:
            return wanted
        for same in (bare_name, lambda text: bare_name(text).lower()):
            hits = [column for column in names if same(column) == same(wanted)]
            if len(hits) == 1:
                return hits[0]
        order = self.order or tuple(names)
        if wanted.isdigit() and 1 <= int(wanted) <= len(order):
            if order[int(wanted) - 1] in self.columns:
                return order[int(wanted) - 1]
            wanted = order[int(wanted) - 1]
        for other, why in self.unread.items():
            if bare_name(other).lower() == bare_name(wanted).lower():
                raise InputProblem(self.path, f"'{other}' is there, but {why}", "save columns of numbers of one length")
        if bare_name(wanted).lower() in {bare_name(name).lower() for name in self.misfit}:
            relation = "more" if self.fields > len(self.misfit) else "fewer"
            raise InputProblem(
                self.path,
                f"no column '{wanted}': {relation} fields than names: {self.fields} in a line under "
                f"{listed(list(self.misfit))}",
                (f"{DECIMAL_COMMAS}; else " if self.commas and len(self.misfit) < self.fields <= 2 * len(self.misfit) else "")
                + "give the header as many names as there are fields, or name the column by its number from 1",
            )
        close = difflib.get_close_matches(wanted, names, 1)
        hint = f"; did you mean '{close[0]}'?" if close else ""
        raise InputProblem(self.path, f"no column '{wanted}'", f"the file has {listed(names)}{hint}")

    def time_column(self, column: str | None = None) -> str | None:
        """The column that its name, or being times of day, shows to be time, or None: of several the one next to `column`
        on its left."""
        names = list(self.columns)
        times = [name for name in names if _is_named(name, _TIME_NAMES) and name not in self.clocks] or list(self.clocks)
        before = [] if column is None else [name for name in times if names.index(name) < names.index(column)]
        return before[-1] if before else times[0] if times else None


def is_frequency(name: str, unit: str) -> bool:
    """Whether a column is a frequency axis by its name or its unit."""
    return _is_named(name, _FREQUENCY_NAMES) or (bool(unit) and is_channel_unit(unit) and channel_unit(unit).si == "Hz")


def _is_named(text: str, names: set[str]) -> bool:
    """Whether a column has one of these names, whatever its capitals, its unit and the number of a second such column."""
    name = re.sub(r"[\s_./-]+", "_", bare_name(text).strip().lower()).strip("_")
    known = {re.sub(r"\s", "_", item) for item in names}
    stem = re.sub(r"_?\d+$", "", name)  # `t1` may be a temperature
    return name in known or (stem in known and (len(stem) > 1 or "_" in name))


def named(text: str) -> tuple[str, str]:
    """(name, unit) of a column: `Fx [N]`, `Force, N` and `Kraft / N` have one; of several brackets the last known unit counts.

    The unit is "" without one. A bracket at the end that is no known unit is given as it stands.
    """
    text = text.strip()
    found = list(_BRACKETS.finditer(text))
    for match in reversed(found):
        rest = f"{text[: match.start()]} {text[match.end() :]}".strip()
        if is_channel_unit(match[1]) and rest:
            return rest.strip("_ "), match[1].strip()
    for match in () if found or is_channel_unit(text) else _BEHIND.finditer(text):
        if match.start() and is_channel_unit(text[match.end() :]):
            return text[: match.start()], text[match.end() :]
    if found and found[-1].end() == len(text) and text[: found[-1].start()].strip() and not found[-1][1].isdigit():
        return text[: found[-1].start()].strip(), found[-1][1].strip()
    return text, ""


def bare_name(text: str) -> str:
    """A column's name without its unit: `Fx [N]` -> `Fx`."""
    return named(text)[0]


def unit_in_name(text: str) -> str:
    """The unit that a column's name carries, "" where there is none."""
    return named(text)[1]


def unique_names(names: list[str], notes: list[str]) -> list[str]:
    """Names made distinct by `_2`, `_3`; a note says so. Empty names become `column_N`."""
    seen: dict[str, int] = {}
    result: dict[str, None] = {}
    for number, name in enumerate(names, 1):
        name = name.strip() or f"column_{number}"
        seen[name] = seen.get(name, 0) + 1
        fresh = name if seen[name] == 1 else f"{name}_{seen[name]}"
        while fresh in result:
            fresh += "_"
        if fresh != name:
            notes.append(f"a second column '{name}' is called '{fresh}'")
        result[fresh] = None
    return list(result)


def listed(names: Iterable[str], quote: str = "'") -> str:
    """Names in quotes, of many the first few and how many more there are; `none` without any."""
    every = [f"{quote}{name}{quote}" for name in names]
    more = f" and {len(every) - _MOST_LISTED} more" if len(every) > _MOST_LISTED else ""
    return ", ".join(every[:_MOST_LISTED]) + more or "none"


def matrix_columns(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """A 1-D or 2-D array as columns; the longer axis is time, several columns are `name_1`, `name_2`, ..."""
    values = np.asarray(values)
    if values.ndim == 2 and min(values.shape) == 1:
        values = values.reshape(-1)
    if values.ndim == 1:
        return {name: values.astype(float)}
    if values.shape[0] < values.shape[1]:
        values = values.T
    return {f"{name}_{index + 1}": values[:, index].astype(float) for index in range(values.shape[1])}


def why_unread(shape: tuple[int, ...], numeric: bool, kind: str, length: int = 0) -> str:
    """Why a variable is no column beside others of a length; "" where it may be one."""
    if kind.startswith("complex"):
        return f"holds complex numbers: {NO_SPECTRA}"
    longest = max(shape, default=0 if 0 in shape else 1)
    if not numeric:
        return f"is not numeric ({kind})"
    if 0 in shape:
        return "is empty"
    if len(shape) > 2:
        return f"has {len(shape)} axes ({' x '.join(map(str, shape))})"
    if longest < max(length, 2):
        return f"has {longest} value{'s' * (longest != 1)}" + (f" against {length}" if length else "")
    return ""


def simplest_between(low: float, high: float) -> float:
    """The number of fewest decimal digits within [low, high]: what a rounded rate most likely was."""
    middle = 0.5 * (low + high)
    for digits in range(-3, 13):
        candidate = round(middle, digits)
        if candidate > 0 and low <= candidate <= high:
            return float(candidate)
    return middle
