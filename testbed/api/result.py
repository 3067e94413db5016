"""What every answer of the Python API can do: become the JSON of its command, a table, a data frame, a line of text."""

from __future__ import annotations

import dataclasses
import math
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from testbed.problem import optional

if TYPE_CHECKING:
    import pandas
    import xarray

MOST_ROWS = 40  # of a table shown in a notebook


def plain(value: Any) -> Any:
    """A value as JSON knows it: NaN and infinities are null, a complex number [re, im], arrays lists."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # numpy, without importing it
        return plain(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def json_text(value: Any) -> str:
    """The text that `--json` writes of an answer."""
    import json

    return json.dumps(plain(value), indent=2, allow_nan=False) + "\n"


class Table(NamedTuple):
    """Rows of an answer: the column that names them, column -> values, column -> SI unit where it has one."""

    head: str
    columns: Mapping[str, Sequence[Any]]
    units: Mapping[str, str]


class Result(ABC):
    """The base of every answer. Answers are frozen: to ask otherwise, call the function again.

    Values are SI: rad/s, m, N/m^2. NaN, or None, stands where nothing is known.
    """

    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The very dictionary that the command of this name writes with `--json`: plain lists, numbers, texts and None."""
        return dict(plain(self._answer()))

    @property
    def json(self) -> str:
        """The text that the command of this name writes with `--json`."""
        return json_text(self._answer())

    def to_pandas(self) -> pandas.DataFrame:
        """The main table of the answer as a DataFrame, its SI units in `attrs["units"]`. InputProblem without pandas."""
        frames = optional("pandas")
        table = self._table()
        frame = frames.DataFrame({name: list(values) for name, values in table.columns.items()})
        frame = frame.set_index(table.head) if table.head else frame
        frame.attrs["units"] = dict(table.units)
        return frame  # type: ignore[no-any-return]

    def to_xarray(self) -> xarray.Dataset:
        """The same as an xarray Dataset, every variable with its SI unit in `attrs["units"]`. InputProblem without xarray."""
        arrays, table = optional("xarray"), self._table()
        dimension = table.head or "row"
        found = arrays.Dataset({name: (dimension, list(values)) for name, values in table.columns.items() if name != dimension},
                               {name: (name, list(values)) for name, values in table.columns.items() if name == dimension})
        return with_units(found, table.units)  # type: ignore[no-any-return]

    @abstractmethod
    def _answer(self) -> Mapping[str, Any]:
        """What `--json` writes, not yet plain."""

    @abstractmethod
    def _table(self) -> Table:
        """The main table of the answer."""

    @abstractmethod
    def _headline(self) -> str:
        """The answer in a line."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._headline()}>"

    def _repr_html_(self) -> str:
        from html import escape

        return f"<p><b>{type(self).__name__}</b>: {escape(self._headline())}</p>{html_table(self._table())}" \
               + "".join(f"<p><small>{escape(note)}</small></p>" for note in self.notes)


def with_units(found: Any, units: Mapping[str, str]) -> Any:
    """An xarray Dataset whose variables have their SI units."""
    for name, unit in units.items():
        if name in found.variables:
            found[name].attrs["units"] = unit
    return found


def html_table(table: Table) -> str:
    """A small table for a notebook, numbers to five digits, units in its head."""
    from html import escape

    heads = [f"{name} [{table.units[name]}]" if table.units.get(name, "1") != "1" else name for name in table.columns]
    rows = list(zip(*table.columns.values(), strict=True))
    lines = ["".join(f"<td>{escape(shown_cell(cell))}</td>" for cell in row) for row in rows[:MOST_ROWS]]
    more = f"<p><small>{len(rows) - MOST_ROWS} rows more</small></p>" if len(rows) > MOST_ROWS else ""
    return "<table><thead><tr>" + "".join(f"<th>{escape(head)}</th>" for head in heads) + "</tr></thead><tbody>" \
        + "".join(f"<tr>{line}</tr>" for line in lines) + f"</tbody></table>{more}"


def shown_cell(value: Any) -> str:
    """One value of a table for people."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, (float, complex)):
        return f"{value:.5g}"
    return ", ".join(map(str, value)) if isinstance(value, (tuple, list)) else str(value)


def estimates_table(parameters: Mapping[str, Any]) -> Table:
    """Parameters that were found, each with its 95 % interval and its unit."""
    found = list(parameters.values())
    return Table("parameter", {"parameter": list(parameters), "value": [one.value for one in found],
                               "low": [one.low if one.known else math.nan for one in found],
                               "high": [one.high if one.known else math.nan for one in found],
                               "unit": [one.unit for one in found], "determined": [one.determined for one in found]}, {})


def shown_here(figure: Any) -> Any:
    """A matplotlib Figure, which a notebook then shows where it ends a cell."""
    if "IPython" in sys.modules:
        import matplotlib.pyplot  # noqa: F401  # tells the notebook how figures are shown
    return figure
