"""Speed, side by side in one run, at one error: python benchmarks/run.py writes benchmarks/RESULTS.md.

Every path simulates the same transient, 60 tooth periods from rest, with the fewest steps that keep its error below
1e-4 of the peak. One core; the best of several repeats.
"""

# ruff: noqa: E402 - the number of threads is read when numpy is imported
from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mujoco
import numpy as np

from benchmarks import peers
from testbed.analysis.linear import cells
from testbed.analysis.linear.stability import stability_chart
from testbed.catalogue import catalogue
from testbed.cut import Cut, Cuts, Sampling, whole_cut_sampling
from testbed.engines import fast, linear_kernel, mujoco_engine
from testbed.engines import sampling_kernel as sk
from testbed.engines.packing import pack
from tests.validation.claims import FLEXURE, PAPER, rpm

ERROR, BATCH, RATE = 1e-4, 50, 12800.0
SILENT = 4096  # runs in a batch of which no record is kept: sixteen go side by side
STABLE, GROWING = rpm(3810, 2.9, passes=60), rpm(3635, 2.0, passes=60)
TARGET = Path(__file__).resolve().parent / "RESULTS.md"


def best(work: Callable[[], object], repeats: int) -> float:
    """Shortest time of `work`, s, after one call that does not count."""
    work()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def displacement(engine, cut: Cut, steps: int) -> np.ndarray:
    """The record of one transient, m."""
    sampling = whole_cut_sampling(cut, 1, RATE)
    return engine.simulate(FLEXURE, cut, sampling, steps=steps).channels["displacement"]


def fewest_steps(engine, cut: Cut, counts: range) -> tuple[int, float]:
    """(steps in the cut, error) that first keep the error of the whole record below ERROR of its peak."""
    exact = displacement(fast, cut, 400)
    for steps in counts:
        found = displacement(engine, cut, steps)[: exact.size]
        error = float(np.nanmax(np.abs(found - exact)) / np.abs(exact).max())
        if error < ERROR:
            return steps, error
    raise ValueError("no step count reached the error")


def fast_times(cut: Cut, steps: int) -> tuple[float, float, float]:
    """Seconds a run: the whole call without output, with a 12.8 kHz record, and the kernel alone without output."""
    models, cuts, record = [FLEXURE] * BATCH, [cut] * BATCH, whole_cut_sampling(cut, 1, RATE)
    many, columns = [FLEXURE] * SILENT, Cuts.of([cut] * SILENT)
    silent = best(lambda: fast.simulate_batch(many, columns, None, steps=steps), 50) / SILENT
    loud = best(lambda: fast.simulate_batch(models, cuts, [record] * BATCH, steps=steps), 100) / BATCH
    packed = [pack(FLEXURE, cut, catalogue(), steps) for _ in range(BATCH)]
    G, integers, Y = (np.ascontiguousarray([getattr(one, name) for one in packed]) for name in "GIY")
    clock, out = np.array([[0.0, 1.0]] * BATCH), np.empty((BATCH, sk.N_CHANNELS, 1))
    times, states = np.empty((BATCH, 61)), np.empty((BATCH, 61, 2))
    outcome, when = np.empty(BATCH, dtype=np.int64), np.empty(BATCH)

    def kernel() -> None:
        Y[:, :2] = 0.0
        linear_kernel.run_linear_batch(G, integers, Y, clock, 1.0, out, times, states, outcome, when)

    return silent, loud, best(kernel, 200) / BATCH


def mujoco_times(cut: Cut, steps: int, repeats: int = 15) -> tuple[float, float, int]:
    """(seconds with the cut in the plugin, seconds of bare mj_step, steps a period).

    Pass by pass in turn, each pass's shortest time summed, so that a busy machine burdens both alike.
    """
    run = mujoco_engine.prepare(FLEXURE, cut, steps=steps)
    per_pass = run.steps_per_pass
    bare = peers.bare_model(FLEXURE, cut.tooth_passing_period(1) / per_pass)
    data = mujoco.MjData(bare)
    data.qpos[0] = 1e-4
    times = np.empty((repeats, cut.passes, 2))
    for repeat in range(repeats):
        mujoco.mj_resetData(run.model, run.data)
        run.done = 0
        for number in range(cut.passes):
            begin = time.perf_counter()
            run.advance(1)
            middle = time.perf_counter()
            mujoco.mj_step(bare, data, nstep=per_pass)
            times[repeat, number] = middle - begin, time.perf_counter() - middle
    cutting, alone = times.min(axis=0).sum(axis=0)
    return float(cutting), float(alone), per_pass


def peer_rows(cut: Cut, inside: int, per_pass: int) -> list[tuple[str, ...]]:
    """Peers on the same transient: error of x at the tooth's entries over the peak, and time.

    An adaptive peer is given the loosest tolerance that keeps the error below ERROR (else the tightest tried).
    """
    exact = fast.simulate_batch([FLEXURE], [cut], [Sampling(1.0, 1)], steps=400).pass_states[0, :, 0]
    peak = float(np.abs(displacement(fast, cut, 400)).max())

    def error(found: np.ndarray) -> float:
        return float(np.abs(found - exact).max() / peak)

    def row(name: str, work: Callable[[], np.ndarray], repeats: int) -> tuple[str, ...]:
        seconds = best(work, repeats)
        return name, f"{error(work()):.1e}", f"{seconds * 1e3:.3g}", f"{1 / seconds:.3g}", "", ""

    def adaptive(name: str, solve: Callable[[float], np.ndarray], repeats: int) -> tuple[str, ...]:
        for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
            if error(solve(tolerance)) < ERROR:
                break
        return row(f"{name}, tolerance {tolerance:g}", lambda: solve(tolerance), repeats)

    rows = [row(f"MuJoCo RK4 + Python callback, {per_pass} steps a period",
                lambda: peers.python_callback(FLEXURE, cut, inside, per_pass), 5),
            adaptive("scipy solve_ivp, method of steps restarted at events",
                     lambda tolerance: peers.method_of_steps(FLEXURE, cut, tolerance), 5)]
    try:
        rows.append(adaptive("JiTCDDE, compiled, smoothed engagement", peers.jitcdde_solver(FLEXURE, cut), 3))
    except ImportError as missing:
        rows.append(("JiTCDDE", "-", "-", "-", "", f"not run: {missing} (`pip install -e .[bench]`)"))
    return rows


def chart_seconds(repeats: int = 20) -> tuple[float, float]:
    """Processor time of a stability chart of 200 speeds by 200 depths, s: cells side by side, and one after another.

    In turn, the best of each, so that a busy machine burdens both alike.
    """
    speeds, depths = np.linspace(2500, 4500, 200) * 2 * np.pi / 60, np.linspace(0.1e-3, 4e-3, 200)
    lanes, times = cells.IN_LANES, np.empty((repeats + 1, 2))
    for repeat in range(repeats + 1):
        for road, unknowns in enumerate((lanes, 0)):
            cells.IN_LANES = unknowns
            begin = time.process_time()
            stability_chart(PAPER, speeds, depths)
            times[repeat, road] = time.process_time() - begin
    cells.IN_LANES = lanes
    together, alone = times[1:].min(axis=0)
    return float(together), float(alone)


def verdict(holds: bool) -> str:
    """The word in the table."""
    return "met" if holds else "MISSED"


def main() -> None:
    """Measure, print and write."""
    rows: list[tuple[str, ...]] = []
    for kind, cut in (("stable", STABLE), ("growing", GROWING)):
        steps, error = fewest_steps(fast, cut, range(4, 60))
        silent, loud, kernel = fast_times(cut, steps)
        for name, seconds, target in (("kernel alone, one run after the other", kernel, None), ("no output", silent, 300_000),
                                      ("12.8 kHz record", loud, 15000)):
            rows.append((f"fast engine, {kind} cut, {steps} steps in the cut, {name}", f"{error:.1e}",
                         f"{seconds * 1e3:.3g}", f"{1 / seconds:,.0f}", f">= {target:,} runs/s" if target else "",
                         verdict(1 / seconds >= target) if target else ""))
    steps, error = fewest_steps(mujoco_engine, STABLE, range(8, 80, 2))
    cutting, bare, per_pass = mujoco_times(STABLE, steps)
    cheap = cutting <= 1.2 * bare
    rows.append((f"MuJoCo RK4 + native plugin, {per_pass} steps a period", f"{error:.1e}", f"{cutting * 1e3:.3g}",
                 f"{1 / cutting:.3g}", "<= 1.2 x bare", f"{cutting / bare:.2f} x: {verdict(cheap)}"))
    rows.append((f"bare mj_step, {per_pass} steps a period, nothing cut", "-", f"{bare * 1e3:.3g}", f"{1 / bare:.3g}",
                 "", ""))
    rows += peer_rows(STABLE, steps, per_pass)
    chart, alone = chart_seconds()
    rows.append(("stability chart 200 x 200, cells side by side, processor time", "1e-5 of the modulus", f"{chart * 1e3:.3g}",
                 "-", "<= 40 ms", f"{alone / chart:.1f} times faster than one by one: {verdict(chart <= 0.04)}"))
    rows.append(("the same, cell after cell", "1e-5 of the modulus", f"{alone * 1e3:.3g}", "-", "", ""))
    header = ("path", "error", "ms a run", "runs a second", "target", "")
    lines = ["| " + " | ".join(row) + " |" for row in (header, ("---",) * 6, *rows)]
    load = os.getloadavg()[0]
    head = ("Written by `make bench`. 60 tooth periods from rest, error below 1e-4 of the peak, one core, best of several\n"
            f"repeats; batches of {BATCH} for the fast engine ({SILENT} without output), packing of inputs included. Load of\n"
            f"the machine when written: {load:.1f} on {os.cpu_count()} cores. Sweeps to disk, before and now: SWEEPS.md.")
    text = "\n".join(["# Speed", "", head, "", *lines, ""])
    print(text)
    TARGET.write_text(text)


if __name__ == "__main__":
    main()
