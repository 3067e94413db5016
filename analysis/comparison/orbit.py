"""Orbits: motion along y over motion along x amid steady cutting, measured and predicted, where both were measured alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbed.analysis.comparison.residual_views import drawn_unit
from testbed.analysis.fit.held_out import RecordError
from testbed.analysis.fit.observed import Observed
from testbed.machine import CARRIERS
from testbed.recording import MOTION_UNITS, motion_channel

TURNS = 3  # revolutions that are drawn


@dataclass(frozen=True)
class Orbit:
    """Some revolutions of a record: measured and predicted (2, samples), x and y, in `unit`. noise: residual over noise, rms of
    both channels over the whole record."""

    name: str
    quantity: str
    unit: str
    measured: np.ndarray
    predicted: np.ndarray
    noise: float


def orbits(records: Sequence[Observed], errors: Sequence[RecordError], units: Mapping[str, str]) -> list[Orbit]:
    """Of every cut with steady cutting and a sensor along x and y on one carrier, the worst first. units: SI or own, by
    channel."""
    found = []
    for record, error in zip(records, errors, strict=True):
        steady = next((part for part in record.segments if part.kind == "steady"), None)
        if record.cut is None or steady is None:
            continue
        half = 0.5 * TURNS * record.period
        middle = 0.5 * (steady.start + steady.stop)
        first, last = (round((np.clip(time, steady.start, steady.stop) - record.start) * record.rate)
                       for time in (middle - half, middle + half))
        for on in CARRIERS:
            for quantity in MOTION_UNITS:
                pair = [motion_channel(f"{quantity}_{axis}", on) for axis in "xy"]
                if not set(pair) <= set(record.channels):
                    continue
                places = [record.channels.index(name) for name in pair]
                drawn = [drawn_unit(name, units) for name in pair]
                if drawn[0] != drawn[1]:  # of different units no shape can be told
                    continue
                data, rest = record.data[places], error.residual[places]
                data = (data - (data @ record.drift) @ record.drift.T)[:, first:last] * drawn[0][0]
                ratio = float(np.sqrt(np.mean((rest / record.noise[places][:, None]) ** 2)))
                found.append(Orbit(record.name, f"{quantity} of the {on}", drawn[0][1], data,
                                   data - rest[:, first:last] * drawn[0][0], ratio))
    return sorted(found, key=lambda one: -one.noise)
