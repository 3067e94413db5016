"""A sweep in processes of its own, to be killed: python sweep_kills.py OUTPUT RUNS prints its content hash."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from testbed.files.yaml_text import parse
from testbed.scenario.scenario_file import scenario_from
from testbed.sweeps import sweep
from testbed.sweeps.shards import find
from tests.support import plain_engine

TEXT = """name: killed
seed: 5
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 1, diameter: 19.05 mm}
  cutting: {immersion: 0.1, tangential_coefficient: 550 N/mm^2, normal_coefficient: 200 N/mm^2}
cut: {cutting: 5 rev, spread: {displacement: 5 um}}
sweep:
  spindle_speed: {from: 5000 rpm, to: 6000 rpm, count: RUNS}
  depth_of_cut: 2 mm
sensors:
  sampling_rate: 2 kHz
  displacement: {noise: 1 um, bits: 16, range: 1 mm}
"""
HERE = Path(__file__).parents[1]


def scenario(runs):
    return scenario_from(parse(TEXT.replace("RUNS", str(runs)), "killed.yaml"))


def start(output, runs):
    """The sweep as a process of its own, in a process group of its own."""
    path = os.pathsep.join([str(HERE), str(HERE.parent)])
    return subprocess.Popen([sys.executable, str(Path(__file__)), str(output), str(runs)],
                            env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.PIPE, start_new_session=True)


def workers_of(process):
    """Numbers of the worker processes (Linux): children that run multiprocessing's spawn_main."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rpartition(")")[2].split()[1])
            if parent == process.pid and b"spawn_main" in (path.parent / "cmdline").read_bytes():
                found.append(int(path.parent.name))
        except (OSError, IndexError):
            continue
    return found


def kill_workers(output, runs, kills, rng):
    """Run a sweep to its end while its workers are killed, `kills` times; (content hash, kills that hit).

    Each kill waits for a shard more than there were at the last one, then for a random time.
    """
    process, hit, there = start(output, runs), 0, 0
    while process.poll() is None:
        alive = workers_of(process)
        if hit < kills and alive and shards_there(output) > there:
            time.sleep(float(rng.uniform(0.0, 0.1)))
            there = shards_there(output)
            try:
                os.kill(int(rng.choice(alive)), signal.SIGKILL)
                hit += 1
            except ProcessLookupError:
                continue
        time.sleep(0.01)
    return json.loads(process.stdout.read())["content_hash"], hit


def kill_whole(output, runs, kills, rng, most=200):
    """Kill a sweep as a whole, workers and all, and continue it, `kills` times; (content hash, kills that hit)."""
    for hit in range(most):
        process, there = start(output, runs), shards_there(output)
        while process.poll() is None and (hit >= kills or shards_there(output) <= there):
            time.sleep(0.01)
        time.sleep(float(rng.uniform(0.0, 0.1)))
        if process.poll() is not None:
            return json.loads(process.stdout.read())["content_hash"], hit
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    raise AssertionError("the sweep never came to its end")


def shards_there(output):
    """How many shards stand there."""
    parts = Path(f"{output}.parts")
    return len(find(parts)) if parts.is_dir() else 0


if __name__ == "__main__":
    sweep.LARGEST_BATCH = dict.fromkeys(sweep.LARGEST_BATCH, 8)  # many shards, so that many kills find work to spoil
    report = sweep.run(scenario(int(sys.argv[2])), plain_engine.slow, sys.argv[1], workers=2, processes=True, resume=True)
    print(json.dumps({"content_hash": report.content_hash, "outcomes": dict(report.outcomes)}))
