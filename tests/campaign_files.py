"""Records written as a user's files: CSV of displacement (um) and tachometer (V), campaign.yaml and model.yaml."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from testbed.campaign import Record
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.model_file import write_model
from tests.synthetic_campaign import RPM

TRUE = Model(Structure(2.573, 146.4225, 0.0032), Cutter(), Cutting("up-milling", 0.162, 5.5e8, 2.0e8))
BELIEVED = Model(Structure(2.573, 148.0, 0.0040), Cutter(), Cutting("up-milling", 0.162, 6.3e8, 1.7e8))
RISE = 3  # samples that the tachometer's pulse takes to rise


def write_files(folder: Path, records: Sequence[Record], believed: Model = BELIEVED) -> None:
    """Write records of cuts, their campaign.yaml and a model.yaml into an existing folder."""
    rate = records[0].recording.sampling_rate
    lines = ["name: synthetic", f"sampling_rate: {rate:g} Hz", "channels:",
             "  displacement: {column: disp_um, unit: um}",
             "  tachometer: {column: tach_V, unit: V, pulses_per_revolution: 1, edge: rising}", "records:"]
    for number, record in enumerate(records):
        recording, known = record.recording, record.conditions
        period = 2 * np.pi / known["spindle_speed"]
        since = recording.time - np.min(recording.marks) + 0.5 * RISE / rate  # half height at the mark
        turn = np.mean(np.diff(recording.marks))
        phase = np.mod(since, turn) * rate
        pulse = 5.0 * (np.clip(phase / RISE, 0, 1) - np.clip(phase / RISE - 0.1 * period * rate / RISE, 0, 1))
        rows = np.column_stack([recording.channels["displacement"] * 1e6, pulse])
        np.savetxt(folder / f"cut_{number}.csv", rows, delimiter=",", header="disp_um,tach_V", comments="", fmt="%.9g")
        lines.append(f"  - {{file: cut_{number}.csv, kind: cut, spindle_speed: {known['spindle_speed'] / RPM:.6g} rpm, "
                     f"depth_of_cut: {known['axial_depth_of_cut'] * 1e3:.6g} mm, "
                     f"feed: {known['feed_per_tooth'] * 1e3:.6g} mm/tooth}}")
    (folder / "campaign.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    write_model(believed, folder / "model.yaml")
