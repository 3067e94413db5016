"""Campaigns of a machine that moves in x and y, by an engine that is not the fit's, measured as in a workshop."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbed.cut import Cut, whole_cut_sampling
from testbed.files.campaign import Record
from testbed.files.manifest import Feed
from testbed.files.model_file import write_model
from testbed.machine import Model
from testbed.recording import Recording, motion_channel, quantity_of
from testbed.workshop import tachometer

RPM = 2 * math.pi / 60
PLACES = tuple((f"displacement_{axis}", on) for on in ("workpiece", "tool") for axis in "xy")  # channel, sensor's place
NOISE = {"displacement": 1e-6, "velocity": 1e-3, "acceleration": 0.5, "force": 1.0}  # rms, SI
UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2", "force": "N"}
SPEED_ERROR, MARK_ANGLE, OFFSET, DRIFT, LATE = 5e-4, 1.1, 5.0, 3.0, 150  # 1, rad, over the noise, over the noise, samples


def planar_record(simulate: Callable, model: Model, stated: Cut, places: Sequence[tuple[str, str]], seed: int, name: str, *,
                  rate: float = 10000.0) -> Record:
    """One cut at the stated conditions; places: (channel, what its sensor sits on); rate: Hz."""
    random, flutes = np.random.default_rng(seed), model.cutter.flutes
    first_tooth, pitches, mean = stated.idle_passes % flutes, model.cutter.pitches, model.cutter.pitch
    ahead = sum(pitches[1 : first_tooth + 1]) - first_tooth * mean  # rad: the mark keeps its place to tooth 0
    turned = (*pitches[first_tooth:], *pitches[:first_tooth])
    model = replace(model, cutter=replace(model.cutter, pitch_angles=turned if model.cutter.pitch_angles else ()))
    speed = stated.spindle_speed * (1 + SPEED_ERROR * random.uniform(-1, 1))
    cut = Cut(**(vars(stated) | {"spindle_speed": speed}))
    engines = [motion_channel(channel, on) for channel, on in places]
    clean = simulate(model, cut, whole_cut_sampling(cut, flutes, rate), channels=tuple(engines))
    first, last = int(random.integers(0, LATE)), int(np.isfinite(clean.channels[engines[0]]).sum())
    channels, on_tool = {}, []
    for (channel, on), engine in zip(places, engines, strict=True):
        label = channel if channel not in channels else f"{channel}_2"
        slow = OFFSET * random.standard_normal() + DRIFT * np.sin(0.7 * clean.time + random.uniform(0, 6))
        values = clean.channels[engine] + NOISE[quantity_of(channel)] * (random.standard_normal(len(clean.time)) + slow)
        channels[label] = values[first:last]
        on_tool += [label] if on == "tool" else []
    marks = clean.marks - (MARK_ANGLE + ahead) / speed + random.normal(0, 1e-6)
    marks = marks[np.isfinite(marks) & (marks >= clean.time[first]) & (marks <= clean.time[last - 1])]
    feed = stated.feed_per_tooth
    conditions = {"spindle_speed": stated.spindle_speed, "axial_depth_of_cut": stated.axial_depth_of_cut,
                  "feed_per_tooth": feed, "feed_per_revolution": feed * flutes}
    units = {label: UNITS[quantity_of(label)] for label in channels}
    recording = Recording(channels, rate, units, "synthetic", clean.time[first], marks, conditions=conditions,
                          on_tool=tuple(on_tool))
    return Record(name, "cut", recording, conditions, (), feed=Feed(feed, "tooth"))


def planar_campaign(simulate: Callable, model: Model, tests: Sequence[tuple[float, float]], places: Sequence[tuple[str, str]],
                    seed: int = 0, course: Sequence[int] = (8, 40, 20), **more: float) -> list[Record]:
    """Cuts at (rpm, depth in m); course: revolutions of idling, cutting, ringing down."""
    flutes, records = model.cutter.flutes, []
    for number, (rpm, depth) in enumerate(tests):
        idle, cut, ring = (flutes * part for part in course)
        stated = Cut(rpm * RPM, depth, 0.1e-3, idle + number % flutes, cut, ring)
        name = f"{rpm:.0f}rpm_{depth * 1e3:.2f}mm"
        records.append(planar_record(simulate, model, stated, places, 100 * seed + number, name, **more))
    return records


def write_planar(folder: Path, records: Sequence[Record], believed: Model) -> None:
    """The records as cut_N.csv in SI with their campaign.yaml, and the believed model.yaml, into a folder."""
    first = records[0].recording
    lines = ["name: in-x-and-y", f"sampling_rate: {first.sampling_rate:g} Hz", "channels:",
             "  tachometer: {column: tach, unit: V}"]
    lines += [f"  {name}: {{column: {name}, unit: {unit}{', on: tool' if name in first.on_tool else ''}}}"
              for name, unit in first.units.items()]
    lines.append("records:")
    for number, record in enumerate(records):
        rows = np.column_stack([*record.recording.channels.values(), tachometer(record.recording)])
        np.savetxt(folder / f"cut_{number}.csv", rows, delimiter=",", header=",".join([*first.channels, "tach"]), comments="",
                   fmt="%.7g")
        known = record.conditions
        lines.append(f"  - {{file: cut_{number}.csv, kind: cut, spindle_speed: {known['spindle_speed'] / RPM:.6g} rpm, "
                     f"depth_of_cut: {known['axial_depth_of_cut'] * 1e3:.6g} mm, "
                     f"feed: {known['feed_per_tooth'] * 1e3:.6g} mm/tooth}}")
    (folder / "campaign.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    write_model(believed, folder / "model.yaml")
