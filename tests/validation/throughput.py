"""How fast transients are simulated and stored: 60 periods, base model, 12.8 kHz float32, two workers.

Each measurement is a process of its own whose workers are threads, so that its peak memory is that of all workers
together. TESTBED_RUNS sets the size of the largest sweeps (100,000 unless it is set), TESTBED_FOLDER where they are
written. On a machine that others use too, the clock on the wall tells of them: the rate is then judged by processor time,
which all that the sweep does is counted in, and the rate by the clock is told with the load beside it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from testbed.store.chunk_writer import Compression
from tests.validation.claims import Claim, Section

LARGEST = int(os.environ.get("TESTBED_RUNS", "100000"))
SIZES = sorted({min(size, LARGEST) for size in (1_000, 10_000, LARGEST)})
WORKERS = 2
TARGETS = {"none": 3000.0, "gzip": 1000.0}
BUSY = 0.5  # load at the beginning from which on a machine counts as shared
SCENARIO = """name: throughput
seed: 1
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.5976 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}
  cutting: {immersion: 0.162, tangential_coefficient: 555.768 N/mm^2, normal_coefficient: 166.7304 N/mm^2}
cut: {cutting: 60 rev, spread: {displacement: 5 um}}
sweep:
  spindle_speed: {from: 3700 rpm, to: 3900 rpm, count: 10}
  depth_of_cut: {from: 0.2 mm, to: 2 mm, count: COUNT}
sensors: {sampling_rate: 12800 Hz}
"""


def scenario(runs: int):
    """The sweep of so many runs."""
    from testbed.files.yaml_text import parse
    from testbed.scenario.scenario_file import scenario_from

    return scenario_from(parse(SCENARIO.replace("COUNT", str(runs // 10)), "throughput.yaml"))


class Stopwatch:
    """Seconds of processor time that a thread spends inside functions of one kind, summed over threads.

    A watched function that another one calls is not counted twice.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self.inside = threading.local()

    def watch(self, owner: object, name: str) -> None:
        """Count the time in a function from now on."""
        function = getattr(owner, name)

        def timed(*arguments, **options):
            if getattr(self.inside, "now", False):
                return function(*arguments, **options)
            self.inside.now, begin = True, time.thread_time()
            try:
                return function(*arguments, **options)
            finally:
                self.seconds += time.thread_time() - begin
                self.inside.now = False

        setattr(owner, name, timed)


def measure(runs: int, compression: Compression, shards: bool, folder: str) -> dict[str, float]:
    """Run one sweep in this process: seconds, processor seconds, those in HDF5, bytes and peak memory (bytes)."""
    import resource

    import h5py

    from testbed.engines.fast import simulate
    from testbed.store import chunk_writer, store
    from testbed.sweeps import consolidate, sweep

    sweep.run(scenario(20), simulate, Path(folder) / "warm.h5", workers=WORKERS)  # compiled and imported
    hdf5, hashes = Stopwatch(), Stopwatch()
    for owner, names in ((h5py.Dataset, ("__setitem__", "__getitem__", "make_scale")), (h5py.AttributeManager, (
            "__setitem__", "__getitem__", "__iter__")), (h5py.Group, ("create_dataset", "__getitem__", "visit")), (h5py.File, (
            "__init__", "close")), (chunk_writer.ChannelWriter, ("_hand_over",))):
        for name in names:
            hdf5.watch(owner, name)
    for module, name in ((store, "write_sealed"), (consolidate, "seal"), (consolidate, "state")):
        hashes.watch(module, name)
    target = Path(folder) / ("shards" if shards else "data.h5")
    begin, processor = time.perf_counter(), time.process_time()
    sweep.run(scenario(runs), simulate, target, workers=WORKERS, compression=compression, keep_shards=shards)
    files = list(target.iterdir()) if shards else [target]
    return {"seconds": time.perf_counter() - begin, "processor": time.process_time() - processor, "hdf5": hdf5.seconds,
            "seal": hashes.seconds, "bytes": sum(path.stat().st_size for path in files), "runs": runs,
            "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0}


def apart(runs: int, compression: Compression, shards: bool = True) -> dict[str, float]:
    """`measure` in a process of its own."""
    with tempfile.TemporaryDirectory(dir=os.environ.get("TESTBED_FOLDER")) as folder:
        code = "import json, sys; from tests.validation.throughput import measure; " \
               f"print(json.dumps(measure({runs}, {compression!r}, {shards}, {folder!r})))"
        done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True,
                              cwd=Path(__file__).resolve().parents[2])
    return json.loads(done.stdout.splitlines()[-1])


def check() -> Section:
    """The section of the table."""
    load = os.getloadavg()[0]
    growth = {size: apart(size, "none") for size in SIZES}
    rows, claims = [], []
    middle = min(LARGEST, 10_000)
    others = {("zstd", True): apart(middle, "zstd"), ("gzip", True): apart(LARGEST, "gzip"),
              ("none", False): apart(middle, "none", shards=False), ("gzip", False): apart(middle, "gzip", shards=False)}
    for (compression, shards), found in [*((("none", True), one) for one in growth.values()), *others.items()]:
        rate = found["runs"] / found["seconds"]
        rows.append((f"{found['runs']:.0f}", compression, "folder of shards" if shards else "one file", f"{rate:,.0f}",
                     f"{found['processor'] / found['runs'] * 1e6:.0f}", f"{found['hdf5'] / found['processor']:.0%}",
                     f"{found['seal'] / found['processor']:.0%}", f"{found['bytes'] / found['runs'] / 1e3:.1f}",
                     f"{found['peak'] / 2**20:.0f}"))
    note = f"load {load:.1f} on {os.cpu_count()} cores when it began"
    alone = load < BUSY
    for compression, found in (("none", growth[SIZES[-1]]), ("gzip", others["gzip", True])):
        target = TARGETS[compression]
        what = f"transients simulated and stored, {compression}, {found['runs']:.0f} runs"
        for clock, rate, judged in (("by the clock", found["runs"] / found["seconds"], alone),
                                    (f"{WORKERS} processors' time", WORKERS * found["runs"] / found["processor"], True)):
            claims.append(Claim(f"{what}, {clock}", f">= {target:,.0f} a second", f"{rate:,.0f} a second",
                                rate >= target if judged else None,
                                note if judged else f"{note}: others were at work"))
    first, last = growth[SIZES[0]], growth[SIZES[-1]]
    ratio = last["processor"] / last["runs"] / (first["processor"] / first["runs"])
    claims.append(Claim(f"processor time of a run, {SIZES[-1]} runs against {SIZES[0]}", "at most 1.2 times",
                        f"{ratio:.2f} times", ratio <= 1.2))
    more = (last["peak"] - growth[SIZES[-2]]["peak"]) / 2**20 if len(SIZES) > 1 else 0.0
    claims.append(Claim(f"peak memory, {SIZES[-1]} runs against {SIZES[-2 if len(SIZES) > 1 else -1]}", "at most 150 MB more",
                        f"{more:.0f} MB more", more <= 150.0, f"peak {last['peak'] / 2**20:.0f} MB"))
    hours = last["processor"] / last["runs"] * 1e6 / 3600
    size = last["bytes"] / last["runs"] * 1e6 / 1e9
    title = f"Each sweep (a million runs: {hours:.2f} hours of one processor, {size:.0f} GB, not packed)"
    header = ("runs", "packed", "stored as", "runs a second", "processor us a run", "in HDF5",
              "in writing and seals", "kB a run", "peak MB")
    return Section("Sweeps, simulated and stored", tuple(claims), ((title, header, tuple(rows)),))
