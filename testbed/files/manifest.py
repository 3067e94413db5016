"""The form of campaign.yaml: which keys it has and what they may hold; every mistake is said with its line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field

from testbed.files.channel_units import channel_unit
from testbed.files.yaml_text import SAMPLING_RATE, Document, Strict, above_zero, at_least_zero, did_you_mean, quantity
from testbed.machine import MOST_FLUTES, Carrier
from testbed.readers.source import Source, base_name
from testbed.readers.table import NO_SPECTRA
from testbed.recording import CHANNEL_UNITS, MOTIONS
from testbed.units import UnitProblem, parse_quantity, refuse_decimal_comma, spelled

Kind = Literal["cut", "ring-down", "excited", "idle"]
FASTEST = 1e5  # rad/s: no spindle turns as fast
DEEPEST = 0.5  # m: no cut is as deep
CHANNELS = (*CHANNEL_UNITS, "time")


@dataclass(frozen=True)
class Feed:
    """A feed as it was written: value (m) a tooth, a revolution, or (m/s) of travel."""

    value: float
    per: Literal["tooth", "revolution", "second"]

    def per_revolution(self, spindle_speed: float) -> float | None:
        """Feed a revolution, m; None where it was given a tooth. spindle_speed in rad/s."""
        if self.per == "tooth":
            return None
        return self.value if self.per == "revolution" else self.value * 2 * math.pi / spindle_speed

    def per_tooth(self, spindle_speed: float, flutes: int) -> float:
        """Feed a tooth, m."""
        turn = self.per_revolution(spindle_speed)
        return self.value if turn is None else turn / flutes


def _feed(value: object) -> Feed:
    """A feed in mm/tooth, mm/rev or mm/min. Raises UnitProblem."""
    refuse_decimal_comma(value)
    text = spelled(str(value))
    for word in ("/revolution", "/rev", "/r", "/turn"):
        if text.endswith(word):
            number = parse_quantity(text.removesuffix(word) + "/tooth", "m/tooth")
            return _positive(value, Feed(number, "revolution"))
    if text.endswith(("/min", "/s")):
        return _positive(value, Feed(parse_quantity(text, "m/s"), "second"))
    try:
        number = parse_quantity(text, "m/tooth")
    except UnitProblem:
        raise UnitProblem(f"'{value}' is no feed", "write it as '0.1 mm/tooth', '0.1 mm/rev' or '300 mm/min'") from None
    return _positive(value, Feed(number, "tooth"))


def _positive(value: object, feed: Feed) -> Feed:
    if feed.value <= 0:
        raise UnitProblem(f"'{value}' must be above 0", "correct the value")
    return feed


def as_seconds(value: object) -> float:
    """A time in seconds: a bare number, or a text with its unit."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        value = f"{value!r} s"
    return parse_quantity(value, "s")


def _whole(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise UnitProblem(f"'{value}' is not a whole number of at least 1", "correct the value")
    return value


def _flutes(value: object) -> int:
    if _whole(value) > MOST_FLUTES:
        raise UnitProblem(f"'{value}' is more than any cutter has", f"give 1 to {MOST_FLUTES}")
    return _whole(value)


def _speed(number: float) -> str | None:
    return above_zero(number) or ("is faster than any spindle: is the unit right?" if number > FASTEST else None)


def _depth(number: float) -> str | None:
    return at_least_zero(number) or ("lies beyond 500 mm: is the unit right?" if number > DEEPEST else None)


def as_rows(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise UnitProblem(f"'{value}' is not a number of lines", "give a whole number of at least 0")
    return value


def as_column(value: object) -> int | str | None:
    if isinstance(value, bool) or not isinstance(value, (int, str, type(None))):
        raise UnitProblem(f"'{value}' is no column", "give its name, or its number from 1")
    return value


def as_key(value: object) -> object:
    """A key; the number of a capture may stand without quotes."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


def as_factor(value: object) -> float:
    """A factor; of 0 no channel would be left. Raises UnitProblem."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool) and 0.0 < abs(value) < 1e300
    if not number:
        raise UnitProblem(f"'{value}' is no factor", "give a number other than 0, the unit per value of the column")
    return float(value)  # type: ignore[arg-type]


class ChannelEntry(Strict):
    """One channel: where it stands in the file and what a number of it means."""

    column: Annotated[Any, BeforeValidator(as_column)] = None
    unit: str | None = None
    scale: Annotated[float, BeforeValidator(as_factor)] | None = None
    pulses_per_revolution: Annotated[int, BeforeValidator(_whole)] | None = None
    edge: Literal["rising", "falling"] | None = None
    file: str | None = None
    key: Annotated[str | None, BeforeValidator(as_key)] = None
    on: Carrier | None = None


def _unless_none(value: object) -> object:
    """`none` as no entry: a union of the two would put its own name into the place that a message names."""
    return None if value == "none" else value


Channels = dict[str, Annotated[ChannelEntry | None, BeforeValidator(_unless_none)]]


class _Conditions(Strict):
    """Operating conditions and ways of reading; the campaign gives what its records share."""

    model_config = ConfigDict(populate_by_name=False)

    channels: Channels = Field(default_factory=dict)
    sampling_rate: Annotated[float, SAMPLING_RATE] | None = None
    spindle_speed: quantity("rad/s", _speed) | None = None  # type: ignore[valid-type]
    depth_of_cut: quantity("m", _depth) | None = None  # type: ignore[valid-type]
    feed: Annotated[Feed, BeforeValidator(_feed)] | None = None
    flutes: Annotated[int, BeforeValidator(_flutes)] | None = None
    length_cut_before: quantity("m", at_least_zero) | None = None  # type: ignore[valid-type]
    skip_rows: Annotated[int, BeforeValidator(as_rows)] | None = None
    delimiter: str | None = None
    key: Annotated[str | None, BeforeValidator(as_key)] = None


class RecordEntry(_Conditions):
    """One record."""

    file: str
    kind: Kind
    name: str | None = None
    note: str | None = None
    from_: Annotated[float, BeforeValidator(as_seconds)] | None = Field(default=None, alias="from")
    to: Annotated[float, BeforeValidator(as_seconds)] | None = None


def _listed_records(value: object) -> object:
    """The list under `records`. Raises UnitProblem where there is none."""
    example = "{file: cut_1.csv, kind: cut, spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm, feed: 0.1 mm/tooth}"
    if value is None:
        raise UnitProblem("holds no record", f"write under it, one line a record, `- {example}`")
    if not isinstance(value, list):
        raise UnitProblem("is no list of records", f"begin each record with a dash: `- {example}`")
    return value


class ManifestEntry(_Conditions):
    """The whole file."""

    name: str
    note: str | None = None
    folder: str | None = None
    records: Annotated[list[RecordEntry], BeforeValidator(_listed_records)] = Field(min_length=1)


def check_channels(document: Document, manifest: ManifestEntry) -> None:
    """Raises InputProblem at the first channel whose name or unit is not known."""
    places: list[tuple[tuple[str | int, ...], Channels]] = [(("channels",), manifest.channels)]
    places += [(("records", index, "channels"), record.channels) for index, record in enumerate(manifest.records)]
    for path, channels in places:
        for name, entry in channels.items():
            if name in ("frequency", "real", "imaginary"):
                what = f"'{name}' is no channel of a record: {NO_SPECTRA}"
                raise document.problem((*path, name), what, "give the time record")
            if base_name(name) not in CHANNELS:
                raise document.problem((*path, name), f"unknown channel '{name}'", did_you_mean(name, CHANNELS))
            if isinstance(entry, ChannelEntry) and entry.unit is not None:
                try:
                    channel_unit(entry.unit, CHANNEL_UNITS.get(base_name(name), "s"))
                except UnitProblem as problem:
                    raise document.problem((*path, name, "unit"), problem.what, problem.do) from None
            if name == "time" and isinstance(entry, ChannelEntry) and (entry.file or entry.key):
                do = "every file has its own time column: remove them"
                raise document.problem((*path, name), "'time' has file or key", do)
            if isinstance(entry, ChannelEntry) and entry.on is not None and base_name(name) not in MOTIONS:
                raise document.problem((*path, name, "on"), f"'{name}' is no motion", "remove it")
            if name != "tachometer" and isinstance(entry, ChannelEntry) and (entry.pulses_per_revolution or entry.edge):
                raise document.problem(
                    (*path, name), f"'{name}' has pulses_per_revolution or edge", "these belong to the tachometer"
                )


def sources(manifest: ManifestEntry, record: RecordEntry) -> tuple[dict[str, Source], Source | None | Literal["none"]]:
    """Channels of one record, the campaign's overridden key by key; and its time column."""
    result: dict[str, Source] = {}
    time: Source | None | Literal["none"] = None
    for name in dict.fromkeys([*manifest.channels, *record.channels]):
        common, own = manifest.channels.get(name), record.channels.get(name, "inherit")
        chosen = common if own == "inherit" else own
        if chosen is None:
            time = "none" if name == "time" else time
            continue
        merged: dict[str, Any] = {}
        for entry in (common, own):
            if isinstance(entry, ChannelEntry):
                merged.update({key: value for key, value in entry.model_dump().items() if value is not None})
        source = Source(**{"column": name, **merged})
        if name == "time":
            time = source
        else:
            result[name] = source
    return result, time
