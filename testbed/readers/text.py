"""Text tables of every kind: CSV, TSV, DynoWare, LabVIEW and other exports with junk above the numbers.

The body is found by voting in the middle of the file, where the numbers are; the header is what stands right above
it. Anything in the body that is not a number is an error that names the line, never a silent gap.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbed.files.door import room
from testbed.problem import InputProblem
from testbed.readers import lvm
from testbed.readers.clock import is_clock, seconds
from testbed.readers.header import Body, read_header
from testbed.readers.layout import Layout, find_layout, first_row
from testbed.readers.lines import Lines, read_lines
from testbed.readers.table import DECIMAL_COMMAS, Table, is_frequency, listed
from testbed.readers.timebase import looks_like_time

_COMMENTS, _SIGNS = ("#", "%", "//", "!"), b"#%/!"
_AT_ONCE = 1 << 14  # lines parsed at once
_SIZE_LIMIT = 2 * 1024**3
_HELD = 1.8  # bytes a byte of the file, while its lines are found
_LONGEST_LINE = 1_000_000  # characters: 50,000 columns and more
_LONGEST_HEADER = 20_000  # characters of a line above the numbers that is no row of their names; what looks for a rate in it,
# or for units, may take the square of that
_LOOKED_BACK, _ENOUGH = 20, 3  # lines, at the end of a table, by whose length it is seen that the last is cut off
_OVERLOADS = {"ovl", "overload", "ovr", "over", "ovld", "ol", "clip", "overflow", "saturated"}


def _body(lines: Lines, first: int, layout: Layout, notes: list[str]) -> Lines:
    """The lines of the body without blank ones and comments; a cut-off last line is dropped."""
    kept, comments = np.ones(len(lines), dtype=bool), 0
    kept[:first] = False
    unsure = lines.opening_with(_SIGNS)
    unsure = unsure[np.searchsorted(unsure, first) :]
    for index, line in zip(unsure, map(str.strip, lines[unsure]), strict=True):
        kept[index] = bool(line) and not line.startswith(_COMMENTS)
        comments += line.startswith(_COMMENTS)
    body = lines[kept]
    if comments:
        notes.append(f"comment lines passed over amid the numbers: {comments}")
    if len(body) > 1 and _is_cut(layout, body[-_LOOKED_BACK:]):
        notes.append(f"line {body.places[-1] + 1}, the last, is cut off and was dropped: the file may be incomplete")
        body = body[:-1]
    return body


def _is_cut(layout: Layout, lines: Lines) -> bool:
    """Whether the last of these lines lacks fields, or the number behind its last delimiter where the line before has one.

    Where it has no end, too, if its last number is shorter than all before it: 2.1e-06 cut off is 2.1, or no number at all.
    """
    *before, last = [layout.split(line) for line in lines]
    if len(last) < layout.fields or (layout.numeric[-1] and not last[-1].strip() and bool(before[-1][-1].strip())):
        return True
    long = [len(fields[-1]) for fields in before]
    return not lines.ended and len(long) >= _ENOUGH and layout.numeric[-1] and len(last[-1]) < min(long)


def _parse_fast(body: Lines, layout: Layout) -> np.ndarray | None:
    """All numeric columns by numpy, a block of lines at a time; None where any line needs a closer look."""
    used = [index for index, numeric in enumerate(layout.numeric) if numeric]
    columns = None if layout.delimiter is None else used
    table = np.empty((len(body), len(used)))
    for first in range(0, len(body), _AT_ONCE):
        text = body.texts(first, first + _AT_ONCE)
        if layout.delimiter is not None and any(line.count(layout.delimiter) != layout.fields - 1 for line in text):
            return None
        text = [line.replace('"', "") for line in text]
        if layout.decimal_comma:
            text = [line.replace(",", ".") for line in text]
        try:
            block = np.loadtxt(text, comments=None, delimiter=layout.delimiter, ndmin=2, usecols=columns)
        except (ValueError, IndexError):
            return None
        if len(block) != len(text) or (columns is None and block.shape[1] != layout.fields):
            return None
        table[first : first + len(text)] = block[:, used] if columns is None else block
    return table


def _parse_slowly(
    path: Path, body: Lines, layout: Layout, names: list[str], misfit: tuple[str, ...]
) -> np.ndarray:
    """Line by line. Raises InputProblem at the first field that is no number, naming line and column.

    misfit: names that are not as many as a line has fields.
    """
    used = [index for index, numeric in enumerate(layout.numeric) if numeric]
    table = np.empty((len(body), len(used)))
    for row, (line, number) in enumerate(zip(body, body.places + 1, strict=True)):
        fields = layout.split(line)
        if len(fields) != layout.fields:
            raise InputProblem(
                path,
                f"{len(fields)} fields where the table has {layout.fields}: {line.strip()[:60]!r}",
                DECIMAL_COMMAS
                if layout.delimiter == "," and len(misfit) < layout.fields <= 2 * len(misfit)
                else "mend or remove the line, or give `delimiter` and `skip_rows`",
                int(number),
            )
        for column, index in enumerate(used):
            try:
                table[row, column] = layout.number(fields[index])
            except ValueError:
                raise InputProblem(
                    path,
                    f"column '{names[column]}' holds {fields[index][:30]!r}, not a number",
                    _advice(fields[index], names[column]),
                    int(number),
                ) from None
    return table


def _advice(field: str, name: str) -> str:
    if field == name:
        return "the header stands there again: split the file into its captures"
    if field.strip("-+<> ").lower() in _OVERLOADS:
        return "the amplifier was overloaded there: measure again with a larger range, or read around it with from/to"
    return "mend or remove the line"


def read_text(path: Path, *, skip_rows: int = 0, delimiter: str | None = None, key: str | None = None) -> Table:
    """A text table. `skip_rows` lines at the top are ignored; `delimiter` overrides the one found; `key` picks a capture of
    LabVIEW's files.

    Raises InputProblem with the line for anything in the body that is not a number.
    """
    size = path.stat().st_size
    if size > _SIZE_LIMIT:
        raise InputProblem(path, f"{size / 1e9:.1f} GB of text", "convert it to HDF5 or Parquet")
    room(path, _HELD * size)
    lines = read_lines(path)
    if not delimiter and re.match(r"sep=.$", lines[0].strip()):
        delimiter, skip_rows = lines[0].strip()[-1], max(1, skip_rows)
    filled = lines.filled()
    if skip_rows and len(filled) and not (filled.places >= skip_rows).any():
        there = len(lines) - lines.ended
        raise InputProblem(path, f"skip_rows: {skip_rows} leaves nothing of {there} lines", "skip fewer lines")
    if longest := lines.longest(_LONGEST_LINE):
        number, length = longest
        if not lines[number].lstrip()[:2].startswith(_COMMENTS):
            raise InputProblem(path, f"a line of {length} characters: no table of numbers", "export as CSV, one line a sample",
                               number + 1)
    labview = lvm.Chosen(lines, [], False, ())
    if lines[0].startswith(lvm.FIRST_LINE):
        labview = lvm.choose(path, lines, key)
        lines, filled = labview.lines, labview.lines.filled()
    notes = list(labview.notes)
    layout = find_layout(path, filled[filled.places >= skip_rows], _spelled(delimiter))
    first = first_row(path, lines, layout, skip_rows)
    body = _body(lines, first, layout, notes)
    below = Body(body, layout.delimiter, layout.fields, layout.decimal_comma)
    above = [line if len(line) <= _LONGEST_HEADER or len(layout.split(line)) == layout.fields else line[:_LONGEST_HEADER]
             for line in lines[:first]]
    header = read_header(path, above, below, skip_rows)
    used = [index for index, numeric in enumerate(layout.numeric) if numeric]
    names = [header.names[index] for index in used]
    room(path, 8.0 * len(body) * len(used))  # bytes a number
    values = _parse_fast(body, layout)
    if values is None:
        values = _parse_slowly(path, body, layout, names, header.misfit)
    columns = {header.names[index]: values[:, position] for position, index in enumerate(used)
               if len(body) == 1 or not np.isnan(values[:, position]).all()}  # not the empty one behind a trailing delimiter
    clocks = _clocks(header.names, body, layout)
    columns = {name: (columns | clocks)[name] for name in header.names if name in columns or name in clocks}
    units = dict(zip(header.names, header.units, strict=True)) | dict.fromkeys(clocks, "s")
    units |= {name: unit for name, unit in zip(header.names, labview.units, strict=False) if unit}
    dropped = [header.names[index] for index in range(layout.fields)
               if not layout.numeric[index] and header.names[index] not in clocks]
    if dropped:
        notes.append(f"column {listed(dropped)} holds text and was left out")
    if layout.decimal_comma:
        notes.append("numbers are written with a decimal comma")
    table = Table(
        path,
        columns,
        units,
        header.sampling_rate,
        header.rate_tolerance,
        (*notes, *header.notes),
        misfit=header.misfit,
        fields=layout.fields,
        unread=dict.fromkeys(header.names, "is empty") | dict.fromkeys(dropped, "holds text"),
        commas=layout.delimiter == ",",
        clocks=tuple(clocks),
        order=tuple(header.names),
    )
    return replace(table, spectra=_spectra(table, labview.over_frequency))


def _clocks(names: list[str], body: Lines, layout: Layout) -> dict[str, np.ndarray]:
    """Columns of words that are dates and times of day, as seconds since their first."""
    first, found = layout.split(body[0]), {}
    for index, numeric in enumerate(layout.numeric):
        if not numeric and is_clock(first[index]):
            moments = seconds(layout.split(line)[index] for line in body)
            if moments is not None:
                found[names[index]] = moments
    return found


def _spectra(table: Table, over_frequency: bool) -> dict[str, str]:
    """Columns over frequency and what they are: all, where the header says so or the first column is a rising frequency."""
    first = next(iter(table.columns))
    if not over_frequency and (table.time_column() is not None or len(table.columns) == 1
                               or not is_frequency(first, table.units[first]) or looks_like_time(table.columns[first]) is None):
        return {}
    over = "by its header" if over_frequency else f"over '{first}'"
    return dict.fromkeys(table.columns, f"part of a frequency response or a spectrum ({over})")


def _spelled(delimiter: str | None) -> str | None:
    """A delimiter as people write it."""
    return {"tab": "\t", "\\t": "\t", "comma": ",", "semicolon": ";", "space": None, " ": None}.get(
        delimiter or "", delimiter
    )
