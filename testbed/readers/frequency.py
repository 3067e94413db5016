"""Frequency responses of a table: receptance over frequency, from real and imaginary part, or amplitude and phase, in any
of the usual quantities."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from testbed.files.channel_units import channel_unit
from testbed.files.door import readable
from testbed.problem import InputProblem
from testbed.readers.table import Table
from testbed.recording import DERIVATIVES, MOTION_UNITS
from testbed.units import UnitProblem

_EVEN = 1e-3  # of a step, by which lines of even steps may miss
_FEWEST = 16  # lines of a frequency response
_ORDER = {MOTION_UNITS[name]: order for name, order in DERIVATIVES.items()}
_AXES = {1: (1.0, 0.0), -1: (-1.0, 0.0), 2: (0.0, 1.0), -2: (0.0, -1.0)}  # a UFF file's codes
_LABEL = re.compile(r"(?:^|\s)Freq\w*\s+Hz\s+Real\s+(\S+)\s+Imag", re.IGNORECASE)
_LONGEST_LABEL = 4096  # bytes
_EXAMPLES = "m/N, um/N, m/s/N, g/N"


@dataclass(frozen=True)
class Spectrum:
    """A receptance: `values` (lines,) in m/N at `frequency` (Hz, even steps).

    along, sensed: of force and sensor, where the file holds several directions and says which.
    """

    name: str
    frequency: np.ndarray
    values: np.ndarray
    along: tuple[float, float] | None = None
    sensed: tuple[float, float] | None = None


def response_unit(text: str) -> tuple[float, int]:
    """Factor to SI of a unit such as `um/N`, and its motion's order: 0 receptance, 1 mobility, 2 accelerance.

    Raises UnitProblem.
    """
    motion, _, force = text.strip().strip("[]").rpartition("/")
    try:
        if not motion:
            raise UnitProblem("", "")
        top, below = channel_unit(motion.strip().strip("()")), channel_unit(force.strip().strip("()"))
        if top.si not in _ORDER or below.si != "N":
            raise UnitProblem("", "")
    except UnitProblem:
        raise UnitProblem(f"'{text}' is no unit of a frequency response", f"give a motion over a force: {_EXAMPLES}") from None
    return top.factor / below.factor, _ORDER[top.si]


def labelled(path: Path) -> dict[str, tuple[int, str]]:
    """Column (from 1) and unit of each part of a CutPro `.frf` table. Raises InputProblem where it does not say them.

    Its lines hold frequency, real and imaginary part; behind the numbers of the first one stand their names and units.
    """
    with readable(path), path.open("rb") as stream:
        first = stream.readline(_LONGEST_LABEL).decode("latin-1")
    found = _LABEL.search(first)
    try:
        if found is None:
            raise UnitProblem("", "")
        response_unit(found[1])
    except UnitProblem:
        raise InputProblem(path, "does not say what its columns are", "give `frequency`, `real` and `imaginary`, or "
                           "`amplitude` and `phase`, each with its column and unit") from None
    return {"frequency": (1, "Hz"), "real": (2, found[1]), "imaginary": (3, found[1])}


def spectra_of(table: Table, parts: Mapping[str, Any], wanted: str | int | None = None) -> list[Spectrum]:
    """The receptances of a table. parts: the channels that an entry names; none: those that the file itself tells (UFF)."""
    if not parts:
        return _told(table, wanted)
    for pair in (("real", "imaginary"), ("amplitude", "phase")):
        if any(name in parts for name in pair):
            break
    missing = [name for name in ("frequency", *pair) if name not in parts]
    if missing:
        raise InputProblem(table.path, f"a frequency response needs {missing[0]}", f"give `{missing[0]}: {{column: ...}}`")
    columns = {name: _column(table, name, parts[name]) for name in ("frequency", *pair)}
    frequency = columns["frequency"] * _factor(table, "frequency", parts["frequency"], "Hz")
    first = parts[pair[0]]
    text = first.unit or table.units.get(_label(table, pair[0], first), "")
    factor, order = _response_unit(table, pair[0], text, first.scale)
    if pair[0] == "real":
        other = parts["imaginary"]
        again = other.unit or table.units.get(_label(table, "imaginary", other), "") or text
        twice, same = _response_unit(table, "imaginary", again, other.scale)
        if same != order:
            raise InputProblem(table.path, f"real part in {text}, imaginary part in {again}", "give both in one quantity")
        values = columns["real"] * factor + 1j * columns["imaginary"] * twice
    else:
        angle = columns["phase"] * _factor(table, "phase", parts["phase"], "rad")
        values = columns["amplitude"] * factor * np.exp(1j * angle)
    return [_spectrum(table, "", frequency, values, order)]


def _told(table: Table, wanted: str | int | None) -> list[Spectrum]:
    """The frequency responses of a universal file."""
    names = [name.removesuffix(" re") for name in table.columns if name.endswith(" re") and name in table.spectra]
    if not names:
        raise InputProblem(table.path, "holds columns over frequency", "name them: `frequency`, `real` and `imaginary`, or "
                           "`amplitude` and `phase`, each with its column and unit")
    if wanted is not None:
        names = [name for name in names if name == str(wanted)] or [table.find(f"{wanted} re").removesuffix(" re")]
    chosen = [name for name in names if table.spectra[name] == "a frequency response"]
    if not chosen:
        raise InputProblem(table.path, f"holds {table.spectra[names[0]]}, no frequency response", "export functions of type 4")
    codes = [table.directions.get(name, (0, 0)) for name in chosen]
    several = len(set(codes)) > 1 and all(first and second for first, second in codes)
    if several:  # what points out of the plane is none of a cut's
        chosen = [name for name, pair in zip(chosen, codes, strict=True) if all(abs(one) in (1, 2) for one in pair)]
        if not chosen:
            raise InputProblem(table.path, "no frequency response lies in the plane of x and y", "export those of x and y")
    found = []
    for name in chosen:
        factor, order = _response_unit(table, name, table.units.get(f"{name} re", ""), None)
        values = (table.columns[f"{name} re"] + 1j * table.columns[f"{name} im"]) * factor
        one = _spectrum(table, name, table.columns["frequency"], values, order)
        sensed, along = (_AXES.get(code) if several else None for code in table.directions.get(name, (0, 0)))
        found.append(replace(one, along=along, sensed=sensed))
    return found


def _label(table: Table, name: str, channel: Any) -> str:
    return table.find(name if channel.column is None else channel.column)


def _column(table: Table, name: str, channel: Any) -> np.ndarray:
    try:
        return table.columns[_label(table, name, channel)]
    except InputProblem as problem:
        raise InputProblem(table.path, f"{name}: {problem.what}", problem.do) from None


def _factor(table: Table, name: str, channel: Any, si: str) -> float:
    text = channel.unit or table.units.get(_label(table, name, channel), "") or ("Hz" if si == "Hz" else "")
    try:
        unit = channel_unit(text, si) if text else None
    except UnitProblem as problem:
        raise InputProblem(table.path, f"{name}: {problem.what}", problem.do) from None
    if unit is None or unit.si != si:
        example = "Hz" if si == "Hz" else "deg"
        raise InputProblem(table.path, f"{name}: {f'cannot be in {text}' if text else 'no unit'}", f"give `unit: {example}`")
    return unit.factor * (channel.scale or 1.0)


def _response_unit(table: Table, name: str, text: str, scale: float | None) -> tuple[float, int]:
    if not text:
        raise InputProblem(table.path, f"{name}: no unit, neither stated nor in the file", f"give `unit`: {_EXAMPLES}")
    try:
        factor, order = response_unit(text)
    except UnitProblem as problem:
        raise InputProblem(table.path, f"{name}: {problem.what}", problem.do) from None
    return factor * (scale or 1.0), order


def _spectrum(table: Table, name: str, frequency: np.ndarray, values: np.ndarray, order: int) -> Spectrum:
    """Even steps, no line at 0, no line that is no number."""
    if len(frequency) != len(values):
        raise InputProblem(table.path, f"{len(frequency)} frequencies for {len(values)} lines", "export them together")
    steps = np.diff(frequency)
    if len(frequency) < _FEWEST or not np.all(steps > 0):
        raise InputProblem(table.path, f"frequencies do not rise, or are fewer than {_FEWEST}", "check the column of frequency")
    step = float(np.median(steps))
    if np.abs(steps - step).max() > max(_EVEN * step, 2e-6 * float(frequency[-1])):
        raise InputProblem(table.path, "frequencies stand at uneven steps", "export the response at even steps")
    kept = (frequency > 0) & np.isfinite(values)
    even = frequency[kept][0] + step * np.arange(np.count_nonzero(kept))
    if not np.all(np.isfinite(values[frequency > 0])):
        bad = np.count_nonzero(~np.isfinite(values))
        raise InputProblem(table.path, f"{bad} lines are no number", "leave them out, or export it again")
    return Spectrum(name, even, values[kept] / (2j * np.pi * even) ** order)
