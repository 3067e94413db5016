"""What stands above the numbers of a text table: names, units, and the sampling rate where it is written."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from testbed.problem import InputProblem
from testbed.readers.table import bare_name, simplest_between, unique_names, unit_in_name

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
_UNIT_WORDS = {
    "s",
    "sec",
    "ms",
    "us",
    "µs",
    "μs",
    "n",
    "kn",
    "v",
    "mv",
    "volt",
    "volts",
    "m",
    "mm",
    "um",
    "µm",
    "μm",
    "nm",
    "g",
    "m/s",
    "mm/s",
    "m/s^2",
    "m/s2",
    "m/s²",
    "rad",
    "deg",
    "hz",
    "khz",
    "rpm",
    "-",
    "1",
    "nm/s",
    "in",
    "pa",
    "a",
    "%",
    "°",
    "c",
    "°c",
}


@dataclass(frozen=True)
class Header:
    """Names and units, one a field, and the rate the text states (Hz; None) with its relative rounding error."""

    names: list[str]
    units: list[str]
    named: bool
    sampling_rate: float | None
    rate_tolerance: float
    notes: tuple[str, ...]


def split_fields(line: str, delimiter: str | None) -> list[str]:
    """Fields of a line without blanks and quotes."""
    return [field.strip().strip('"').strip() for field in line.split(delimiter)]


def _uncommented(line: str) -> str:
    return line.lstrip("#%/ ") if line.lstrip().startswith(("#", "%", "//")) else line


def _is_unit_row(fields: list[str]) -> bool:
    filled = [field for field in fields if field]
    if not filled:
        return False
    return all(re.fullmatch(r"[\[(].*[\])]", field) or field.lower() in _UNIT_WORDS for field in filled)


def _fitted(fields: list[str], count: int) -> list[str] | None:
    """Header fields brought to the body's number of fields, None if they cannot belong to it."""
    while len(fields) > count and (not fields[-1] or fields[-1].lower() == "comment"):
        fields = fields[:-1]  # a trailing delimiter, or LabVIEW's column of comments
    if len(fields) == count - 1:
        fields = [*fields, ""]  # the body has a trailing delimiter
    return fields if len(fields) == count else None


def read_header(path: Path, lines: list[str], delimiter: str | None, count: int, decimal_comma: bool) -> Header:
    """Names, units and rate from the lines above a body of `count` fields.

    Raises InputProblem where the header says that a comma delimiter and a decimal comma were mixed.
    """
    notes: list[str] = []
    above = [split_fields(_uncommented(line), delimiter) for line in lines if line.strip()][-4:]
    names, units = None, [""] * count
    unit_row = None
    for fields in reversed(above):
        fitted = _fitted(fields, count)
        if fitted is None:
            if (
                delimiter == ","
                and len(fields) > 1
                and count == 2 * len(fields)
                and names is None
                and unit_row is None
                and not any(_VALUE.fullmatch(field) for field in fields)
            ):
                raise InputProblem(
                    path,
                    f"{len(fields)} names but {count} fields a line: a comma is both delimiter and decimal point",
                    "export with a decimal point or another delimiter",
                )
            break
        if unit_row is None and names is None and _is_unit_row(fitted):
            unit_row = [field.strip("[]()") for field in fitted]
            continue
        if any(field and not _VALUE.fullmatch(field) for field in fitted):
            names = fitted
        break
    if names is None and unit_row is not None:
        names = unit_row
    named = names is not None
    if names is None:
        names = [str(number) for number in range(1, count + 1)]
        notes.append("no header found: columns are named by number from 1")
    units = unit_row if unit_row is not None else [unit_in_name(name) for name in names]
    units = [unit or unit_in_name(name) for unit, name in zip(units, names, strict=True)]
    rate, tolerance = _stated_rate(lines, notes)
    if decimal_comma:
        units = [unit.replace(",", ".") for unit in units]
    return Header(unique_names(names, notes), units, named, rate, tolerance, tuple(notes))


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
