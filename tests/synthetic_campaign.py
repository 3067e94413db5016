"""A campaign of cuts by an engine, with everything a measurement adds that nobody tells: the harder half of a test.

Unknown to whoever fits it: the tachometer's angle, a spindle speed a little off, offset, slow drift, 16-bit counts, white
noise, the sample at which the record starts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from testbed.campaign import Record
from testbed.cut import Cut, whole_cut_sampling
from testbed.machine import Model
from testbed.manifest import Feed
from testbed.recording import Recording

RPM = 2 * math.pi / 60
# (rpm, mm): all stable with the flexure, |mu| from 0.68 to 0.98
TESTS = ((3810, 2.9), (2850, 2.9), (4300, 2.5), (2700, 1.5), (4200, 1.5), (3500, 0.8), (2600, 1.5), (3900, 2.2))
COURSE = (15, 70, 30)  # revolutions of idling, cutting, ringing down
MARK_ANGLE = 1.1  # rad
RANGE = 2e-4  # m, of the 16 bits to either side


def synthetic_record(simulate: Callable, model: Model, rpm: float, depth: float, seed: int, *, noise: float = 1e-6,
                     rate: float = 12800.0, speed_error: float = 5e-4, feed: float = 0.1016e-3) -> Record:
    """One cut (depth m, feed m a tooth), simulated by an engine's `simulate` and measured with `noise` (rms, m)."""
    random = np.random.default_rng(seed)
    speed = rpm * RPM * (1 + speed_error * random.uniform(-1, 1))
    flutes = model.cutter.flutes
    cut = Cut(speed, depth, feed, *(part * flutes for part in COURSE))
    clean = simulate(model, cut, whole_cut_sampling(cut, flutes, rate))
    time, signal = clean.time, clean.channels["displacement"].copy()
    signal += noise * random.standard_normal(signal.size) + 5e-6 * random.standard_normal()
    signal += 3e-6 * np.sin(0.7 * time + random.uniform(0, 6))
    count = RANGE / 2**15
    signal = np.round(signal / count) * count
    marks = clean.marks - MARK_ANGLE / speed
    marks = marks[np.isfinite(marks)]
    first = int(random.integers(0, 150))
    seen = np.isfinite(signal)
    last = int(seen.size if seen.all() else np.argmin(seen))
    marks = marks[(marks >= time[first]) & (marks <= time[last - 1])] + random.normal(0, 1e-6)
    conditions = {"spindle_speed": rpm * RPM, "axial_depth_of_cut": depth, "feed_per_tooth": feed,
                  "feed_per_revolution": feed * flutes}
    recording = Recording({"displacement": signal[first:last]}, rate, {"displacement": "m"}, "synthetic", time[first],
                          marks, conditions=conditions)
    return Record(f"{rpm:.0f}rpm_{depth * 1e3:.1f}mm", "cut", recording, conditions, (), feed=Feed(feed, "tooth"))


def synthetic_campaign(simulate: Callable, model: Model, *, seed: int = 0, noise: float = 1e-6,
                       tests: Sequence[tuple[float, float]] = TESTS, **more: float) -> list[Record]:
    """All cuts of a campaign; tests: (rpm, mm)."""
    return [synthetic_record(simulate, model, rpm, depth * 1e-3, 100 * seed + number, noise=noise, **more)
            for number, (rpm, depth) in enumerate(tests)]
