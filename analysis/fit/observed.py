"""A measured record made ready for fitting: its samples, its noise, and what is unknown of its course.

Nuisances are kept apart from the machine: offset and slow drift are projected out (they enter linearly), the state at the
start, the passes of entry and exit, and, without a tachometer, speed and tooth angle belong to the record; the angle between
tachometer mark and tooth entry belongs to the campaign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from analysis.fit.against_force import moves_against
from analysis.fit.drift import drift_basis, drift_terms, of_a_part, over
from analysis.fit.force_window import windowed
from analysis.fit.nuisances import Nuisances
from analysis.fit.thinning import every_nth
from analysis.records.free_decay import spectral_peak
from analysis.records.noise import noise_floor
from analysis.records.passing_speed import heard_speed
from analysis.records.ring_downs import blow_times, said_blows, used_samples
from analysis.records.segments import Segment, find_segments
from analysis.records.spindle_clock import along_marks, check_speed, clock_error, clock_of, digital, samples_to_rise, smoothed
from analysis.records.white_noise import white_noise
from testbed.cut import Cut, Sampling
from testbed.machine import Carrier, Cutter, Model
from testbed.readers.checks import clipped_samples
from testbed.recording import DERIVATIVES, Recording, Sensor, sensor_of

OPENING = 12  # revolutions from the entry that an opening holds at the least
UNRESOLVED = 1e-4  # of a channel's rms: the engines' own error, which in data without noise would be a missing effect
MOST_CLIPPED = 0.5  # share of a record's samples
BESIDE, FEWEST_BESIDE = 0.15, 2  # of the samples clipped in a row, and how many at the least, to either side
WARM_UP = 60  # revolutions simulated before a record that starts in the cut


@dataclass(frozen=True)
class Observed:
    """One record. data (channels, samples) in SI; noise (channels,) standard deviations; drift (samples, terms)
    orthonormal: an array, or Splines.

    period: of one revolution (s); first_mark: time of the first mark, s. clock_error: standard deviations of a record's own
    tooth angle (rad) and relative speed, from the scatter of its marks. segments and conditions as read. force (samples,)
    drives an excited record. length_summed: whether the length cut before is that of the records before, as nobody stated it.
    heard: whether it has a say in the fit. noise_doubt: standard error of the first channel's noise over itself. believed
    (samples,): those that count; all, where None. filled (samples,): those never measured, or clipped, which never count.
    measured: the record at the speed its marks show, left out here. slots: of how many slots of the spindle, all alike, the
    marks may be any.
    steady_marks: times (s) of all marks, where they show a constant speed. feed_basis: what the cut's feed a tooth comes from:
    it was written so ("tooth"), is what a table leaves that travels as stated ("travel"), or was taken so ("table", from what
    was written by feed_ratio); a table leaves less where the spindle turns faster than the period says. swung_front: see Cut.
    turned: names of channels that moved against the force, whose sign is turned here. every: of the samples measured, every
    so manieth is here; rate is that of those. modes: how many modes the structure has, which may all move as it begins.
    pushed: what the force of an excited record acts on, and its direction (x, y).
    """

    name: str
    kind: str
    channels: tuple[str, ...]
    data: np.ndarray
    rate: float
    start: float
    noise: np.ndarray
    noise_basis: str
    drift: Any
    segments: tuple[Segment, ...]
    condition: tuple[Any, ...]
    cut: Cut | None = None
    flutes: int = 1
    period: float = 0.0
    first_mark: float | None = None
    marks: np.ndarray | None = None
    force: np.ndarray | None = None
    starts_in_cut: bool = False
    clock_error: tuple[float, float] | None = None
    weight: np.ndarray | None = None
    heard: bool = True
    noise_doubt: float = 0.0
    believed: np.ndarray | None = None
    measured: Observed | None = None
    slots: int = 1
    steady_marks: np.ndarray | None = None
    feed_basis: str = "tooth"
    feed_ratio: float = 1.0
    filled: np.ndarray | None = None
    swung_front: bool = False
    length_summed: bool = False
    turned: tuple[str, ...] = ()
    every: int = 1
    modes: int = 1
    pushed: tuple[Carrier, tuple[float, float]] = ("workpiece", (1.0, 0.0))

    @property
    def forces_only(self) -> bool:
        """Whether every channel is a force: a dynamometer's, which says nothing of a motion."""
        return all(channel.startswith("force") for channel in self.channels)

    @property
    def scale(self) -> np.ndarray:
        """What a residual of 1 stands for, per channel: the noise, or the `weight` that a rough model's misfit asks for."""
        return self.noise if self.weight is None else self.weight

    @property
    def samples(self) -> int:
        """Number of samples a channel."""
        return self.data.shape[1]

    @cached_property
    def sensors(self) -> tuple[Sensor | None, ...]:
        """Of every channel, where its sensor sits; None for a force."""
        return tuple(sensor_of(name) for name in self.channels)

    @property
    def further_states(self) -> tuple[tuple[str, str], ...]:
        """Paths of displacement and velocity of every mode but the first, with which the record may begin."""
        return tuple((f"modes[{one}].displacement", f"modes[{one}].velocity") for one in range(1, self.modes))

    @cached_property
    def motion(self) -> tuple[int, int, float] | None:
        """(place of the first channel of motion, how often the displacement is differentiated in it, its main rad/s)."""
        for place, sensor in enumerate(self.sensors):
            if sensor is not None:
                values = self.data[place] - self.data[place].mean()
                return place, sensor.order, 2 * math.pi * max(spectral_peak(values), 1.0 / self.samples) * self.rate
        return None

    @cached_property
    def motion_size(self) -> float:
        """Standard deviation (m) of the displacement, as the first channel of motion shows it; by forces alone, the feed."""
        if self.motion is None:
            return self.cut.feed_per_tooth if self.cut is not None else 1e-4
        place, order, omega = self.motion
        return float(np.std(self.data[place])) / omega**order or 1.0

    @property
    def main_frequency(self) -> float:
        """Angular frequency (rad/s) of the strongest motion; by forces alone, that of 100 Hz."""
        return 2 * math.pi * 100.0 if self.motion is None else self.motion[2]

    @property
    def count(self) -> int:
        """Number of samples a channel that count."""
        return self.samples if self.believed is None else int(np.count_nonzero(self.believed))

    @property
    def size(self) -> int:
        """Number of values that count, over all channels: the length of a residual."""
        return len(self.channels) * self.count

    def project(self, values: np.ndarray) -> np.ndarray:
        """Values (..., channels, samples) in units of the scale, without what offset and drift could explain.

        Returned are the samples that count: shape (..., channels, count).
        """
        scaled, drift = values / self.scale[:, None], self.drift
        if self.believed is not None:
            scaled, drift = scaled[..., self.believed], self.counted_drift
        scaled -= (scaled @ drift) @ drift.T
        return scaled

    @cached_property
    def counted_drift(self) -> Any:
        """The drift's columns over the samples that count, (count, terms), orthonormal: an array, or Splines."""
        return self.drift if self.believed is None else over(self.drift, self.believed)

    @cached_property
    def counted(self) -> np.ndarray | None:
        """Places of the samples that count; None where all do."""
        return None if self.believed is None else np.flatnonzero(self.believed)

    @cached_property
    def far(self) -> float:
        """What a prediction that diverged is taken as: far off, but a number."""
        return 1e3 * float(np.ptp(self.data)) + 1e-12

    def on_samples(self, residual: np.ndarray) -> np.ndarray:
        """A residual (size,) laid out as the data are, (channels, samples), with 0 where a sample does not count."""
        rows = residual.reshape(len(self.channels), self.count)
        if self.believed is None:
            return rows
        whole = np.zeros(self.data.shape)
        whole[:, self.believed] = rows
        return whole

    @property
    def anchor(self) -> float:
        """Time (s) that passes are counted from: the first mark, or the record's start."""
        return self.start if self.first_mark is None else self.first_mark

    @property
    def first_pass(self) -> int:
        """Index of the pass a simulation starts with: well before the record, the same at any tooth angle, a whole turn.

        Teeth are counted from there; so the same tooth follows the mark in every record.
        """
        return (math.floor((self.start - self.anchor) / self.period) - 2) * self.flutes

    @property
    def first_simulated(self) -> int:
        """Index of the pass a simulation begins with: long before a record that starts in the cut, so that it is steady."""
        return self.first_pass - (WARM_UP * self.flutes if self.starts_in_cut else 0)

    def pass_start(self, index: float, angle: float, nuisances: Nuisances) -> float:
        """Time (s) of the start of a pass, or of a place within one; index 0 belongs to the anchor."""
        turns = (angle + nuisances.angle) / (2 * math.pi) + index / self.flutes
        return self.anchor + turns * self.period / nuisances.speed

    def begins_cutting(self, nuisances: Nuisances) -> bool:
        """Whether the tool was in the work before the first sample: how long, nobody knows."""
        return self.cut is not None and (self.starts_in_cut or self.pass_start(nuisances.entry, 0.0, nuisances) <= self.start)

    def last_pass(self, angle: float, nuisances: Nuisances) -> int:
        """Index of the last pass that begins within the record."""
        past = self.start + self.samples / self.rate - self.pass_start(0, angle, nuisances)
        return math.floor(past * nuisances.speed / self.period * self.flutes)

    def off_marks(self, nuisances: Nuisances) -> np.ndarray:
        """How far a clock is from what the marks say of it, (2,): tooth angle and speed in units of their errors; else (0,)."""
        if self.clock_error is None:
            return np.empty(0)
        angle = self._turned(nuisances)
        return np.array([angle / self.clock_error[0], (nuisances.speed - 1.0) / self.clock_error[1]])

    def by_marks(self, nuisances: Nuisances) -> Nuisances:
        """The nuisances with the tooth angle and the speed that the marks show; as they are where no marks tell them."""
        if self.clock_error is None:
            return nuisances
        return replace(nuisances, angle=nuisances.angle - self._turned(nuisances), speed=1.0)

    def _turned(self, nuisances: Nuisances) -> float:
        """Angle (rad) by which a record is turned from the nearest slot that its marks may be."""
        return math.remainder(nuisances.angle, 2 * math.pi / self.slots)

    def at_constant_speed(self) -> Observed:
        """The record without what unsteady marks say of its course; itself where the speed is constant."""
        if self.marks is None:
            return self
        return replace(self, marks=None, first_mark=None, clock_error=None, measured=self, slots=1)

    def loudest(self, count: int) -> Observed:
        """The `count` samples of an excited record in which it moves most, as a record; a record of another kind itself."""
        if self.force is None or self.kind != "excited" or self.samples <= count:
            return self
        places = np.arange(0, self.samples - count + 1, max(1, count // 4))
        first = int(places[int(np.argmax([self.data[0, place : place + count].std() for place in places]))])
        return self.part(first, count)

    def part(self, first: int, count: int, terms: int | None = None) -> Observed:
        """`count` samples from `first` on as a record; terms: of its drift."""
        return replace(
            self,
            data=self.data[:, first : first + count],
            force=None if self.force is None else self.force[first : first + count],
            start=self.start + first / self.rate,
            believed=None if self.believed is None else self.believed[first : first + count],
            filled=None if self.filled is None else self.filled[first : first + count],
            measured=None if self.measured is None else self.measured.part(first, count, terms),
            drift=drift_basis(count, of_a_part(self.drift.shape[1], count / self.samples) if terms is None else terms),
        )

    def opening(self) -> Observed:
        """The record up to the middle of what seems to be the cut, where the exit cannot matter; itself without a cut."""
        if self.cut is None:
            return self
        entry = min((s.start for s in self.segments if s.kind in ("entry", "steady")), default=self.start)
        seen = [s.stop for s in self.segments if s.kind in ("entry", "steady")]
        stop = 0.5 * (entry + max(seen, default=self.start + self.samples / self.rate))
        count = round((max(stop, entry + OPENING * self.period) - self.start) * self.rate)
        if count >= self.samples:
            return self
        kept = tuple(s for s in self.segments if s.start < stop and s.kind in ("idle", "entry", "steady"))
        return replace(self.part(0, count), segments=kept)

    def timeline(self, angle: float, nuisances: Nuisances, late: float = 0.0) -> tuple[Cut, Sampling]:
        """The cut and the sampling that simulate this record. late: passes by which all begin later, as its first tooth."""
        assert self.cut is not None
        pitch = self.period / nuisances.speed / self.flutes
        index = self.first_simulated
        first = self.pass_start(index + late, angle, nuisances)
        end = self.start + self.samples / self.rate
        total = math.ceil((end - self.pass_start(index, 0.0, Nuisances())) / pitch) + self.flutes
        idle = min(max(0, nuisances.entry - index), total)
        passes = max(0, min(total - idle, nuisances.exit - index - idle))
        cut = replace(
            self.cut,
            spindle_speed=2 * math.pi / (pitch * self.flutes),
            feed_per_tooth=self.cut.feed_per_tooth / (1.0 if self.feed_basis == "tooth" else nuisances.speed),
            length_cut_before=self.cut.length_cut_before + nuisances.length,
            idle_passes=idle,
            passes=passes,
            ring_down_passes=total - idle - passes,
            initial_displacement=nuisances.displacement,
            initial_velocity=nuisances.velocity,
            late_entry=nuisances.late_entry if idle > 0 else 0.0,
            early_exit=nuisances.early_exit,
            held_until=(idle * pitch if nuisances.swings else 0.0) if self.starts_in_cut else max(self.start - first, 0.0),
            swung_front=self.swung_front and not self.starts_in_cut,
            states=nuisances.states,
        )
        return cut, Sampling(self.rate, self.samples, self.start - first)

    def pass_durations(self, cut: Cut, sampling: Sampling) -> np.ndarray | None:
        """Measured durations of the simulated passes, or None at a constant speed."""
        if self.marks is None or self.first_mark is None:
            return None
        first = self.start - sampling.start
        nominal = first + np.arange(cut.total_passes + 1) * self.period / self.flutes
        return np.diff(along_marks(self.marks, (nominal - self.first_mark) / self.period, self.period))


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
    """Make a campaign's record (testbed.campaign.Record) ready. ValueError where it holds nothing that can be predicted."""
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
        believed=~filled if filled.any() else None,
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
                   believed=None if filled is None else ~filled)


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
    first, last = (round((time - base.start) * base.rate) for time in (start, stop))
    return heard_speed(base.data[0, first:last], base.rate, stated, flutes, idle=base.data[0, :first])
