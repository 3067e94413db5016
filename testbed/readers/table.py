"""What a reader hands on: named columns, the units and the sampling rate the file states, and what was noticed."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from testbed.problem import InputProblem

FORMATS_EXTRA = 'pip install "machining-testbed[formats]"'
DECIMAL_COMMAS = "if its commas are decimal ones, write decimals with a point, or separate columns by semicolons"
_UNIT_IN_NAME = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]\s*$")
_TIME_NAMES = {
    "time",
    "t",
    "zeit",
    "temps",
    "x_value",
    "timestamp",
    "elapsed",
    "elapsed time",
    "time_s",
    "t_s",
    "sec",
    "seconds",
    "time_ms",
}


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
        if wanted.isdigit() and 1 <= int(wanted) <= len(names):
            return names[int(wanted) - 1]
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

    def time_column(self) -> str | None:
        """The column whose name says that it is time, or None."""
        for column in self.columns:
            if bare_name(column).strip().lower() in _TIME_NAMES:
                return column
        return None


def bare_name(text: str) -> str:
    """A column's name without a unit in brackets: `Fx [N]` -> `Fx`."""
    match = _UNIT_IN_NAME.match(text)
    return match["name"].strip() if match and match["name"].strip() else text.strip()


def unit_in_name(text: str) -> str:
    """The unit in brackets at the end of a column's name, "" where there is none."""
    match = _UNIT_IN_NAME.match(text)
    return match["unit"].strip() if match and match["name"].strip() else ""


def unique_names(names: list[str], notes: list[str]) -> list[str]:
    """Names made distinct by `_2`, `_3`; a note says so. Empty names become `column_N`."""
    seen: dict[str, int] = {}
    result: list[str] = []
    for number, name in enumerate(names, 1):
        name = name.strip() or f"column_{number}"
        seen[name] = seen.get(name, 0) + 1
        fresh = name if seen[name] == 1 else f"{name}_{seen[name]}"
        while fresh in result:
            fresh += "_"
        if fresh != name:
            notes.append(f"a second column '{name}' is called '{fresh}'")
        result.append(fresh)
    return result


def listed(names: list[str]) -> str:
    """Names in quotes, of many the first 24."""
    shown = ", ".join(f"'{name}'" for name in names[:24])
    return f"{shown} and {len(names) - 24} more" if len(names) > 24 else shown


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
