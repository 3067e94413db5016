"""LabVIEW's measurement files (LVM), text with a header of its own: units a channel, and one or more captures.

Format: NI, "Specification for the LabVIEW Measurement File (.lvm)". A file may hold several captures, under a header each or
under one; which rows are one capture's, the header's number of samples says.
"""

from __future__ import annotations

import contextlib
from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbed.problem import InputProblem
from testbed.readers.lines import Lines, written
from testbed.readers.table import listed

FIRST_LINE = "LabVIEW Measurement"
_END = "***End_of_Header***"


@dataclass(frozen=True)
class Capture:
    """One capture of a file: its lines' numbers from 0, of the header and of the rows, and what its header says."""

    head: range
    rows: np.ndarray
    facts: dict[str, list[str]]
    samples: int


@dataclass(frozen=True)
class Chosen:
    """The file's lines with those of other captures blank, the units by column, whether X is a frequency, and notes."""

    lines: Lines
    units: list[str]
    over_frequency: bool
    notes: tuple[str, ...]


def choose(path: Path, lines: Lines, key: str | None) -> Chosen:
    """The capture that `key` names (`1`, `2`, ... or `all`), else the first, with a note where there are more.

    Raises InputProblem for a capture that is not there, and for channels at different rates.
    """
    separator = "," if any(line.startswith("Separator,") for line in lines[:20]) else "\t"
    ends = [number for number, line in enumerate(lines) if line.startswith(_END)]
    captures = _captures(lines, ends, separator) if len(ends) > 1 else []
    if not captures:
        return Chosen(lines, [], False, ())
    wanted, notes = _wanted(path, captures, key)
    facts = wanted[0].facts
    steps = {step for step in facts.get("Delta_X", []) if step}
    if len(steps) > 1 and facts["X_Columns"] == ["No"]:
        raise InputProblem(
            path, f"channels sampled at different steps ({listed(sorted(steps), '')})",
            "export them with X columns, or at one rate",
        )  # fmt: skip
    kept = np.zeros(len(lines), dtype=bool)
    kept[: ends[0] + 1] = kept[wanted[0].head.start : wanted[0].head.stop] = True
    for capture in wanted:
        kept[capture.rows] = True
    cut = {}
    if facts["names"][-1:] == ["Comment"]:  # the words behind the numbers of a capture's first row
        for row in (int(capture.rows[0]) for capture in wanted if len(capture.rows)):
            cut[row] = separator.join(lines[row].split(separator)[: len(facts["names"]) - 1])
    blanked = written(cut.get(number, line) if kept[number] else "" for number, line in enumerate(lines))
    units = ["", *facts.get("Y_Unit_Label", [])]
    return Chosen(blanked, units, "Frequency" in facts.get("X_Dimension", []), tuple(notes))


def _wanted(path: Path, captures: list[Capture], key: str | None) -> tuple[list[Capture], list[str]]:
    count = len(captures)
    if key is not None and key.strip().lower() == "all":
        if len({tuple(capture.facts["names"]) for capture in captures}) > 1:
            raise InputProblem(path, "its captures have different channels", f"name one: `key: 1` to `key: {count}`")
        return captures, [f"{count} captures were joined as one, as `key: all` asks"] if count > 1 else []
    if key is not None and not (key.strip().isdigit() and 1 <= int(key) <= count):
        raise InputProblem(path, f"no capture '{key}'", f"the file holds {count}: give a number from 1, or `key: all`")
    number = int(key) if key else 1
    chosen, notes = captures[number - 1], []
    if count > 1:
        notes.append(
            f"the file holds {count} captures of {', '.join(str(len(one.rows)) for one in captures[:6])}"
            f"{', ...' * (count > 6)} samples: number {number} was read; `key: 2` reads the second, `key: all` joins them"
        )
    if len(chosen.rows) < chosen.samples:
        notes.append(
            f"the header says {chosen.samples} samples, the capture has {len(chosen.rows)}: the file may be incomplete"
        )
    return [chosen], notes


def _captures(lines: Lines, ends: list[int], separator: str) -> list[Capture]:
    """The captures below every header but the file's own."""
    columns = next((line.split(separator)[1:2] for line in lines[:40] if line.startswith("X_Columns")), ["No"])
    heads = [next((at for at in range(end, ends[0], -1) if lines[at].startswith("Channels")), end) for end in ends[1:]]
    found = []
    for end, head, stop in zip(ends[1:], heads, [*heads[1:], len(lines)], strict=True):
        facts = {"X_Columns": [item.strip() for item in columns]}
        for line in lines[head:end]:
            name, *values = (field.strip() for field in line.split(separator))
            facts[name] = values
        facts["names"] = [name.strip() for name in lines[end + 1].split(separator)] if end + 1 < len(lines) else []
        rows, special = array("I"), False
        for number, line in enumerate(lines[end + 2 : stop], end + 2):
            special = (special or line.startswith("***Start_Special")) and not line.startswith("***End_Special")
            if line.strip() and not special and not line.startswith("***"):
                rows.append(number)
        samples = max((int(value) for value in facts.get("Samples", []) if value.isdigit()), default=0)
        found += [
            Capture(range(head, end + 2), part, facts, samples)
            for part in _parts(lines, np.array(rows), samples, facts, separator)
        ]
    return found


def _parts(lines: Lines, rows: np.ndarray, samples: int, facts: dict[str, list[str]], separator: str) -> list[np.ndarray]:
    """The rows below one header, split into captures unless the X column goes on evenly from one to the next."""
    if not samples or len(rows) <= samples:
        return [rows]
    if facts["X_Columns"] != ["No"]:
        with contextlib.suppress(ValueError):
            times = np.array(array("d", (float(line.split(separator)[0].replace(",", ".")) for line in lines[rows])))
            steps = np.diff(times)
            if (np.abs(steps[samples - 1 :: samples] - np.median(steps)) < 0.5 * np.median(steps)).all():
                return [rows]
    return [rows[first : first + samples] for first in range(0, len(rows), samples)]
