"""Files to start from: a model, a scenario, and a campaign that names measured files as they were found."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from testbed.recording import MOTION_UNITS
from testbed.units import UnitProblem, factor_to

MODEL = """\
# What you believe of the machine. Put your own numbers in; a tap test gives the structure: testbed tap.
structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}
cutting:
  direction: up-milling                # or down-milling
  radial_depth: 4.51 mm                # the width of cut; or immersion, the share of the spindle period that a tooth cuts
  tangential_coefficient: 550 N/mm^2
  normal_coefficient: 200 N/mm^2
"""
SCENARIO = """\
# Cuts to simulate: testbed run scenario.yaml -o data.h5
name: first-scenario
seed: 1
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}
  cutting: {direction: up-milling, radial_depth: 4.51 mm, tangential_coefficient: 550 N/mm^2,
            normal_coefficient: 200 N/mm^2}
cut: {feed: 0.1 mm/tooth, idle: 10 rev, cutting: 60 rev, ring_down: 30 rev}
tests:
  - {spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 2850 rpm, depth_of_cut: 2.9 mm}
sensors:
  sampling_rate: 12800 Hz
  displacement: {noise: 0.5 um}
"""
FILL_IN = "FILL_IN"  # in place of what nobody can guess: the error that names the line says what to write
_UNKNOWN = f"displacement: {{column: {FILL_IN}, unit: um}}"
# What a column may be, by the words in its name, and, where these say nothing, by the dimension of its unit.
_BY_NAME = (("tachometer", ("tach", "puls", "trig", "rpm", "spindle", "once")), ("force_x", ("fx", "force_x")),
            ("force_y", ("fy", "force_y")), ("force", ("force", "hammer", "load")), ("acceleration", ("acc",)),
            ("velocity", ("vel", "vib_v")), ("displacement", ("disp", "gap", "prox", "eddy")))  # fmt: skip
_BY_UNIT = {"m": "displacement", "m/s": "velocity", "m/s^2": "acceleration", "N": "force"}
_AXIS = re.compile(r"(?:^|[_\s\-.])([xy])(?:$|[_\s\-.\[(])|([xy])$", re.IGNORECASE)
_TAPPED = ("tap", "hammer", "impact", "ring", "decay", "blow")
_SPEED = re.compile(r"(\d{3,6}(?:\.\d+)?)\s*_?rpm", re.IGNORECASE)
_DEPTH = re.compile(r"(\d+(?:[.p]\d+)?)\s*_?mm", re.IGNORECASE)


@dataclass(frozen=True)
class Found:
    """What a measured file was found to hold: its columns with their units ("" where unknown), its rate in Hz; notes on it."""

    path: Path
    columns: Mapping[str, str]
    rate: float | None
    time: str | None
    notes: tuple[str, ...] = ()


def _dimension(unit: str) -> str | None:
    for si in _BY_UNIT:
        try:
            factor_to(unit, si)
        except UnitProblem:
            continue
        return si
    return None


def channel_of(column: str, unit: str) -> str | None:
    """The channel that a column probably is, by its name and unit; None where neither says."""
    folded, dimension = column.casefold(), _dimension(unit) if unit else None
    named = next((channel for channel, words in _BY_NAME if any(word in folded for word in words)), None)
    channel = named if named == "tachometer" or dimension is None else _BY_UNIT[dimension]
    if channel is None or channel == "tachometer" or named in ("force_x", "force_y"):
        return named
    axis = _AXIS.search(column)
    return f"{channel}_{(axis[1] or axis[2]).lower()}" if axis else channel


def channels_of(found: Found) -> dict[str, tuple[str, str]]:
    """Channel -> (column, unit) of what a file holds; of two columns that seem to be one channel the first."""
    channels: dict[str, tuple[str, str]] = {}
    for column, unit in found.columns.items():
        channel = None if column == found.time else channel_of(column, unit)
        if channel is not None:
            channels.setdefault(channel, (column, unit))
    return channels


def quoted(text: str) -> str:
    """A text as YAML takes it, in quotes where it needs them."""
    return text if re.fullmatch(r"[A-Za-z][\w./-]*", text) else '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _channel(channel: str, column: str, unit: str) -> str:
    pulses = ", pulses_per_revolution: 1" if channel == "tachometer" else ""
    return f"{channel}: {{column: {quoted(column)}, unit: {quoted(unit) if unit else FILL_IN}{pulses}}}"


def _record(found: Found, folder: Path) -> dict[str, str]:
    """What a record says of itself: its file, its kind and, of a cut, its conditions as the file's name tells them."""
    path, name = found.path.resolve(), found.path.stem.casefold()
    inside = path.is_relative_to(folder.resolve())
    said = {"file": quoted((path.relative_to(folder.resolve()) if inside else path).as_posix())}
    if any(word in name for word in _TAPPED):
        return said | {"kind": "excited" if "force" in channels_of(found) else "ring-down"}
    speed, depth = _SPEED.search(found.path.stem), _DEPTH.search(found.path.stem)
    return said | {"kind": "cut", "spindle_speed": f"{speed[1]} rpm" if speed else FILL_IN,
                   "depth_of_cut": f"{depth[1].replace('p', '.')} mm" if depth else FILL_IN, "feed": FILL_IN}  # fmt: skip


def campaign_text(files: Sequence[Found], folder: Path) -> tuple[str, list[str]]:
    """(a campaign.yaml that names the files, from a folder; what is left to fill in).

    What all files share stands once; where their columns differ, each record has its own.
    """
    shared = channels_of(files[0]) if files and all(channels_of(one) == channels_of(files[0]) for one in files) else {}
    lines = [f"# What was measured. Replace every {FILL_IN}, then: testbed inspect campaign.yaml", "name: first-campaign"]
    if not files or all(one.rate is None for one in files):
        lines.append(f"sampling_rate: {FILL_IN}          # such as 12800 Hz")
    lines += ["channels:", *(f"  {_channel(name, *at)}" for name, at in shared.items())] if shared else []
    if not files:
        lines += ["channels:", f"  {_UNKNOWN}    # or velocity, acceleration, force: docs/files.md"]
    lines.append("records:")
    for one in files:
        said = _record(one, folder)
        if one.rate is None and any(other.rate is not None for other in files):
            said["sampling_rate"] = FILL_IN
        if not shared:
            own = [_channel(name, *at) for name, at in channels_of(one).items()]
            said["channels"] = f"{{{', '.join(own or [_UNKNOWN])}}}"
        lines.append(f"  - {{{', '.join(f'{key}: {value}' for key, value in said.items())}}}")
    if not files:
        lines.append(f"  - {{file: {FILL_IN}, kind: cut, spindle_speed: {FILL_IN}, depth_of_cut: {FILL_IN}, feed: {FILL_IN}}}")
    return "\n".join(lines) + "\n", _left(lines)


def taps_text(files: Sequence[Found], folder: Path) -> tuple[str, list[str]]:
    """(a taps.yaml of the hammer blows whose force was measured, "" without any; what is left to fill in)."""
    rows = [row for one in files if (row := _tap(one, folder))]
    if not rows:
        return "", []
    rates = [one.rate for one in files if _tap(one, folder)]
    lines = [f"# How the machine was struck. Replace every {FILL_IN}, then: testbed tap taps.yaml -m model.yaml -o new.yaml",
             f"on: {FILL_IN}          # what was struck and carries the sensor: tool or workpiece",
             *([f"sampling_rate: {FILL_IN}          # such as 51200 Hz"] if None in rates else []), "taps:", *rows]
    return "\n".join(lines) + "\n", _left(lines)


def _tap(found: Found, folder: Path) -> str:
    """The line of a record of blows; "" of any other."""
    said, channels = _record(found, folder), channels_of(found)
    force = next((at for name, at in channels.items() if name.startswith("force")), None)
    motion = next((at for name, at in channels.items() if name.partition("_")[0] in MOTION_UNITS), None)
    if said["kind"] != "excited" or force is None or motion is None:
        return ""
    axis = _AXIS.search(found.path.stem)
    parts = {"file": said["file"], "direction": (axis[1] or axis[2]).lower() if axis else FILL_IN}
    parts |= {name: f"{{column: {quoted(column)}, unit: {quoted(unit) if unit else FILL_IN}}}"
              for name, (column, unit) in (("force", force), ("response", motion))}
    return f"  - {{{', '.join(f'{key}: {value}' for key, value in parts.items())}}}"


def _left(lines: Sequence[str]) -> list[str]:
    """The keys that are to be filled in, but for the first line, which says so."""
    return list(dict.fromkeys(key for line in lines[1:] for key in re.findall(rf"(\w+): {FILL_IN}", line)))


def not_named(files: Iterable[Found]) -> list[str]:
    """In words, columns that no channel was guessed for."""
    found = []
    for one in files:
        taken = {column for column, _ in channels_of(one).values()} | {one.time}
        rest = [column for column in one.columns if column not in taken]
        found += [f"{one.path}: not used: {', '.join(rest)}"] if rest else []
    return found
