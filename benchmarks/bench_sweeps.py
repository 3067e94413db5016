"""Sweeps of this tree and of an older one, side by side in one run: us of processor time a run, and their ratios.

    git worktree add /tmp/before COMMIT && python benchmarks/bench_sweeps.py /tmp/before [--runs 8192] [--rounds 5]

60 tooth periods from rest, base model (see tests/validation/throughput.py). In each round every tree is measured in turn, in a
process of its own; of each measurement the best round counts. `silent`: no record is kept, batches of 4096, the engine's own
choice of steps. `to disk`: a folder of shards at 12.8 kHz, float32, not packed and packed by gzip, on two workers.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
WORKERS, SILENT = 2, 4096


def measure(runs: int) -> dict[str, float]:
    """us of processor time a run by this process's own tree, and, to disk, by the clock too."""
    from testbed.cut import Cut, Sampling
    from testbed.engines import fast
    from testbed.sweeps import sweep
    from tests.validation.claims import FLEXURE
    from tests.validation.throughput import scenario

    models = [FLEXURE] * SILENT
    cuts = [Cut(398.0 + 1e-3 * place, 1e-3 + 1e-7 * place, passes=60) for place in range(SILENT)]
    none = None if hasattr(fast, "simulate_side_by_side") else [Sampling(1.0, 1)] * SILENT  # as the tree's users call it
    times = []
    for _ in range(12):
        begin = time.thread_time()
        fast.simulate_batch(models, cuts, none)
        times.append(time.thread_time() - begin)
    found = {"silent": min(times[1:]) / SILENT * 1e6}
    with tempfile.TemporaryDirectory() as folder:
        sweep.run(scenario(20), fast.simulate, Path(folder) / "warm.h5", workers=WORKERS)
        for compression in ("none", "gzip"):
            clock, begin = time.perf_counter(), time.process_time()
            sweep.run(scenario(runs), fast.simulate, Path(folder) / compression, workers=WORKERS, compression=compression,
                      keep_shards=True)
            found[f"to disk, {compression}"] = (time.process_time() - begin) / runs * 1e6
            found[f"to disk, {compression}, by the clock"] = (time.perf_counter() - clock) / runs * 1e6
    return found


def main() -> None:
    """Measure both trees in turn and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("--runs", type=int, default=8192)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.measure:
        print(json.dumps(measure(given.runs)))
        return
    best: list[dict[str, float]] = [{}, {}]
    for _ in range(given.rounds):
        for found, tree in zip(best, (given.before.resolve(), HERE), strict=True):
            environment = {**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
            done = subprocess.run([sys.executable, __file__, str(tree), "--measure", "--runs", str(given.runs)], check=True,
                                  capture_output=True, text=True, cwd=tree, env=environment)
            for name, value in json.loads(done.stdout).items():
                found[name] = min(value, found.get(name, value))
    print("| sweep | before, us a run | now, us a run | ratio | runs a second now |\n| --- | --- | --- | --- | --- |")
    for name, now in best[1].items():
        workers = WORKERS if name.startswith("to disk") and not name.endswith("clock") else 1
        print(f"| {name} | {best[0][name]:.1f} | {now:.2f} | {best[0][name] / now:.2f} | {workers * 1e6 / now:,.0f} |")
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
