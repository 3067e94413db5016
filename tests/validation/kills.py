"""Sweeps under fire: workers killed 200 times, whole sweeps 50 times, with SIGKILL; every run once, content unchanged."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from testbed.store.data_set import read_data_set
from testbed.sweeps import sweep
from tests.support import plain_engine, sweep_kills
from tests.validation.claims import Claim, Section

WORKER_KILLS, WHOLE_KILLS = 200, 50
RUNS = {WORKER_KILLS: 3200, WHOLE_KILLS: 1200}


def _claim(what: str, kills: int, kill, rng: np.random.Generator, folder: Path) -> Claim:
    runs = RUNS[kills]
    undisturbed = sweep.run(sweep_kills.scenario(runs), plain_engine.simulate, folder / f"whole{kills}.h5")
    digest, hit = kill(folder / f"killed{kills}.h5", runs, kills, rng)
    data = read_data_set(folder / f"killed{kills}.h5")
    once = data.scenario_run.tolist() == list(range(runs)) and set(data.outcome) == {"ok"}
    same = digest == undisturbed.content_hash
    found = f"{hit} kills; runs each once: {'yes' if once else 'NO'}; content hash: {'the same' if same else 'ANOTHER'}"
    return Claim(f"{what} of a sweep of {runs} runs", f"{kills} kills, nothing lost, nothing changed", found,
                 hit == kills and once and same)


def check() -> Section:
    """The section of the table."""
    if sys.platform != "linux":
        return Section("Sweeps under SIGKILL", (Claim("kills", "nothing lost", "-", None, "looks for workers in /proc"),))
    rng = np.random.default_rng(2026)
    with tempfile.TemporaryDirectory() as folder:
        return Section("Sweeps under SIGKILL", (
            _claim("worker processes", WORKER_KILLS, sweep_kills.kill_workers, rng, Path(folder)),
            _claim("all processes", WHOLE_KILLS, sweep_kills.kill_whole, rng, Path(folder)),
        ))
