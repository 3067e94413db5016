"""What a number of a column means: the unit that the file or campaign.yaml states, and the factor to SI."""

from __future__ import annotations

from testbed.files.channel_units import channel_unit, is_channel_unit, unit_suffix
from testbed.problem import InputProblem
from testbed.readers.source import Source, base_name
from testbed.readers.table import NO_SPECTRA, Table
from testbed.recording import CHANNEL_UNITS
from testbed.units import UnitProblem

_UNCALIBRATED = ("V", "rad", "1")


def time_factor(table: Table, label: str, source: Source | None, notes: list[str]) -> float:
    """Seconds per unit of the time column. Raises InputProblem for a unit that is no time."""
    text = (source.unit if source and source.unit else None) or table.units.get(label, "")
    if not text and _day_numbers(table, label):
        raise InputProblem(
            table.path,
            f"time column '{label}' begins at {table.columns[label][0]:.10g}, as the day numbers of a spreadsheet do",
            "if it counts days give `unit: h` and `scale: 24` for `time`, else its unit",
        )
    if not text:
        suffix = label.rpartition("_")[2]
        text = suffix if suffix in ("ms", "us", "s", "min") else "s"
        if text != "s" or source is not None:
            notes.append(f"time column '{label}' was read as {text}")
    try:
        unit = channel_unit(text, "s")
    except UnitProblem as problem:
        raise InputProblem(table.path, f"time column '{label}': {problem.what}", "give its unit as s, ms or us") from None
    if unit.si != "s":
        frequency = unit.si == "Hz"
        raise InputProblem(
            table.path,
            f"time column '{label}' is in {text}, which is no time",
            f"{NO_SPECTRA}: give the time record" if frequency else "name the right column, or `time: none`",
        )
    return unit.factor * (source.scale if source else 1.0)


def _day_numbers(table: Table, label: str) -> bool:
    """Whether a column holds days since 1900 with their fractions, of one day between 1955 and 2120."""
    values = table.columns[label]
    return bool(len(values) > 1 and 20e3 < values[0] <= values[-1] < 80e3 and values[-1] - values[0] < 0.5 and values[0] % 1)


def unit_of(table: Table, name: str, source: Source, notes: list[str]) -> tuple[float, str]:
    """Factor to SI and the SI unit of a channel; its own unit where it is uncalibrated."""
    base, label = base_name(name), table.find(source.column)
    wanted, in_file = CHANNEL_UNITS.get(base, "1"), table.units.get(label, "")
    if not in_file or not is_channel_unit(in_file):
        suffix = unit_suffix(label, wanted)
        if suffix and source.unit is None:
            notes.append(f"channel {name}: its unit {suffix} was read from the column's name '{label}'")
        in_file = suffix or in_file
    text = source.unit if source.unit is not None else in_file
    if not text and base == "tachometer":
        return source.scale, "V"
    if not text:
        raise InputProblem(
            table.path,
            f"channel {name}: no unit, neither stated nor in the file",
            f"give `unit: {wanted}`, or `unit: V` for an uncalibrated channel",
        )
    try:
        unit = channel_unit(text, wanted)
    except UnitProblem as problem:
        said = f"channel {name}: {problem.what}" + (f" (column '{label}')" if source.unit is None else "")
        raise InputProblem(table.path, said, problem.do) from None
    if source.unit is not None and in_file:
        _compare_units(name, source, in_file, unit.si, unit.factor, notes)
    if unit.si in _UNCALIBRATED and unit.si != wanted and base != "tachometer":
        shown = "arbitrary units" if unit.si == "1" else unit.si
        notes.append(f"channel {name} is uncalibrated: it stays in {shown}, and so do parameters that depend on it")
    if unit.si == wanted or unit.si in _UNCALIBRATED or base == "tachometer":
        return unit.factor * source.scale, unit.si
    raise InputProblem(
        table.path,
        f"channel {name}: {'an' if base[0] == 'a' else 'a'} {base} cannot be in {text}",
        f"give a unit of {wanted}, or V or rad for an uncalibrated channel",
    )


def _compare_units(name: str, source: Source, in_file: str, si: str, factor: float, notes: list[str]) -> None:
    """A note where the file's own unit is another than the campaign's; with a `scale` they may differ."""
    if not is_channel_unit(in_file):
        return
    theirs = channel_unit(in_file)
    if source.scale == 1.0 and (theirs.si, theirs.factor) != (si, factor):
        notes.append(f"channel {name}: campaign.yaml says {source.unit}, the file {in_file}; that of campaign.yaml was taken")
