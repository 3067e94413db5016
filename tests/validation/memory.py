"""Peak memory and time of reading, comparing and diagnosing against the length of the records, their number, and runs.

    python -m tests.validation.memory COMMAND SECONDS RECORDS     such as compare 8 1: seconds a record, and how many
    python -m tests.validation.memory inspect MEGABYTES csv       one record as a text table of that size

Each figure is the largest resident memory of one process of the command line, as the system counts it.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

RATE = 51200.0  # Hz
SPEEDS = (3810, 3700, 2970, 2900, 2800)  # rpm, at which the cuts are stable: the record of one that grows breaks off
CEILING = 6 * 2**30  # bytes of address space that a command gets here: beyond it it must say so in one line


def campaign(folder: Path, seconds: float, records: int) -> tuple[Path, Path]:
    """A campaign of cuts as a workshop measures them, each so long, in HDF5 of single precision; its believed model."""
    from testbed.cut import Cut
    from testbed.engines.fast import simulate
    from testbed.files.model_file import read_model, write_model
    from testbed.workshop import RPM, Measurement, measured_cut, tachometer

    text = ("structure: {mass: 2.573 kg, natural_frequency: 147.5 Hz, damping_ratio: 0.005}\n"
            "cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}\n"
            "cutting: {direction: up-milling, immersion: 0.162, tangential_coefficient: 600 N/mm^2,\n"
            "          normal_coefficient: 180 N/mm^2}\n")
    (folder / "believed.yaml").write_text(text)
    believed = read_model(folder / "believed.yaml")
    true = believed.with_values({"natural_frequency": 147.0, "damping_ratio": 0.0055})
    rows = ["name: long", "sampling_rate: 51200 Hz", "channels:", "  displacement: {column: disp, unit: um}",
            "  tachometer: {column: tach, unit: V}", "records:"]
    for number in range(records):
        speed = SPEEDS[number % len(SPEEDS)] * RPM
        passes = int(seconds * speed / (2 * np.pi))
        depth = (1.0 + 0.3 * (number // len(SPEEDS))) * 1e-3
        cut = Cut(speed, depth, 1e-4, idle_passes=passes // 8, passes=passes - passes // 4, ring_down_passes=passes // 8)
        made = measured_cut(simulate, true, cut, Measurement(RATE), number, f"cut_{number}").recording
        if len(made.channels["displacement"]) < 0.95 * seconds * RATE:
            raise RuntimeError(f"record {number} broke off: its cut is not stable")
        with h5py.File(folder / f"cut_{number}.h5", "w") as file:
            file["disp"] = (made.channels["displacement"] * 1e6).astype(np.float32)
            file["tach"] = tachometer(made).astype(np.float32)
        rows.append(f"  - {{file: cut_{number}.h5, kind: cut, spindle_speed: {speed / RPM:.6g} rpm, "
                    f"depth_of_cut: {cut.axial_depth_of_cut * 1e3:.6g} mm, feed: 0.1 mm/tooth}}")
    (folder / "campaign.yaml").write_text("\n".join(rows) + "\n")
    write_model(believed, folder / "model.yaml")
    return folder / "campaign.yaml", folder / "model.yaml"


def measured(arguments: list[str], folder: Path, seconds: float = 3600.0) -> dict[str, object]:
    """A command run by itself below the ceiling: exit code, time (s), peak memory (bytes), and its last line."""
    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (CEILING, CEILING))

    began = time.monotonic()
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    with (folder / "said").open("w+b") as said:
        child = subprocess.Popen([sys.executable, "-m", "testbed", *arguments], cwd=folder, stdout=said, stderr=said,
                                 preexec_fn=limited, env=environment)
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        lines = said.read().decode(errors="replace").strip().splitlines()
    return {"code": child.returncode, "seconds": round(time.monotonic() - began, 1), "peak": used.ru_maxrss * 1024,
            "said": lines[-1] if lines else ""}


def text_table(megabytes: float) -> dict[str, object]:
    """`inspect` of a text table of time, displacement and tachometer."""
    rows = np.arange(int(megabytes * 1e6 / 32))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with (folder / "cut.csv").open("w") as file:
            file.write("time [s],disp [um],tach [V]\n")
            for part in np.array_split(rows, max(1, len(rows) // 100_000)):
                at = part / RATE
                noise = np.random.default_rng(part[0]).normal(0, 0.1, len(part))
                values = zip(at, 20 * np.sin(924 * at) + noise, 5.0 * ((at * 63.5) % 1 < 0.05) + 0.1 * noise, strict=True)
                file.write("".join(f"{one:.9f},{disp:.6f},{tach:.5f}\n" for one, disp, tach in values))
        (folder / "campaign.yaml").write_text(
            "name: text\nchannels: {displacement: {column: disp}, tachometer: {column: tach}}\nrecords:\n"
            "  - {file: cut.csv, kind: cut, spindle_speed: 3810 rpm, depth_of_cut: 2 mm, feed: 0.1 mm/tooth}\n")
        size = (folder / "cut.csv").stat().st_size
        return {"command": "inspect", "file": size} | measured(["inspect", "campaign.yaml"], folder)


def one(command: str, seconds: float, records: int) -> dict[str, object]:
    """One figure of the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        manifest, model = campaign(folder, seconds, records)
        model_of = [] if command == "inspect" else ["-m", str(model)]
        found = measured([command, str(manifest), *model_of], folder)
    return {"command": command, "seconds_a_record": seconds, "records": records} | found


if __name__ == "__main__":
    as_text = sys.argv[3] == "csv"
    print(json.dumps(text_table(float(sys.argv[2])) if as_text else one(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]))))
