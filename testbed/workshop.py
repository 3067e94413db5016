"""A measuring campaign that never was: cuts by an engine, with everything a real measurement adds and nobody tells.

Unknown to whoever fits the records: the tachometer's mark, a spindle speed a little off, offset, slow drift, 16-bit counts,
white noise, the sample at which each record starts. They are written as the files that a workshop would hand over.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from testbed.cut import Cut, whole_cut_sampling
from testbed.effect import Effect
from testbed.files.campaign import Record
from testbed.files.manifest import Feed
from testbed.files.model_file import write_model
from testbed.machine import Model
from testbed.recording import Recording
from testbed.system.atomic import replacing, write_text

RPM = 2 * math.pi / 60
RISE = 3  # samples that the tachometer's pulse takes to rise
PULSE = 0.1  # of a revolution that the mark is seen


@dataclass(frozen=True)
class Measurement:
    """What measuring adds to a motion (SI).

    noise: rms of the white noise, m. speed_error: largest relative deviation of the true spindle speed from the stated
    one. mark_angle: from the tachometer's mark to the tooth's entry, rad. offset: rms of the sensor's offset, m. drift:
    amplitude of its slow drift, m, at drift_rate, rad/s. count: one step of the converter, m. late: samples by which a
    record may start late. mark_jitter: error of the marks' common time, s.
    """

    rate: float = 12800.0
    noise: float = 1e-6
    speed_error: float = 5e-4
    mark_angle: float = 1.1
    offset: float = 5e-6
    drift: float = 3e-6
    drift_rate: float = 0.7
    count: float = 2e-4 / 2**15
    late: int = 150
    mark_jitter: float = 1e-6


def measured_cut(
    simulate: Callable[..., Recording], model: Model, stated: Cut, how: Measurement, seed: int, name: str
) -> Record:
    """One cut at the `stated` conditions, simulated by an engine's `simulate` and measured; a run that diverged ends early.

    Only displacement and marks are recorded, and only the stated conditions are told. The same seed gives the same record.
    """
    assert model.cutter is not None
    random = np.random.default_rng(seed)
    flutes = model.cutter.flutes
    speed = stated.spindle_speed * (1 + how.speed_error * random.uniform(-1, 1))
    cut = Cut(**(vars(stated) | {"spindle_speed": speed}))
    clean = simulate(model, cut, whole_cut_sampling(cut, flutes, how.rate))
    time, signal = clean.time, clean.channels["displacement"].copy()
    signal += how.noise * random.standard_normal(signal.size) + how.offset * random.standard_normal()
    signal += how.drift * np.sin(how.drift_rate * time + random.uniform(0, 6))
    signal = np.round(signal / how.count) * how.count
    marks = clean.marks - how.mark_angle / speed
    marks = marks[np.isfinite(marks)]
    first = int(random.integers(0, how.late))
    seen = np.isfinite(signal)
    last = int(seen.size if seen.all() else np.argmin(seen))
    marks = marks[(marks >= time[first]) & (marks <= time[last - 1])] + random.normal(0, how.mark_jitter)
    feed = stated.feed_per_tooth
    conditions = {
        "spindle_speed": stated.spindle_speed,
        "axial_depth_of_cut": stated.axial_depth_of_cut,
        "feed_per_tooth": feed,
        "feed_per_revolution": feed * flutes,
    }
    if stated.length_cut_before:
        conditions["length_cut_before"] = stated.length_cut_before
    recording = Recording(
        {"displacement": signal[first:last]},
        how.rate,
        {"displacement": "m"},
        "synthetic",
        time[first],
        marks,
        conditions=conditions,
    )
    return Record(name, "cut", recording, conditions, (), feed=Feed(feed, "tooth"))


def write_campaign(
    folder: Path,
    records: Sequence[Record],
    believed: Model,
    catalogue: Mapping[str, Effect] | None = None,
    name: str = "synthetic",
) -> tuple[Path, Path]:
    """Write measured cuts as cut_N.csv with their campaign.yaml, and the believed model.yaml, into an existing folder.

    The CSV hold displacement (um) and the tachometer's voltage. Returns (campaign.yaml, model.yaml).
    """
    rate = records[0].recording.sampling_rate
    lines = [
        f"name: {name}",
        f"sampling_rate: {rate:g} Hz",
        "channels:",
        "  displacement: {column: disp_um, unit: um}",
        "  tachometer: {column: tach_V, unit: V, pulses_per_revolution: 1, edge: rising}",
        "records:",
    ]
    for number, record in enumerate(records):
        rows = np.column_stack([record.recording.channels["displacement"] * 1e6, tachometer(record.recording)])
        with replacing(folder / f"cut_{number}.csv", durable=False) as path, path.open("w", encoding="utf-8") as file:
            np.savetxt(file, rows, delimiter=",", header="disp_um,tach_V", comments="", fmt=("%.9g", "%.4g"))
        lines.append(f"  - {{file: cut_{number}.csv, kind: cut, {_stated(record.conditions)}}}")
    write_text(folder / "campaign.yaml", "\n".join(lines) + "\n")
    write_model(believed, folder / "model.yaml", catalogue)
    return folder / "campaign.yaml", folder / "model.yaml"


def _stated(known: Mapping[str, Any]) -> str:
    """Conditions as a record of campaign.yaml states them."""
    parts = [
        f"spindle_speed: {known['spindle_speed'] / RPM:.6g} rpm",
        f"depth_of_cut: {known['axial_depth_of_cut'] * 1e3:.6g} mm",
        f"feed: {known['feed_per_tooth'] * 1e3:.6g} mm/tooth",
    ]
    if "length_cut_before" in known:
        parts.append(f"length_cut_before: {known['length_cut_before'] * 1e3:.6g} mm")
    return ", ".join(parts)


def tachometer(recording: Recording) -> np.ndarray:
    """The voltage (0 to 5 V) of a mark seen once a revolution, half its height at each of the recording's marks."""
    time, marks, rate = recording.time, recording.marks, recording.sampling_rate
    latest = np.searchsorted(marks, time + 0.5 * RISE / rate) - 1
    since = (time - marks[np.clip(latest, 0, None)]) * rate / RISE + 0.5
    width = PULSE * float(np.mean(np.diff(marks))) * rate / RISE
    return 5.0 * (np.clip(since, 0, 1) - np.clip(since - width, 0, 1))
