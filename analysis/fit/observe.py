"""A campaign's record made ready for a fit: which channels and samples count, their noise, and how the spindle turned."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from testbed.analysis.fit.against_force import moves_against
from testbed.analysis.fit.drift import drift_basis, drift_terms
from testbed.analysis.fit.force_window import windowed
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.thinning import every_nth
from testbed.analysis.records.noise import noise_floor
from testbed.analysis.records.passing_speed import heard_speed
from testbed.analysis.records.ring_downs import blow_times, said_blows, used_samples
from testbed.analysis.records.segments import find_segments
from testbed.analysis.records.spindle_clock import check_speed, clock_error, clock_of, digital, samples_to_rise, smoothed
from testbed.analysis.records.white_noise import white_noise
from testbed.machine import Carrier, Cutter, Model
from testbed.readers.checks import clipped_samples
from testbed.recording import DERIVATIVES, Recording, sensor_of

UNRESOLVED = 1e-4  # of a channel's rms: the engines' own error, which in data without noise would be a missing effect
MOST_CLIPPED = 0.5  # share of a record's samples
BESIDE, FEWEST_BESIDE = 0.15, 2  # of the samples clipped in a row, and how many at the least, to either side


def _clipped(data: np.ndarray) -> np.ndarray:
    """Samples (samples,) of channels (channels, samples) whose value lies beyond what one of them could measure, or nearly.

    Those beside them count as well: kept only where their noise left them below the limit, they would bend a fit. None where
    most of a record is clipped: then the limit is no recorder's.
    """
    stuck = np.any([clipped_samples(row) for row in data], axis=0)
    if not stuck.any() or stuck.mean() > MOST_CLIPPED:
        return np.zeros(len(stuck), dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], stuck.astype(np.int8), [0]))))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        beside = max(FEWEST_BESIDE, round(BESIDE * (last - first)))
        stuck[max(first - beside, 0) : last + beside] = True
    return np.asarray(stuck)


_FORCES = ("force_x", "force_y")


def observe(record: Any, model: Model) -> Observed:
    """Make a campaign's record (`files.campaign.Record`) ready. ValueError where it holds nothing that can be predicted."""
    planar = model.structure.planar
    recording = record.recording.in_the_plane() if planar else record.recording.along_feed()
    names = _predicted(recording, record.kind, planar)
    if not names:
        where = "of motion along x or y" if planar else "of the workpiece along x"
        raise ValueError(f"record {record.name} has no channel {where}: this model predicts no other")
    excited = record.kind == "excited"
    segments = find_segments(recording, kind=record.kind, channel=names[0] if planar else None)
    data = np.array([recording.channels[name] for name in names], dtype=float)
    blows = blow_times(recording) if record.kind == "ring-down" else ()
    if blows:
        raise ValueError(f"{said_blows(blows)} are no single free decay: give from and to")
    slowest, fastest = model.structure.frequency_range
    first, last = used_samples(recording, record.kind, segments, names[0], slowest)
    data = data[:, first:last]
    floors = [noise_floor(recording, segments, name) for name in names]
    noise = np.array([max(floor.rms, UNRESOLVED * float(np.std(row)), 1e-300) for floor, row in zip(floors, data, strict=True)])
    conditions = record.conditions
    known = ("spindle_speed", "axial_depth_of_cut", "feed_per_tooth", "feed_per_revolution")
    condition = (record.kind, *(round(float(conditions[key]), 9) for key in known if key in conditions))
    if record.kind != "cut":
        condition = (record.kind, record.name)
    filled = np.isin(np.arange(first, last), recording.filled) | _clipped(data)
    terms = drift_terms(data.shape[1] / recording.sampling_rate, slowest)
    base = Observed(
        record.name, record.kind, names, data,
        recording.sampling_rate,
        recording.start + first / recording.sampling_rate,
        noise, floors[0].basis,
        np.zeros((0, terms)),
        segments,
        condition,
        noise_doubt=floors[0].doubt,
        mask=~filled if filled.any() else None,
        filled=filled if filled.any() else None,
        modes=len(model.structure.modes),
    )
    if excited:
        drive = next(name for name in record.excitations)
        force = windowed(np.asarray(recording.channels[drive], dtype=float))[first:last]
        driven = replace(base, force=force, drift=drift_basis(data.shape[1], terms))
        return _with_the_force(replace(driven, pushed=_pushed(driven, drive)) if planar else driven, force)
    if record.kind == "ring-down":
        return _thinned(replace(base, force=np.zeros(data.shape[1])), terms, fastest)
    ready = _with_clock(base, record, (model.cutter or Cutter()).flutes)
    # of a cut by forces alone nothing in the record shows the dynamometer's zero, and the mean force speaks of the edge: the
    # zero is believed
    return _thinned(ready, 0 if ready.starts_in_cut and ready.forces_only else terms, fastest)


def _predicted(recording: Recording, kind: str, planar: bool) -> tuple[str, ...]:
    """Names of the channels of a record that a model predicts; in the plane the clearest comes first, which begins a search."""
    known = (lambda name: sensor_of(name) is not None) if planar else DERIVATIVES.__contains__
    names = [name for name in recording.channels if known(name) or (kind == "cut" and name in _FORCES)]
    return tuple(sorted(names, key=lambda name: (name in _FORCES, -_clearness(recording.channels[name]))) if planar else names)


def _clearness(values: np.ndarray) -> float:
    """How far a channel moves over what in it is no smooth motion."""
    return float(np.std(values)) / max(white_noise(np.asarray(values, dtype=float)), 1e-300)


def _pushed(record: Observed, drive: str) -> tuple[Carrier, tuple[float, float]]:
    """What a measured force drives, and along which axis. ValueError where the record does not say."""
    places = {sensor.on for sensor in record.sensors if sensor is not None}
    if len(places) > 1:
        raise ValueError(f"record {record.name} shows motion of workpiece and tool, and its force may act on either: "
                         "give the channels of the one that was driven")
    return places.pop(), (0.0, 1.0) if drive.endswith("_y") else (1.0, 0.0)


def _thinned(record: Observed, terms: int, frequency: float) -> Observed:
    """The record with the samples that are fitted, and so many terms of drift; all samples where forces were measured."""
    passing, force = record.flutes / record.period if record.cut is not None else 0.0, record.force
    every = every_nth(record.samples, record.rate, frequency, passing)
    if every == 1 or any(name.startswith("force") for name in record.channels):
        return replace(record, drift=drift_basis(record.samples, terms))
    data, filled = record.data[:, ::every].copy(), None if record.filled is None else record.filled[::every].copy()
    return replace(record, data=data, rate=record.rate / every, every=every, drift=drift_basis(data.shape[1], terms),
                   force=None if force is None else force[::every].copy(), filled=filled,
                   mask=None if filled is None else ~filled)


def _with_the_force(record: Observed, force: np.ndarray) -> Observed:
    """The driven record with those channels turned that move against the force."""
    rows = zip(record.sensors, record.data, record.noise, strict=True)
    turned = [sensor is not None and record.pushed[1][sensor.axis] == 1.0
              and moves_against(force, values, record.rate, sensor.order, float(noise)) for sensor, values, noise in rows]
    names = tuple(name for name, one in zip(record.channels, turned, strict=True) if one)
    return replace(record, data=np.where(np.array(turned)[:, None], -record.data, record.data), turned=names)


def _with_clock(base: Observed, record: Any, flutes: int) -> Observed:
    cut = record.cut(flutes)
    marks = np.asarray(record.recording.marks)
    period, anchor, kept, error, slots, calm = 2 * math.pi / cut.spindle_speed, None, None, None, 1, None
    if len(marks) >= 3:
        halfway = digital(marks, base.rate, record.recording.start)
        sample = 1.0 / base.rate if halfway else 0.0
        period, anchor, steady = clock_of(marks, sample, base.rate)
        check_speed(period, 2 * math.pi / cut.spindle_speed)
        slots = record.recording.pulses_per_revolution
        calm = marks if steady else None
        if flutes % slots:  # which pulse came first is open: the marks tell the speed alone
            anchor = None
        elif steady:
            error = clock_error(marks, period, anchor, base.rate, halfway=halfway, rise=samples_to_rise(record.recording))
        else:  # passes are then laid between the marks themselves
            kept = smoothed(marks, 1.0 / base.rate, halfway=halfway)
            anchor = float(kept[0])
    else:
        period = 2 * math.pi / (heard_in(base, cut.spindle_speed, flutes) or cut.spindle_speed)
    travels = record.feed is not None and record.feed.per == "second"
    if travels:  # as stated, whatever the spindle does
        cut = replace(cut, feed_per_tooth=record.feed.per_tooth(2 * math.pi / period, flutes))
    return replace(
        base,
        cut=cut,
        feed_basis="travel" if travels else "tooth",
        flutes=flutes,
        period=period,
        first_mark=anchor,
        marks=kept,
        clock_error=error,
        slots=slots if anchor is not None else 1,
        steady_marks=calm,
        starts_in_cut=base.segments[0].kind in ("steady", "exit"),
    )


def heard_in(base: Observed, stated: float, flutes: int) -> float | None:
    """Spindle speed (rad/s) by the harmonics of the longest steady stretch, else of the cut; None where none stand out."""
    steady = [(one.start, one.stop) for one in base.segments if one.kind == "steady"]
    cutting = [(one.start, one.stop) for one in base.segments if one.kind in ("entry", "exit")]
    start, stop = max(steady or cutting, key=lambda one: one[1] - one[0], default=(base.start, base.start))
    idle = next((one.start for one in base.segments if one.kind != "idle"), start)  # the entry has the lines of the cut, too
    first, last, before = (round((time - base.start) * base.rate) for time in (start, stop, idle))
    return heard_speed(base.data[0, first:last], base.rate, stated, flutes, idle=base.data[0, :before])
