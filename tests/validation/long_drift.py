"""Long records of a right model whose sensor drifts: does `compare` call what is left noise, however long they are?

Cuts of the flexure by the fast engine, of 5 to 120 s at 3.2 kHz, with the workshop's unknowns, compared by the model that made
them. Drifts: none, the workshop's 3 um that turns in 9 s, and 10 um that turns in 5 s and, slower, in 31 s.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

from tests.validation.claims import Claim, Section

RATE = 3200.0  # Hz
SECONDS = (5, 8, 12, 20, 30, 45, 60, 120)
DRIFTS = {"none": (), "3 um": ((3e-6, 0.7),), "10 um": ((7e-6, 1.25), (7e-6, 0.2))}  # (m, rad/s)


def _one(seconds: float, drifts: tuple[tuple[float, float], ...], seed: int) -> tuple[bool, float]:
    """Whether compare finds nothing but noise left, and the error over the noise floor."""
    from functools import partial

    from testbed.analysis.comparison.compare import compare
    from testbed.analysis.fit.observe import observe
    from testbed.api.fitting import plant_of
    from testbed.catalogue import catalogue
    from testbed.cut import Cut
    from testbed.engines.fast import simulate
    from testbed.workshop import RPM, Measurement, measured_cut
    from tests.support.campaign_files import BELIEVED

    model = BELIEVED
    speed = (3810, 2850, 4200, 2600)[seed % 4] * RPM
    passes = int(seconds * speed / (2 * np.pi))
    cut = Cut(speed, 1.2e-3, 1e-4, idle_passes=passes // 8, passes=passes - passes // 4, ring_down_passes=passes // 8)
    record = measured_cut(partial(simulate, steps=37), model, cut, Measurement(RATE, drift=0.0), seed, "long")
    at, channels = record.recording.time, dict(record.recording.channels)
    phase = np.random.default_rng(seed).uniform(0, 6, len(drifts))
    for (size, rate), one in zip(drifts, phase, strict=True):
        channels["displacement"] = channels["displacement"] + size * np.sin(rate * at + one)
    record = replace(record, recording=replace(record.recording, channels=channels))
    effects = catalogue()
    found = compare(plant_of(effects), [observe(record, model)], model, effects)
    return found.adequate, found.error / found.noise_floor


def check() -> Section:
    """A line for each drift, and a table of all records."""
    claims, rows = [], []
    for name, drifts in DRIFTS.items():
        right = 0
        for seed, seconds in enumerate(SECONDS):
            began = time.process_time()
            adequate, left = _one(seconds, drifts, seed)
            right += adequate
            rows.append((name, str(seconds), "noise" if adequate else "more than noise", f"{left:.4f}",
                         f"{time.process_time() - began:.0f}"))
            print(*rows[-1], file=sys.stderr, flush=True)
        claims.append(Claim(f"drift {name}: what is left is noise", "all", f"{right} of {len(SECONDS)}", right == len(SECONDS)))
    table = ("Records", ("drift", "seconds", "left", "error over the noise floor", "processor s"), tuple(rows))
    return Section("Long records whose sensor drifts", tuple(claims), (table,))


if __name__ == "__main__":
    print(check())
