"""taps.yaml: hammer records and frequency responses, read, checked and brought to SI."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from testbed.files.manifest import as_column, as_factor, as_key, as_rows, as_seconds
from testbed.files.structure_file import as_direction
from testbed.files.yaml_text import SAMPLING_RATE, Document, Strict, above_zero, in_unit, load, validate
from testbed.machine import Carrier, unit_vector
from testbed.problem import InputProblem
from testbed.readers import Table, neighbours, read_table
from testbed.readers.assemble import assemble
from testbed.readers.frequency import Spectrum, labelled, spectra_of
from testbed.readers.join import joined
from testbed.readers.source import Source
from testbed.recording import MOTION_UNITS, Recording

Quantity = Literal["displacement", "velocity", "acceleration"]
_BAND = 2  # ends of a band
_SI = {unit: name for name, unit in MOTION_UNITS.items()}


class TapChannel(Strict):
    """One column of a tap's file: of its force, its time, or a part of a frequency response."""

    column: Annotated[Any, BeforeValidator(as_column)] = None
    unit: str | None = None
    scale: Annotated[float, BeforeValidator(as_factor)] | None = None
    file: str | None = None
    key: Annotated[str | None, BeforeValidator(as_key)] = None


class TapResponse(TapChannel):
    """The column of a response: what it measures and, where that is not the force's direction, along which axis."""

    quantity: Quantity | None = None
    direction: Annotated[float | None, BeforeValidator(as_direction)] = None


class _Shared(Strict):
    """What the taps of a file share, or one gives for itself."""

    on: Carrier | None = None
    force: TapChannel | None = None
    response: TapResponse | None = None
    time: TapChannel | None = None
    sampling_rate: Annotated[float | None, SAMPLING_RATE] = None
    exponential_window: Annotated[float | None, in_unit("s", above_zero)] = None
    sensor_mass: Annotated[float | None, in_unit("kg", above_zero)] = None
    skip_rows: Annotated[int | None, BeforeValidator(as_rows)] = None
    delimiter: str | None = None
    key: Annotated[str | None, BeforeValidator(as_key)] = None


class TapEntry(_Shared):
    """One tap: a record of blows, with or without their force, or a frequency response."""

    file: str
    direction: Annotated[float, BeforeValidator(as_direction)]
    from_: Annotated[float | None, BeforeValidator(as_seconds)] = Field(default=None, alias="from")
    to: Annotated[float | None, BeforeValidator(as_seconds)] = None
    frequency: TapChannel | None = None
    real: TapChannel | None = None
    imaginary: TapChannel | None = None
    amplitude: TapChannel | None = None
    phase: TapChannel | None = None


class TapsEntry(_Shared):
    """The whole file."""

    name: str | None = None
    note: str | None = None
    folder: str | None = None
    band: Annotated[list[Annotated[float, in_unit("Hz", above_zero)]] | None, Field(min_length=_BAND, max_length=_BAND)] = None
    taps: list[TapEntry] = Field(min_length=1)


@dataclass(frozen=True)
class Tap:
    """One tap in SI: a record of force and response, or a measured frequency response.

    along, sensed: unit vectors (x, y) of force and sensor. record: channels `force`, if it was measured, and the quantity.
    spectrum: the receptance. window: 1/s, of the exponential window that the response came with. sensor_mass: kg. source: the
    stretch of a file that it comes from; channels of one stretch were measured together.
    """

    name: str
    along: tuple[float, float]
    sensed: tuple[float, float]
    on: Carrier
    record: Recording | None = None
    quantity: Quantity = "acceleration"
    spectrum: Spectrum | None = None
    window: float = 0.0
    sensor_mass: float = 0.0
    notes: tuple[str, ...] = ()
    source: str = ""

    @property
    def without_force(self) -> bool:
        """Whether it is a record of what rings alone."""
        return self.record is not None and "force" not in self.record.channels


@dataclass(frozen=True)
class Taps:
    """All taps of a file, and the band (Hz) that it asks for."""

    name: str
    taps: tuple[Tap, ...]
    band: tuple[float, float] | None = None
    file: Path = field(default=Path())


def load_taps(path: str | Path, folder: str | Path | None = None) -> Taps:
    """Read taps.yaml and every file it names. Raises InputProblem with the line, or with the place in a data file."""
    path = Path(path)
    document = load(path)
    given = validate(document, TapsEntry)
    if given.band is not None and given.band[0] >= given.band[1]:
        raise document.problem(("band",), "does not rise", "give the lower end first")
    home = (Path(folder) if folder is not None else path.parent) / (given.folder or "")
    taps: list[Tap] = []
    for place, entry in enumerate(given.taps):
        taps += _read(_Reading(document, home, given, entry, ("taps", place)))
    return Taps(given.name or path.stem, tuple(taps), tuple(given.band) if given.band else None, path)  # type: ignore[arg-type]


@dataclass(frozen=True)
class _Reading:
    """One entry with what it takes from the whole file."""

    document: Document
    home: Path
    common: TapsEntry
    entry: TapEntry
    place: tuple[str | int, ...]
    read: dict[tuple[str, str | None], Table] = field(default_factory=dict)  # by file and key: force and response share one

    def value(self, name: str) -> Any:
        """The entry's own value, else the file's; of a channel, key by key."""
        own, common = getattr(self.entry, name), getattr(self.common, name, None)
        if isinstance(own, TapChannel) and isinstance(common, TapChannel):
            merged = {**common.model_dump(exclude_none=True), **own.model_dump(exclude_none=True)}
            return type(own).model_construct(**{**type(own)().model_dump(), **merged})
        return own if own is not None else common

    def table(self, channel: TapChannel | None = None, at: str = "") -> Table:
        """The table of the entry's file, or of the channel's own."""
        name = (channel.file if channel else None) or self.entry.file
        key = (channel.key if channel else None) or self.value("key")
        if (name, key) in self.read:
            return self.read[name, key]
        try:
            found = read_table(self.home / name, skip_rows=self.value("skip_rows") or 0, delimiter=self.value("delimiter"),
                               key=key)
        except InputProblem:
            if not os.path.exists(self.home / name):
                where = (*self.place, *((at,) if channel and channel.file else ()), "file")
                do = neighbours(self.home / name) or "check the path in the file"
                raise self.document.problem(where, f"no such file {name}", do) from None
            raise
        return self.read.setdefault((name, key), found)

    def problem(self, what: str, do: str, *at: str) -> InputProblem:
        """A complaint about this entry."""
        return self.document.problem((*self.place, *at), what, do)


def _read(reading: _Reading) -> list[Tap]:
    entry = reading.entry
    force, response = reading.value("force"), reading.value("response")
    parts = [name for name in ("frequency", "real", "imaginary", "amplitude", "phase") if getattr(entry, name) is not None]
    along = unit_vector(entry.direction)
    turned = response.direction if response is not None else None
    sensed = along if turned is None else unit_vector(turned)
    window = reading.value("exponential_window")
    shared: dict[str, Any] = {"on": reading.value("on") or "workpiece", "window": 1.0 / window if window else 0.0,
              "sensor_mass": reading.value("sensor_mass") or 0.0,
              "source": f"{entry.file} {entry.from_} {entry.to}"}
    name = Path(entry.file).stem
    if not parts and (entry.force is not None or entry.response is not None):
        record, quantity, notes = _record(reading, force, response)
        return [Tap(name, along, sensed, record=record, quantity=quantity, notes=notes, **shared)]
    table = reading.table()
    named = {part: getattr(entry, part) for part in parts}
    notes = table.notes
    if not parts and Path(entry.file).suffix.lower() == ".frf":
        said = labelled(table.path)
        named = {part: TapChannel(column=column, unit=unit) for part, (column, unit) in said.items()}
        notes = (f"read as frequency, real and imaginary part in {said['real'][1]}, as its first line says",)
    if named or table.spectra:
        found = spectra_of(table, named, response.column if response else None)
        return [Tap(f"{name} {one.name}".strip() if len(found) > 1 else name, one.along or along, one.sensed or sensed,
                    spectrum=one, notes=notes, **shared) for one in found]
    record, quantity, notes = _record(reading, force, response)
    return [Tap(name, along, sensed, record=record, quantity=quantity, notes=notes, **shared)]


def _record(reading: _Reading, force: TapChannel | None,
            response: TapResponse | None) -> tuple[Recording, Quantity, tuple[str, ...]]:
    """Force, if it is given, and response of a record of blows."""
    if response is None:
        raise reading.problem("a record of blows needs its response", "give `response: {column: ..., unit: g, quantity: "
                              "acceleration}`, and `force` if it was measured, or, of a frequency response, `frequency`, "
                              "`real` and `imaginary`")
    if force is None:
        return _decay(reading, response)
    tables = {"force": reading.table(force, "force"), "response": reading.table(response, "response")}
    quantity = _quantity(reading, response, tables["response"])
    sources = {"force": _source(force, "force"), quantity: _source(response, "response")}
    time = None if reading.value("time") is None else _source(reading.value("time"), "time")
    table = tables["force"]
    same = (force.file, force.key) == (response.file, response.key)
    if not same:
        table, sources = joined(table, sources, {"force": table, quantity: tables["response"]}, time)
    recording, notes = assemble(table, sources, time=time, sampling_rate=reading.value("sampling_rate"),
                                start=reading.entry.from_, stop=reading.entry.to)
    for channel, unit in recording.units.items():
        if unit != ("N" if channel == "force" else MOTION_UNITS[quantity]):
            at = "force" if channel == "force" else "response"
            raise reading.problem(f"the {at} is not calibrated ({unit}): no mass follows from it",
                                  "give its unit, with `scale` where the file holds volts", at, "unit")
    return recording, quantity, notes


def _decay(reading: _Reading, response: TapResponse) -> tuple[Recording, Quantity, tuple[str, ...]]:
    """The response alone, of blows whose force nobody measured."""
    table = reading.table(response, "response")
    quantity = _quantity(reading, response, table)
    time = None if reading.value("time") is None else _source(reading.value("time"), "time")
    recording, notes = assemble(table, {quantity: _source(response, "response")}, time=time,
                                sampling_rate=reading.value("sampling_rate"), start=reading.entry.from_, stop=reading.entry.to)
    return recording, quantity, notes


def _source(channel: TapChannel, name: str) -> Source:
    return Source(name if channel.column is None else channel.column, channel.unit, channel.scale or 1.0, key=channel.key)


def _quantity(reading: _Reading, response: TapResponse, table: Table) -> Quantity:
    """What a response measures: as stated, else as its unit says."""
    from testbed.files.channel_units import channel_unit, is_channel_unit

    if response.quantity is not None:
        return response.quantity
    unit = response.unit or table.units.get(table.find(response.column or "response"), "")
    si = channel_unit(unit).si if is_channel_unit(unit) else ""
    if si not in _SI:
        raise reading.problem("does not say what it measures", "give `quantity: acceleration`, velocity or displacement",
                              "response")
    return _SI[si]  # type: ignore[return-value]

