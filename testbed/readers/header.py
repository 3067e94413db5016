"""What stands above the numbers of a text table: names, units, and the sampling rate where it is written."""

from __future__ import annotations

import contextlib
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from testbed.files.channel_units import is_channel_unit
from testbed.problem import InputProblem
from testbed.readers.table import DECIMAL_COMMAS, bare_name, listed, simplest_between, unique_names, unit_in_name

_RATE = re.compile(
    r"(sampl\w*[ _-]*(rate|freq\w*)|samples[ _]*(per|/)[ _]*s\w*|abtast(rate|frequenz)|scan[ _]*rate|"
    r"(?<![a-z])fs(?![a-z]))",
    re.IGNORECASE,
)
_STEP = re.compile(
    r"(delta_x|sampl\w*[ _-]*(interval|period|time)|time[ _]*(interval|increment|step)|abtastintervall|"
    r"(?<![a-z])(dt|xincr\w*|x_?increment)(?![a-z]))",
    re.IGNORECASE,
)
_VALUE = re.compile(r"[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?")
_OTHER_UNITS = ("a", "c", "°c", "degc", "pa", "kpa", "bar", "nm", "n·m", "n*m", "n m", "w", "kw")  # of columns beside
_LONGEST_NAME = 60


@dataclass(frozen=True)
class Header:
    """Names and units, one a field, and the rate the text states (Hz; None) with its relative rounding error.

    misfit: the words right above the numbers, where they are more or fewer than the columns.
    """

    names: list[str]
    units: list[str]
    named: bool
    sampling_rate: float | None
    rate_tolerance: float
    notes: tuple[str, ...]
    misfit: tuple[str, ...] = ()


@dataclass(frozen=True)
class Body:
    """The numbers below a header: their lines, how they are split and the number of fields in each."""

    lines: Sequence[str]
    delimiter: str | None
    fields: int
    decimal_comma: bool

    def last_is_empty(self) -> bool:
        """Whether the last field is empty in every line: a trailing delimiter."""
        return self.delimiter is not None and not any(
            line.rpartition(self.delimiter)[2].strip(' "\t\r') for line in self.lines
        )

    def has_point(self) -> bool:
        """Whether there is a decimal point anywhere."""
        return any("." in line for line in self.lines)


def split_fields(line: str, delimiter: str | None) -> list[str]:
    """Fields of a line without blanks and quotes; a delimiter between quotes is none."""
    if '"' in line and delimiter is None:
        return [field.strip('"').strip() for field in re.findall(r'"[^"]*"|[^\s"]+', line)]
    if '"' in line and delimiter is not None and len(delimiter) == 1:
        with contextlib.suppress(csv.Error):
            fields = next(csv.reader([line.strip("\r\n")], delimiter=delimiter, skipinitialspace=True))
            return [field.strip() for field in fields]
    return [field.strip().strip('"').strip() for field in line.split(delimiter)]


def _header_fields(line: str, body: Body) -> list[str]:
    """Fields of a line above the numbers, which may be written otherwise than they are: its split that fits them, if any."""
    line = _uncommented(line)
    plain = _shortened(split_fields(line, body.delimiter), body.fields)
    bare = line.strip()
    others = []
    if body.delimiter is None:
        others = [re.findall(r"\S+?(?:\s*[\[(][^\])]*[\])])|\S+", bare), re.split(r"\t+|\s{2,}", bare)]
    others += [split_fields(bare, other) for other in ("\t", ";", ",") if other in bare and other != body.delimiter]
    if body.fields == 1 and len(bare) <= _LONGEST_NAME and not re.search(r"[:=]", bare):
        others.append([bare.strip('"')])
    fits = [fields for fields in (plain, *others) if len(fields) == body.fields]
    return fits[0] if fits else plain


def _uncommented(line: str) -> str:
    return line.lstrip("#%/ ") if line.lstrip().startswith(("#", "%", "//")) else line


def _is_unit_row(fields: list[str], columns: int) -> bool:
    filled = [field for field in fields if field]
    if not filled or len(filled) == 1 < columns and len(fields) < columns:  # one word over several columns is a title
        return False
    bracketed = re.compile(r"[\[(].*[\])]|-")
    return all(
        bracketed.fullmatch(field) or field.lower() in _OTHER_UNITS or is_channel_unit(field) for field in filled
    )


def _shortened(fields: list[str], count: int) -> list[str]:
    """Header fields without what stands behind the last name: a trailing delimiter, or LabVIEW's column of comments."""
    while len(fields) > count and (not fields[-1] or fields[-1].lower() == "comment"):
        fields = fields[:-1]
    return fields


def read_header(path: Path, lines: list[str], body: Body, skip_rows: int = 0) -> Header:
    """Names, units and rate from the lines above a body; the first `skip_rows` of them are not held to its columns.

    Raises InputProblem where fewer names than fields say that a comma is both the delimiter and the decimal point.
    """
    notes: list[str] = []
    names, unit_row, misfit = _names_and_units(lines, body, skip_rows)
    if misfit:
        _refuse_decimal_comma(path, misfit, body)
    named = names is not None
    if names is None:
        names = [str(number) for number in range(1, body.fields + 1)]
        fitting = f" that fits the {body.fields} columns" if misfit else ""
        notes.append(f"no header found{fitting}: columns are named by number from 1")
        if body.delimiter == "," and body.fields == 2 and not body.has_point():
            notes.append(
                "one comma in every line and no header: read as two columns; if it is a decimal comma, give "
                "`delimiter: ';'`"
            )
    units = unit_row if unit_row is not None else [unit_in_name(name) for name in names]
    units = [unit or unit_in_name(name) for unit, name in zip(units, names, strict=True)]
    rate, tolerance = _stated_rate(lines, notes)
    if body.decimal_comma:
        units = [unit.replace(",", ".") for unit in units]
    return Header(unique_names(names, notes), units, named, rate, tolerance, tuple(notes), tuple(misfit))


def _names_and_units(
    lines: list[str], body: Body, skip_rows: int
) -> tuple[list[str] | None, list[str] | None, list[str]]:
    """The row of names and the row of units right above the body, None where there is none; and a row of words that
    has another number of fields than the body, [] where there is none."""
    last = [number for number, line in enumerate(lines) if line.strip()][-4:]
    above = [(number < skip_rows, _header_fields(lines[number], body)) for number in last]
    unit_row, padded = None, False
    for number, (skipped, fields) in reversed(list(enumerate(above))):
        is_unit_row = unit_row is None and _is_unit_row(fields, body.fields)
        lacks_one = len(fields) == body.fields - 1
        if lacks_one and (is_unit_row or body.last_is_empty()):
            fields, padded = [*fields, ""], padded or not body.last_is_empty()
        words = [field for field in fields if field and not _VALUE.fullmatch(field)]
        if len(fields) != body.fields and padded:  # units and names, both one fewer than the fields
            return None, None, fields
        if len(fields) != body.fields:
            return unit_row, unit_row, fields if words and not skipped and unit_row is None else []
        if is_unit_row:
            unit_row = [field.strip("[]()") for field in fields]
            continue
        if words and unit_row is None and number:  # units may stand above the names
            over = above[number - 1][1]
            fits = len(over) == body.fields and _is_unit_row(over, body.fields)
            unit_row = [field.strip("[]()") for field in over] if fits else None
        if words:
            return fields, unit_row, []
        break
    if unit_row is not None and padded:
        return None, None, unit_row[:-1]
    return unit_row, unit_row, []


def _refuse_decimal_comma(path: Path, names: list[str], body: Body) -> None:
    """Raises InputProblem where a line has more fields than names and no point: its commas are likely decimal ones."""
    if body.delimiter != "," or not len(names) < body.fields <= 2 * len(names) or body.has_point():
        return
    if any(_VALUE.fullmatch(name) for name in names):
        return
    if body.fields == 2 * len(names) > 2:
        raise InputProblem(
            path,
            f"{len(names)} names but {body.fields} fields a line: a comma is both delimiter and decimal point",
            "export with a decimal point or another delimiter",
        )
    alone = ", or give `delimiter: ';'` for a single column" if len(names) == 1 else ""
    raise InputProblem(
        path,
        f"more fields than names: {body.fields} whole numbers a line under {listed(names)}",
        f"{DECIMAL_COMMAS}{alone}; if they are whole numbers, name every column",
    )


def _stated_rate(lines: list[str], notes: list[str]) -> tuple[float | None, float]:
    """Sampling rate (Hz) in the junk above the table and its relative rounding error."""
    for line in lines:
        for pattern, is_step in ((_RATE, False), (_STEP, True)):
            key = pattern.search(line)
            if key is None:
                continue
            value = _VALUE.search(line, key.end())
            between = line[key.end() : value.start()] if value else ""
            if value is None or len(bare_name(between)) > 12 or re.search(r"[A-Za-z]{4,}", between):
                continue
            text = value[0].replace(",", ".")
            number = float(text)
            unit = f"{between} {line[value.end() : value.end() + 8]}".lower()
            if is_step:
                number *= 1e-3 if re.search(r"\bms\b", unit) else 1e-6 if re.search(r"\b[uµμ]s\b", unit) else 1.0
            else:
                number *= 1e3 if re.search(r"\bk(hz|s/s)", unit) else 1e6 if "mhz" in unit else 1.0
            if not number > 0:
                continue
            error = _rounding(text)
            if not is_step:
                return number, error
            rate = (
                simplest_between((1 / number) * (1 - error), (1 / number) * (1 + error)) if error < 1e-5 else 1 / number
            )
            if error >= 1e-5:
                notes.append(
                    f"the file's '{key[0]}' {value[0]} is rounded: its rate is known to {100 * error:.2g} % only"
                )
            return rate, error
    return None, 0.0


def _rounding(text: str) -> float:
    """Relative error that the printed digits leave: half a unit of the last place, 0 for a whole number."""
    mantissa, _, _ = text.lower().partition("e")
    digits = mantissa.lstrip("+-").replace(".", "").lstrip("0")
    if "." not in mantissa and "e" not in text.lower():
        return 0.0
    return 0.5 / float(digits) if digits else 0.0
