"""The columns of an exported set: name, type, unit, meaning and role of each, also written into every Parquet file.

Roles: `condition` (what a machinist knows), `signal` (what a sensor gave), `label` (what a method may be asked for),
`truth` (parameters of the simulated machine), `simulation` (how the run was made and ended). Only conditions and
signals are fit to be inputs.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

FORMAT = 1
KEY = b"machining_testbed"


@dataclass(frozen=True)
class Column:
    """One column. kind: `float`, `float32 list`, `float list`, `int`, `bool`, `text` or `text list`; unit: SI, or 1."""

    name: str
    kind: str
    unit: str
    meaning: str
    role: str


_CONDITION = (
    Column("spindle_speed", "float", "rad/s", "nominal spindle speed", "condition"),
    Column("axial_depth_of_cut", "float", "m", "axial depth of cut", "condition"),
    Column("feed_per_tooth", "float", "m", "feed per tooth", "condition"),
    Column("flutes", "int", "1", "number of teeth of the cutter", "condition"),
    Column("idle_passes", "int", "1", "tooth passes before the entry", "condition"),
    Column("passes", "int", "1", "tooth passes in the cut", "condition"),
    Column("ring_down_passes", "int", "1", "tooth passes after the exit", "condition"),
    Column("sampling_rate", "float", "Hz", "samples a second of every signal of the row", "condition"),
    Column("start", "float", "s", "time of the first sample, on the clock of marks", "condition"),
)
_LABELS = (
    Column("stability", "text", "1", "class of the linear machine's largest multiplier: stable, neimark_sacker, flip or "
           "saddle_node; null where it has none", "label"),
    Column("largest_multiplier_modulus", "float", "1", "modulus of that multiplier, per tooth passing period; stable "
           "below 1", "label"),
    Column("largest_multiplier_angle", "float", "rad", "angle of that multiplier, 0 to pi, over the principal period",
           "label"),
    Column("behaviour", "text", "1", "what the recording shows once a tooth (displacement, else velocity, acceleration, "
           "force): stable, neimark_sacker, flip or undecided", "label"),
    Column("label", "text", "1", "what to train a classifier on: the class of the true machine's delay equation, stable, "
           "neimark_sacker or flip; unknown where it has none or the record shows the contrary", "label"),
    Column("chatter", "bool", "1", "whether it chatters, by `label`; null: not known, which is not false", "label"),
    Column("contact_loss", "bool", "1", "whether a tooth left the work while engaged, found from the recorded displacement "
           "and the surface that the teeth before left; null without displacement", "label"),
    Column("contact_loss_time", "float", "s", "when it first did; null if it did not", "label"),
    Column("effects", "text list", "1", "physical effects that the simulated machine has beyond the linear one", "label"),
)
_SIMULATION = (
    Column("initial_displacement", "float", "m", "displacement at time 0", "simulation"),
    Column("initial_velocity", "float", "m/s", "velocity at time 0", "simulation"),
    Column("pass_times", "float list", "s", "start of every tooth pass, and the end of the last", "simulation"),
    Column("outcome", "text", "1", "how the simulation ended: ok, or why it did not", "simulation"),
    Column("outcome_time", "float", "s", "when it ended early; null if it did not", "simulation"),
)
_WINDOW = (
    Column("window", "int", "1", "number of the window in its run, from 0", "simulation"),
    Column("segment", "text", "1", "where the window lies: idle (before the first tooth enters), cut, ring-down (after the "
           "exit); entry, exit, whole cut: across one of these or both", "label"),
    Column("passes_in_cut", "int", "1", "tooth passes since the entry at the window's first sample; null outside the cut",
           "label"),
)
_LEFT_OUT = ("marks", "pass_times")  # of the run: a window does not repeat them
# Of a window these would tell where in its run it lies, which no sensor does.
_LAYOUT = ("start", "idle_passes", "passes", "ring_down_passes")
_MEANING = {"start": "time of the window's first sample in its run",
            "label": "what to train a classifier on: of a window in the cut the class of the true machine's delay equation, "
            "stable, neimark_sacker or flip; no_cut before the entry and after the exit; unknown across them, where the "
            "equation has no class, or where the record of the run shows the contrary"}


def truth_column(path: str) -> str:
    """Column of a true parameter: `process_damping.coefficient` stands in `true_process_damping__coefficient`,
    `modes[0].mass` in `true_modes_0__mass`."""
    return "true_" + path.replace(".", "__").replace("[", "_").replace("]", "")


def columns(channels: Mapping[str, str], truth: Mapping[str, str], windows: bool = False) -> tuple[Column, ...]:
    """All columns, in order. channels: name -> unit; truth: path -> unit; windows: a row is a window, not a run."""
    first = (Column("run", "int", "1", "number of the run in the scenario", "simulation"),
             Column("condition_id", "text", "1", "operating condition: speed, depth, feed, teeth", "simulation"),
             Column("machine_id", "text", "1", "machine: all its true parameters", "simulation"),
             Column("group", "text", "1", "condition_id or machine_id, as the set was divided; a group lies in one split",
                    "simulation"))
    signals = [Column(name, "float32 list", unit, f"measured {name.replace('_', ' ')}", "signal")
               for name, unit in channels.items()]
    marks = Column("marks", "float list", "s", "times of the tachometer's once-per-revolution marks", "signal")
    noise = [Column(f"noise_{name}", "float", unit, f"rms of the sensor's white noise on {name}", "simulation")
             for name, unit in channels.items()]
    true = [Column(truth_column(path), "float", unit, f"true {path.replace('_', ' ')}", "truth")
            for path, unit in truth.items()]
    whole = (*first, *_CONDITION, *signals, marks, *_LABELS, *true, *noise, *_SIMULATION)
    if not windows:
        return whole
    kept = [replace(each, role="simulation" if each.name in _LAYOUT else each.role,
                    meaning=_MEANING.get(each.name, each.meaning))
            for each in whole if each.name not in _LEFT_OUT]
    return (kept[0], _WINDOW[0], *kept[1:], *_WINDOW[1:])


def arrow_schema(listed: tuple[Column, ...], about: Mapping[str, Any]) -> Any:
    """The pyarrow schema: units, meanings and roles in the fields' metadata, `about` as JSON under `machining_testbed`."""
    import pyarrow as pa

    length = about.get("window", {}).get("length", -1)  # of a fixed-length list; -1: of any length
    kinds = {"float": pa.float64(), "float32 list": pa.list_(pa.float32(), length), "float list": pa.list_(pa.float64()),
             "int": pa.int64(), "bool": pa.bool_(), "text": pa.string(), "text list": pa.list_(pa.string())}
    fields = [pa.field(each.name, kinds[each.kind], metadata={"unit": each.unit, "meaning": each.meaning,
                                                              "role": each.role}) for each in listed]
    return pa.schema(fields, metadata={KEY: json.dumps({"format": FORMAT, **about}, sort_keys=True)})
