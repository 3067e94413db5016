"""Taps without a measured force: what rings after each blow gives frequencies, damping ratios and shapes, and no mass."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import stdtrit

from testbed.analysis.estimate import Estimate
from testbed.analysis.records.ring_downs import RingDown, RungMode, ring_downs, separated
from testbed.analysis.records.segments import find_segments
from testbed.files.campaign import Record
from testbed.machine import Carrier
from testbed.problem import InputProblem
from testbed.recording import Recording

SAME = 0.01  # of a frequency, within which two ring-downs show one mode
_MOST = 0.5  # share of the ring-downs that show a mode: what fewer show is left out
_AXES = {(1.0, 0.0): ("", 1.0), (-1.0, 0.0): ("", -1.0), (0.0, 1.0): ("_y", 1.0), (0.0, -1.0): ("_y", -1.0)}
UNKNOWN_MASS = Estimate(math.nan, math.nan, math.nan, "kg", bounded=False)


@dataclass(frozen=True)
class DecaySeen:
    """What rings after one blow of a tap without force."""

    tap: str
    on: Carrier
    ring: RingDown

    def as_json(self) -> dict[str, Any]:
        """SI values, for `--json`."""
        return {"tap": self.tap, "on": self.on, **self.ring.as_json()}


@dataclass(frozen=True)
class DecayMode:
    """One mode as several ring-downs show it together."""

    natural_frequency: Estimate
    damping_ratio: Estimate
    direction: Estimate
    on: Carrier


def decays_of(taps: Sequence[Any], place: str, notes: list[str]) -> tuple[list[DecaySeen], list[DecayMode]]:
    """What rings in taps (`taps_file.Tap`) without force, and the modes of it. Raises InputProblem where nothing does.

    Channels of one file belong together: only so do their ratios tell a shape.
    """
    together: dict[tuple, list[Any]] = {}
    for tap in taps:
        together.setdefault((tap.source, tap.on), []).append(tap)
    seen: list[DecaySeen] = []
    stated: dict[int, float | None] = {}
    for same in together.values():
        record, direction = _recording(same, place)
        parts = separated([Record(same[0].name, "ring-down", record)])
        for part in parts:
            rings = ring_downs(part.recording, find_segments(part.recording, kind="ring-down"))
            notes += [f"{part.name}: {note}" for ring in rings for note in ring.notes]
            for ring in rings:
                stated[len(seen)] = direction
                seen.append(DecaySeen(part.name, same[0].on, ring))
    if not any(one.ring.modes for one in seen):
        raise InputProblem(place, f"tap '{taps[0].name}' holds no mode: nothing in it rings above its noise",
                           "check the column of the response, or hit harder")
    modes: list[DecayMode] = []
    for on in dict.fromkeys(one.on for one in seen):
        modes += _joined([(number, mode, one) for number, one in enumerate(seen) if one.on == on for mode in one.ring.modes],
                         sum(one.on == on for one in seen), stated, notes)
    return seen, modes


def _recording(same: Sequence[Any], place: str) -> tuple[Recording, float | None]:
    """The channels of one file as a record, and the direction (rad) of the sensors where they all have the one."""
    first: Recording = same[0].record
    channels: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    for tap in same:
        values = tap.record.channels[tap.quantity]
        if len(values) != len(first) or tap.record.sampling_rate != first.sampling_rate:
            raise InputProblem(place, f"tap '{tap.name}' has channels of several lengths", "give one `from` and `to` to all")
        axis = _AXES.get(tuple(round(one, 9) + 0.0 for one in tap.sensed))
        if axis is None and len(same) > 1:
            raise InputProblem(place, f"tap '{tap.name}': of several channels without force each sensor lies along x or y",
                               "give `direction: x` or y, or one channel alone")
        end, sign = axis or ("", 1.0)
        name = f"{tap.quantity}{end}" if len(same) > 1 else tap.quantity
        if name in channels:
            raise InputProblem(place, f"tap '{tap.name}' gives two channels of {tap.quantity} in one direction",
                               "give one of them")
        channels[name], units[name] = sign * np.asarray(values, dtype=float), tap.record.units[tap.quantity]
    angles = {round(math.atan2(tap.sensed[1], tap.sensed[0]), 9) for tap in same}
    tool = tuple(channels) if same[0].on == "tool" else ()
    record = Recording(channels, first.sampling_rate, units, "measured", start=first.start, on_tool=tool)
    return record, angles.pop() if len(angles) == 1 else None


def _joined(rung: Sequence[tuple[int, RungMode, DecaySeen]], count: int, stated: dict[int, float | None],
            notes: list[str]) -> list[DecayMode]:
    """The modes of all ring-downs of a carrier: neighbours in frequency, one of each ring-down, are one mode."""
    left = sorted(rung, key=lambda one: one[1].natural_frequency.value)
    groups: list[list[tuple[int, RungMode, DecaySeen]]] = []
    for one in left:
        last = groups[-1] if groups else []
        near = bool(last) and one[1].natural_frequency.value < (1.0 + SAME) * last[0][1].natural_frequency.value
        if near and one[0] not in [other[0] for other in last]:
            last.append(one)
        else:
            groups.append([one])
    found = []
    for group in groups:
        frequency = _mean([one[1].natural_frequency for one in group])
        if len(group) < _MOST * count:
            notes.append(f"{frequency.value:.5g} Hz rings in {len(group)} of {count} ring-downs only: left out")
            continue
        directions = [one[1].direction for one in group if one[1].direction is not None]
        angle = stated[group[0][0]]
        direction = _mean(_unfolded(directions)) if directions else Estimate(angle or 0.0, angle or 0.0, angle or 0.0, "rad",
                                                                               size=1.0, bounded=angle is not None)
        found.append(DecayMode(frequency, _mean([one[1].damping_ratio for one in group]), direction, group[0][2].on))
    return found


def _unfolded(angles: Sequence[Estimate]) -> list[Estimate]:
    """Directions within half a turn of the first: a mode along -x is one along x."""
    moved = [math.pi * round((one.value - angles[0].value) / math.pi) for one in angles]
    return [Estimate(one.value - by, one.low - by, one.high - by, one.unit, one.size)
            for one, by in zip(angles, moved, strict=True)]


def _mean(told: Sequence[Estimate]) -> Estimate:
    """The mean of estimates by their intervals; its own as they say, or as they scatter, whichever is wider."""
    values = np.array([one.value for one in told])
    wide = np.maximum([0.5 * (one.high - one.low) for one in told], 1e-12 * np.abs(values))
    if len(told) == 1:
        return told[0]
    if not np.all(wide > 0.0):
        wide = np.ones(len(told))
    weight = wide**-2.0 / np.sum(wide**-2.0)
    value = float(weight @ values)
    scatter = float(np.sqrt(weight @ (values - value) ** 2 / (len(told) - 1)))
    half = max(float(np.sum((weight * wide) ** 2)) ** 0.5, float(stdtrit(len(told) - 1, 0.975)) * scatter)
    return Estimate(value, value - half, value + half, told[0].unit, told[0].size)
