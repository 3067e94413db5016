"""Text tables of every kind: CSV, TSV, DynoWare, LabVIEW and other exports with junk above the numbers.

The body is found by voting in the middle of the file, where the numbers are; the header is what stands right above
it. Anything in the body that is not a number is an error that names the line, never a silent gap.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbed.problem import InputProblem
from testbed.readers.header import Body, read_header, split_fields
from testbed.readers.table import DECIMAL_COMMAS, Table

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?$|[+-]?(nan|inf|infinity)$", re.IGNORECASE)
_DELIMITERS = ("\t", ";", ",", "|", None)  # None: any white space
_SIZE_LIMIT = 2 * 1024**3
_OVERLOADS = {"ovl", "overload", "ovr", "over", "ovld", "ol", "clip", "overflow", "saturated"}


@dataclass(frozen=True)
class _Layout:
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


def decode(path: Path, raw: bytes) -> str:
    """Text of a file in UTF-8, UTF-16 (with or without a byte-order mark) or a Western one-byte code.

    Raises InputProblem for what is no text.
    """
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16", errors="replace")
    if raw.startswith(b"\xef\xbb\xbf"):
        raw = raw[3:]
    head = raw[:4096]
    zeros_even, zeros_odd = head[0::2].count(0), head[1::2].count(0)
    if (
        len(head) >= 4
        and max(zeros_even, zeros_odd) > 0.4 * len(head) / 2
        and min(zeros_even, zeros_odd) < 0.02 * len(head)
    ):
        return raw.decode("utf-16-le" if zeros_odd > zeros_even else "utf-16-be", errors="replace")
    if b"\0" in raw or sum(head.count(code) for code in range(1, 9)) > 0.01 * len(head):
        raise InputProblem(
            path,
            "not a text table (it holds binary data)",
            "export as CSV, or give the file its proper ending (.mat, .h5, .wav, .tdms, .uff, .parquet)",
        )
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _candidate(sample: list[str], delimiter: str | None, decimal_comma: bool) -> tuple[float, _Layout] | None:
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
    layout = _Layout(delimiter, decimal_comma, fields, tuple(numeric))
    share = sum(layout.fits(line) for line in sample) / len(sample)
    text_columns = fields - sum(numeric)
    return share - 0.2 * text_columns / fields + 1e-4 * filled, layout


def _find_layout(path: Path, lines: list[str], forced: str | None) -> _Layout:
    filled = [line for line in lines if line.strip()]
    if not filled:
        raise InputProblem(path, "the file is empty", "check that the export was finished")
    middle = filled[len(filled) // 4 :] if len(filled) > 40 else filled
    sample = middle[:: max(1, len(middle) // 200)]
    if len(filled) <= 40:  # a short file: the numbers stand at its end
        sample = filled[len(filled) // 2 :]
    best: tuple[float, _Layout] | None = None
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


def _first_row(path: Path, lines: list[str], layout: _Layout, skip_rows: int) -> int:
    """Index of the first line of the body: the first of three (or all that are left) that fit."""
    for index in range(skip_rows, len(lines)):
        following = [line for line in lines[index : index + 8] if line.strip()][:3]
        if lines[index].strip() and following and all(layout.fits(line) for line in following):
            return index
    for index in range(len(lines) - 1, skip_rows - 1, -1):  # fewer than three rows
        if layout.fits(lines[index]):
            while index > skip_rows and layout.fits(lines[index - 1]):
                index -= 1
            return index
    raise InputProblem(
        path, "no table of numbers found in the text", "give `delimiter` and `skip_rows`, or export as CSV"
    )


def _body(lines: list[str], first: int, layout: _Layout, notes: list[str]) -> tuple[list[str], list[int]]:
    """The lines of the body and their numbers in the file, without blank ones; a cut-off last line is dropped."""
    body, numbers = [], []
    for number, line in enumerate(lines[first:], first + 1):
        if line.strip():
            body.append(line)
            numbers.append(number)
    if len(body) > 1 and _is_cut(layout, *body[-2:]):
        notes.append(f"line {numbers[-1]}, the last, is cut off and was dropped: the file may be incomplete")
        body.pop()
        numbers.pop()
    return body, numbers


def _is_cut(layout: _Layout, before: str, last: str) -> bool:
    """Whether a last line lacks fields, or the number behind its last delimiter where the line before has one."""
    earlier, fields = layout.split(before), layout.split(last)
    return len(fields) < layout.fields or (layout.numeric[-1] and not fields[-1].strip() and bool(earlier[-1].strip()))


def _parse_fast(body: list[str], layout: _Layout) -> np.ndarray | None:
    """All numeric columns by numpy, None where any line needs a closer look."""
    used = [index for index, numeric in enumerate(layout.numeric) if numeric]
    if layout.delimiter is not None and any(line.count(layout.delimiter) != layout.fields - 1 for line in body):
        return None
    text = (
        [line.replace('"', "").replace(",", ".") for line in body]
        if layout.decimal_comma
        else [line.replace('"', "") for line in body]
    )
    try:
        if layout.delimiter is None:
            table = np.loadtxt(text, comments=None, ndmin=2)
            return table[:, used] if table.shape[1] == layout.fields else None
        return np.loadtxt(text, comments=None, delimiter=layout.delimiter, ndmin=2, usecols=used)
    except (ValueError, IndexError):
        return None


def _parse_slowly(
    path: Path, body: list[str], numbers: list[int], layout: _Layout, names: list[str], misfit: tuple[str, ...]
) -> np.ndarray:
    """Line by line. Raises InputProblem at the first field that is no number, naming line and column.

    misfit: names that are not as many as a line has fields.
    """
    used = [index for index, numeric in enumerate(layout.numeric) if numeric]
    table = np.empty((len(body), len(used)))
    for row, (line, number) in enumerate(zip(body, numbers, strict=True)):
        fields = layout.split(line)
        if len(fields) != layout.fields:
            raise InputProblem(
                path,
                f"{len(fields)} fields where the table has {layout.fields}: {line.strip()[:60]!r}",
                DECIMAL_COMMAS
                if layout.delimiter == "," and len(misfit) < layout.fields <= 2 * len(misfit)
                else "mend or remove the line, or give `delimiter` and `skip_rows`",
                number,
            )
        for column, index in enumerate(used):
            try:
                table[row, column] = layout.number(fields[index])
            except ValueError:
                raise InputProblem(
                    path,
                    f"column '{names[column]}' holds {fields[index][:30]!r}, not a number",
                    _advice(fields[index]),
                    number,
                ) from None
    return table


def _advice(field: str) -> str:
    if field.strip("-+<> ").lower() in _OVERLOADS:
        return "the amplifier was overloaded there: measure again with a larger range, or read around it with from/to"
    return "mend or remove the line"


def _ending_notes(text: str, body: list[str], layout: _Layout) -> list[str]:
    """A last line without an end whose last number is shorter than all before it was probably cut."""
    if text.endswith(("\n", "\r")) or len(body) < 4:
        return []
    lengths = [len(layout.split(line)[-1]) for line in body[-20:]]
    if lengths[-1] < min(lengths[:-1]):
        return ["the last line has no end and its last number is short: the file may be cut off"]
    return []


def read_text(path: Path, *, skip_rows: int = 0, delimiter: str | None = None) -> Table:
    """A text table. `skip_rows` lines at the top are ignored; `delimiter` overrides the one found.

    Raises InputProblem with the line for anything in the body that is not a number.
    """
    size = path.stat().st_size
    if size > _SIZE_LIMIT:
        raise InputProblem(path, f"{size / 1e9:.1f} GB of text", "convert it to HDF5 or Parquet")
    text = decode(path, path.read_bytes())
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if not delimiter and lines and re.match(r"sep=.$", lines[0].strip()):
        delimiter, skip_rows = lines[0].strip()[-1], max(1, skip_rows)
    notes: list[str] = []
    if skip_rows and any(line.strip() for line in lines) and not any(line.strip() for line in lines[skip_rows:]):
        there = len(text.splitlines())
        raise InputProblem(path, f"skip_rows: {skip_rows} leaves nothing of {there} lines", "skip fewer lines")
    layout = _find_layout(path, lines[skip_rows:], _spelled(delimiter))
    first = _first_row(path, lines, layout, skip_rows)
    body, numbers = _body(lines, first, layout, notes)
    below = Body(body, layout.delimiter, layout.fields, layout.decimal_comma)
    header = read_header(path, lines[:first], below, skip_rows)
    used = [index for index, numeric in enumerate(layout.numeric) if numeric]
    names = [header.names[index] for index in used]
    values = _parse_fast(body, layout)
    if values is None:
        values = _parse_slowly(path, body, numbers, layout, names, header.misfit)
    notes += _ending_notes(text, body, layout)
    columns, units = {}, {}
    for position, index in enumerate(used):
        if len(body) > 1 and np.isnan(values[:, position]).all():
            continue  # the empty column behind a trailing delimiter
        columns[header.names[index]] = values[:, position]
        units[header.names[index]] = header.units[index]
    dropped = [header.names[index] for index in range(layout.fields) if not layout.numeric[index]]
    if dropped:
        notes.append(f"column {', '.join(repr(name) for name in dropped)} holds text and was left out")
    if layout.decimal_comma:
        notes.append("numbers are written with a decimal comma")
    rate, said = (header.sampling_rate, header.rate_tolerance), (*notes, *header.notes)
    return Table(
        path,
        columns,
        units,
        *rate,
        said,
        misfit=header.misfit,
        fields=layout.fields,
        unread=dict.fromkeys(dropped, "holds text"),
        commas=layout.delimiter == ",",
    )


def _spelled(delimiter: str | None) -> str | None:
    """A delimiter as people write it."""
    return {"tab": "\t", "\\t": "\t", "comma": ",", "semicolon": ";", "space": None, " ": None}.get(
        delimiter or "", delimiter
    )
