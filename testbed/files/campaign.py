"""A measuring campaign: campaign.yaml and the recordings it names, read, checked and brought to SI."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from testbed.cut import Cut
from testbed.files.manifest import Feed, Kind, ManifestEntry, RecordEntry, check_channels, sources
from testbed.files.yaml_text import Document, load, validate
from testbed.problem import InputProblem
from testbed.readers import Table, checks, has_variables, neighbours, read_table
from testbed.readers.assemble import assemble
from testbed.readers.join import joined
from testbed.recording import Recording

_SHARED = ("spindle_speed", "depth_of_cut", "feed", "flutes", "length_cut_before", "sampling_rate", "skip_rows", "delimiter",
           "key")  # fmt: skip
_RESPONSES = ("displacement", "velocity", "acceleration")
_DRIVES = ("force", "force_x", "force_y")


@dataclass(frozen=True, repr=False)
class Record:
    """One measured record.

    kind: cut, ring-down, excited or idle. recording: channels in SI (an uncalibrated one in its own unit).
    conditions (SI, only what is known): spindle_speed rad/s, axial_depth_of_cut m, feed_per_tooth m,
    feed_per_revolution m, flutes, length_cut_before m. feed: as the manifest wrote it. notes: what is
    doubtful or was mended.
    """

    name: str
    kind: Kind
    recording: Recording
    conditions: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    file: Path = Path()
    feed: Feed | None = None

    def __repr__(self) -> str:
        return f"<Record: {self.name}, {self.kind}, {self.recording!r}>"

    def feed_per_tooth(self, flutes: int) -> float:
        """Feed a tooth (m) for a cutter of `flutes`. Raises InputProblem where the record states no feed."""
        if self.feed is None:
            raise InputProblem(self.file, f"record '{self.name}' states no feed", "give `feed: 0.1 mm/tooth`")
        return self.feed.per_tooth(self.conditions.get("spindle_speed", float("nan")), flutes)

    def cut(self, flutes: int, **timeline: Any) -> Cut:
        """The operating conditions as a Cut of a cutter with `flutes`; `timeline` gives its passes.

        Raises InputProblem where the record is no cut, or the manifest and the model disagree about the flutes.
        """
        if self.kind != "cut":
            raise InputProblem(self.file, f"record '{self.name}' is {self.kind}, not a cut", "give `kind: cut`")
        stated = self.conditions.get("flutes")
        if stated is not None and stated != flutes:
            raise InputProblem(
                self.file,
                f"record '{self.name}' was cut with {stated} flutes, the model has {flutes}",
                "correct either",
            )
        return Cut(
            self.conditions["spindle_speed"],
            self.conditions["axial_depth_of_cut"],
            self.feed_per_tooth(flutes),
            length_cut_before=self.conditions.get("length_cut_before", 0.0),
            **timeline,
        )

    @property
    def responses(self) -> tuple[str, ...]:
        """Channels that move: displacement, velocity and acceleration, numbered ones after them."""
        return tuple(name for name in self.recording.channels if name.split("_")[0] in _RESPONSES)

    @property
    def excitations(self) -> tuple[str, ...]:
        """Measured forces."""
        return tuple(
            name
            for name in self.recording.channels
            if any(name == drive or name.startswith(f"{drive}_") for drive in _DRIVES)
        )


@dataclass(frozen=True, repr=False)
class Campaign:
    """What was measured: a name and its records. file: the manifest it came from."""

    name: str
    records: tuple[Record, ...]
    file: Path = Path()

    def __repr__(self) -> str:
        return f"<Campaign: {self.name}, {len(self.records)} records, {self.file}>"

    def record(self, name: str) -> Record:
        """The record of a name; KeyError."""
        for record in self.records:
            if record.name == name:
                return record
        raise KeyError(name)

    @property
    def notes(self) -> tuple[str, ...]:
        """All records' notes, each with its record's name."""
        return tuple(f"{record.name}: {note}" for record in self.records for note in record.notes)


def load_campaign(path: str | Path, folder: str | Path | None = None) -> Campaign:
    """Read a manifest and every file it names.

    Files are looked for beside the manifest or in `folder`, there in the manifest's own `folder:`. Raises InputProblem with
    the line for the manifest, with the place for a data file.
    """
    path = Path(path)
    document = load(path)
    manifest = validate(document, ManifestEntry)
    check_channels(document, manifest)
    home = Path(folder) if folder is not None else path.parent
    records: list[Record] = []
    for index, entry in enumerate(manifest.records):
        name = _name(document, index, entry, records)
        records.append(_record(document, manifest, index, entry, name, home))
    if manifest.key is not None and not any(has_variables(record.file) for record in records):
        raise document.problem(("key",), "no record's file has variables that a key could name", "remove `key`")
    return Campaign(manifest.name, tuple(_doubles_noted(records)), path)


def _doubles_noted(records: list[Record]) -> list[Record]:
    """The records, with a note at each that holds the samples of one before it: by a file named twice, or by a copy."""
    noted: list[Record] = []
    for record in records:
        first = next((other for other in noted if _same_samples(record.recording, other.recording)), None)
        if first is not None:
            said = f"holds the same samples as record '{first.name}': counted twice, neither is held out of its own fit"
            record = replace(record, notes=(*record.notes, said))
        noted.append(record)
    return noted


def _same_samples(one: Recording, other: Recording) -> bool:
    shared = [name for name in one.channels if name in other.channels and not name.startswith("tachometer")]
    return bool(shared) and all(np.array_equal(one.channels[name], other.channels[name]) for name in shared)


def _name(document: Document, index: int, entry: RecordEntry, others: list[Record]) -> str:
    """The record's name: as given, else its file's stem, numbered where a file is read more than once."""
    taken = {record.name for record in others}
    if entry.name is not None:
        if entry.name in taken:
            raise document.problem(
                ("records", index, "name"), f"'{entry.name}' names two records", "give each its own name"
            )
        return entry.name
    stem = Path(entry.file).stem
    name, number = stem, 2
    while name in taken:
        name, number = f"{stem}_{number}", number + 1
    return name


def _record(
    document: Document,
    manifest: ManifestEntry,
    index: int,
    entry: RecordEntry,
    name: str,
    home: Path,
) -> Record:
    place = ("records", index)
    shared = {
        key: getattr(entry, key) if getattr(entry, key) is not None else getattr(manifest, key) for key in _SHARED
    }
    channels, time = sources(manifest, entry)
    if not channels:
        raise document.problem(
            place, "no channel is named for this record", "give `channels: {displacement: {column: ..., unit: um}}`"
        )
    _needed(document, place, entry, shared, tuple(channels))
    if entry.from_ is not None and entry.to is not None and entry.to <= entry.from_:
        raise document.problem(
            (*place, "to"), f"to ({entry.to:g} s) is not after from ({entry.from_:g} s)", "correct them"
        )
    folder = home / (manifest.folder or "")
    file = folder / entry.file
    tables: dict[tuple[str, str | None], Table] = {}
    of: dict[str, tuple[str, str | None]] = {}
    for channel, source in channels.items():
        of[channel] = (source.file or entry.file, source.key or shared["key"])
        above = place if channel in entry.channels else ()
        at = place if source.file is None else (*above, "channels", channel)
        if of[channel] not in tables:
            tables[of[channel]] = _table(document, (*at, "file"), folder, *of[channel], home, shared)
    if entry.key is not None and not has_variables(file):
        raise document.problem((*place, "key"), f"{entry.file} has no variables that a key could name", "remove `key`")
    table = tables.get((entry.file, shared["key"]), next(iter(tables.values())))
    if len(tables) > 1:
        table, channels = joined(table, channels, {channel: tables[of[channel]] for channel in channels}, time)
    optional: tuple[str, ...] = () if entry.kind == "cut" else ("tachometer",)
    if entry.kind == "ring-down":
        optional += tuple(channel for channel in channels if channel.startswith("force"))
    if entry.kind == "idle":
        optional += tuple(channel for channel in channels if channel.startswith("force"))
    conditions = _conditions(shared)
    recording, notes = assemble(
        table,
        channels,
        time=time,
        sampling_rate=shared["sampling_rate"],
        start=entry.from_,
        stop=entry.to,
        optional=optional,
        conditions=conditions,
    )
    checks.long_enough(file, name, recording, conditions["spindle_speed"] if entry.kind == "cut" else None)
    extra = checks.plausible_notes(recording, conditions)
    return Record(name, entry.kind, recording, MappingProxyType(conditions), (*notes, *extra), file, shared["feed"])


def _table(
    document: Document,
    place: tuple[str | int, ...],
    folder: Path,
    name: str,
    key: str | None,
    home: Path,
    shared: dict[str, Any],
) -> Table:
    """The table of a file that the manifest names at `place`. Raises InputProblem."""
    file = folder / name
    try:
        return read_table(file, skip_rows=shared["skip_rows"] or 0, delimiter=shared["delimiter"], key=key)
    except InputProblem:
        if not os.path.exists(file):
            do = _instead(file, home) or "check the path in campaign.yaml"
            raise document.problem(place, f"no such file {name}", do) from None
        raise


def _instead(file: Path, home: Path) -> str:
    """What to do about a missing file: what lies beside it, where that is within the campaign's own folder."""
    near = Path(os.path.abspath(file)).is_relative_to(os.path.abspath(home))  # abspath: `..` is no folder within
    return neighbours(file) if near else ""


def _needed(
    document: Document,
    place: tuple[str | int, ...],
    entry: RecordEntry,
    shared: dict[str, Any],
    channels: tuple[str, ...],
) -> None:
    """Raises InputProblem where a kind of record lacks what it cannot do without."""
    if entry.kind == "cut":
        examples = {"spindle_speed": "3810 rpm", "depth_of_cut": "2.9 mm", "feed": "0.1 mm/tooth"}
        for key, example in examples.items():
            if shared[key] is None:
                raise document.problem(place, f"a cut needs {key}", f"give `{key}: {example}`")
        if shared["depth_of_cut"] == 0:
            where = (*place, "depth_of_cut") if entry.depth_of_cut is not None else ("depth_of_cut",)
            raise document.problem(where, "a cut of depth 0 cuts nothing", "correct it, or give `kind: idle`")
    if entry.kind == "excited":
        for wanted, said in ((_DRIVES, "force"), (_RESPONSES, "response")):
            if not any(name == known or name.startswith(f"{known}_") for name in channels for known in wanted):
                raise document.problem(
                    place, f"an excited record needs a {said} channel", f"name one of {', '.join(wanted)}"
                )


def _conditions(shared: dict[str, Any]) -> dict[str, Any]:
    """What is known of the operation, SI."""
    speed, feed, flutes = shared["spindle_speed"], shared["feed"], shared["flutes"]
    known = {
        "spindle_speed": speed,
        "axial_depth_of_cut": shared["depth_of_cut"],
        "flutes": flutes,
        "length_cut_before": shared["length_cut_before"],
    }
    if feed is not None and (speed is not None or feed.per != "second"):
        known["feed_per_revolution"] = feed.per_revolution(speed or float("nan"))
        if feed.per == "tooth":
            known["feed_per_tooth"] = feed.value
        elif flutes is not None:
            known["feed_per_tooth"] = feed.per_tooth(speed or float("nan"), flutes)
    return {key: value for key, value in known.items() if value is not None}
