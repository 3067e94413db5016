"""How the body of a text table is written: found by voting in the middle of the file, where the numbers are."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from testbed.problem import InputProblem
from testbed.readers.header import split_fields

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eEdD][+-]?\d+)?$|[+-]?(nan|inf|infinity)$", re.IGNORECASE)
_DELIMITERS = ("\t", ";", ",", "|", None)  # None: any white space


@dataclass(frozen=True)
class Layout:
    """How the body is written: its delimiter, its decimal comma or not, its fields and which of them are numbers."""

    delimiter: str | None
    decimal_comma: bool
    fields: int
    numeric: tuple[bool, ...]

    def split(self, line: str) -> list[str]:
        return split_fields(line, self.delimiter)

    def number(self, field: str) -> float:
        """The value of one field, NaN when empty. Raises ValueError."""
        return _number(field, self.decimal_comma)

    def fits(self, line: str) -> bool:
        """Whether a line has the body's number of fields and numbers where the body has numbers."""
        fields = self.split(line)
        if len(fields) != self.fields:
            return False
        found = [
            _is_number(field, self.decimal_comma) for field, wanted in zip(fields, self.numeric, strict=True) if wanted
        ]
        return all(hit is not False for hit in found) and any(found)


def _number(field: str, decimal_comma: bool) -> float:
    if not field:
        return float("nan")
    if decimal_comma:
        if "." in field:
            raise ValueError(field)
        field = field.replace(",", ".")
    if not _NUMBER.match(field):
        raise ValueError(field)
    return float(field.replace("d", "e").replace("D", "e"))


def _is_number(field: str, decimal_comma: bool) -> bool | None:
    """True or False; None for an empty field."""
    if not field:
        return None
    try:
        _number(field, decimal_comma)
    except ValueError:
        return False
    return True


def _candidate(sample: list[str], delimiter: str | None, decimal_comma: bool) -> tuple[float, Layout] | None:
    """How well a way of splitting explains the sample: lines that agree, then numbers a line."""
    rows = [split_fields(line, delimiter) for line in sample]
    counts = [len(row) for row in rows]
    fields = max(set(counts), key=counts.count)
    kept = [row for row in rows if len(row) == fields]
    marks = [[_is_number(field, decimal_comma) for field in row] for row in kept]
    numeric, filled = [], 0
    for column in zip(*marks, strict=True):
        said = [mark for mark in column if mark is not None]
        numeric.append(sum(said) >= 0.5 * len(said))
        filled += bool(said) and numeric[-1]
    if not filled:
        return None
    layout = Layout(delimiter, decimal_comma, fields, tuple(numeric))
    share = sum(layout.fits(line) for line in sample) / len(sample)
    text_columns = fields - sum(numeric)
    return share - 0.2 * text_columns / fields + 1e-4 * filled, layout


def find_layout(path: Path, filled: Sequence[str], forced: str | None) -> Layout:
    """The layout that explains the lines, none of them blank, best. Raises InputProblem where none does."""
    if not filled:
        raise InputProblem(path, "the file is empty", "check that the export was finished")
    middle = filled[len(filled) // 4 :]
    sample = list(middle[:: max(1, len(middle) // 200)])
    if len(filled) <= 40:  # a short file: the numbers stand at its end
        sample = list(filled[len(filled) // 2 :])
    best: tuple[float, Layout] | None = None
    for delimiter in (forced,) if forced else _DELIMITERS:
        for decimal_comma in (False,) if delimiter == "," else (False, True):
            if delimiter is not None and not forced and not any(delimiter in line for line in sample):
                continue  # one that is given may be absent: a single column
            found = _candidate(sample, delimiter, decimal_comma)
            if found and (best is None or found[0] > best[0] + 1e-9):
                best = found
    if best is None or best[0] < 0.3:
        raise InputProblem(
            path, "no table of numbers found in the text", "give `delimiter` and `skip_rows`, or export as CSV"
        )
    return best[1]


def first_row(path: Path, lines: Sequence[str], layout: Layout, skip_rows: int) -> int:
    """Index of the first line of the body: the first of three (or all that are left) that fit."""
    for index in range(skip_rows, len(lines)):
        if not layout.fits(lines[index]):
            continue
        following = [line for line in lines[index : index + 8] if line.strip()][:3]
        if all(layout.fits(line) for line in following):
            return index
    for index in range(len(lines) - 1, skip_rows - 1, -1):  # fewer than three rows
        if layout.fits(lines[index]):
            while index > skip_rows and layout.fits(lines[index - 1]):
                index -= 1
            return index
    raise InputProblem(
        path, "no table of numbers found in the text", "give `delimiter` and `skip_rows`, or export as CSV"
    )
