"""A campaign of cuts by an engine, with everything a measurement adds that nobody tells: the harder half of a test."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from testbed.cut import Cut
from testbed.files.campaign import Record
from testbed.machine import Model
from testbed.workshop import RPM, Measurement, measured_cut

# (rpm, mm): all stable with the flexure, |mu| from 0.68 to 0.98
TESTS = ((3810, 2.9), (2850, 2.9), (4300, 2.5), (2700, 1.5), (4200, 1.5), (3500, 0.8), (2600, 1.5), (3900, 2.2))
COURSE = (15, 70, 30)  # revolutions of idling, cutting, ringing down
MARK_ANGLE = 1.1  # rad


def synthetic_record(simulate: Callable, model: Model, rpm: float, depth: float, seed: int, *, noise: float = 1e-6,
                     rate: float = 12800.0, speed_error: float = 5e-4, feed: float = 0.1016e-3,
                     course: Sequence[int] = COURSE, mark_angle: float = MARK_ANGLE,
                     state: tuple[float, float] = (0.0, 0.0)) -> Record:
    """One cut (depth m, feed m a tooth), simulated by an engine's `simulate` and measured with `noise` (rms, m).

    Of several teeth another one cuts first from record to record, as on a machine. state: the structure's displacement (m) and
    velocity (m/s) at the start.
    """
    idle, *passes = (part * model.cutter.flutes for part in course)
    passes = (idle + seed % model.cutter.flutes, *passes)
    how = Measurement(rate=rate, noise=noise, speed_error=speed_error, mark_angle=mark_angle)
    cut = Cut(rpm * RPM, depth, feed, *passes, *state)
    return measured_cut(simulate, model, cut, how, seed, f"{rpm:.0f}rpm_{depth * 1e3:.1f}mm")


def synthetic_campaign(simulate: Callable, model: Model, *, seed: int = 0, noise: float = 1e-6,
                       tests: Sequence[tuple[float, float]] = TESTS, **more) -> list[Record]:
    """All cuts of a campaign; tests: (rpm, mm)."""
    return [synthetic_record(simulate, model, rpm, depth * 1e-3, 100 * seed + number, noise=noise, **more)
            for number, (rpm, depth) in enumerate(tests)]


def begun_later(record: Record, turns: float) -> Record:
    """The record without its first revolutions, so many at the speed that is stated."""
    recording = record.recording
    later = round(turns * 2.0 * math.pi / record.conditions["spindle_speed"] * recording.sampling_rate)
    start = recording.start + later / recording.sampling_rate
    channels = {name: values[later:] for name, values in recording.channels.items()}
    marks = recording.marks[recording.marks > start]
    return replace(record, recording=replace(recording, channels=channels, start=start, marks=marks))
