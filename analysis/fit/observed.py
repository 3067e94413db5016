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

from testbed.analysis.fit.drift import drift_basis, of_a_part, over
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.records.free_decay import spectral_peak
from testbed.analysis.records.segments import Segment
from testbed.analysis.records.spindle_clock import along_marks
from testbed.cut import Cut, Sampling
from testbed.machine import Carrier
from testbed.recording import Sensor, sensor_of

OPENING = 12  # revolutions from the entry that an opening holds at the least
WARM_UP = 60  # revolutions simulated before a record that starts in the cut


@dataclass(frozen=True)
class Observed:
    """One record. data (channels, samples) in SI; noise (channels,) standard deviations; drift (samples, terms)
    orthonormal: an array, or Splines.

    period: of one revolution (s); first_mark: time of the first mark, s. clock_error: standard deviations of a record's own
    tooth angle (rad) and relative speed, from the scatter of its marks. segments and conditions as read. force (samples,)
    drives an excited record. length_summed: whether the length cut before is that of the records before, as nobody stated it.
    in_fit: whether it has a say in the fit. noise_doubt: standard error of the first channel's noise over itself. mask
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
    in_fit: bool = True
    noise_doubt: float = 0.0
    mask: np.ndarray | None = None
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
        return self.samples if self.mask is None else int(np.count_nonzero(self.mask))

    @property
    def size(self) -> int:
        """Number of values that count, over all channels: the length of a residual."""
        return len(self.channels) * self.count

    def project(self, values: np.ndarray) -> np.ndarray:
        """Values (..., channels, samples) in units of the scale, without what offset and drift could explain.

        Returned are the samples that count: shape (..., channels, count).
        """
        scaled, drift = values / self.scale[:, None], self.drift
        if self.mask is not None:
            scaled, drift = scaled[..., self.mask], self.counted_drift
        scaled -= (scaled @ drift) @ drift.T
        return scaled

    @cached_property
    def counted_drift(self) -> Any:
        """The drift's columns over the samples that count, (count, terms), orthonormal: an array, or Splines."""
        return self.drift if self.mask is None else over(self.drift, self.mask)

    @cached_property
    def counted(self) -> np.ndarray | None:
        """Places of the samples that count; None where all do."""
        return None if self.mask is None else np.flatnonzero(self.mask)

    @cached_property
    def far(self) -> float:
        """What a prediction that diverged is taken as: far off, but a number."""
        return 1e3 * float(np.ptp(self.data)) + 1e-12

    def on_samples(self, residual: np.ndarray) -> np.ndarray:
        """A residual (size,) laid out as the data are, (channels, samples), with 0 where a sample does not count."""
        rows = residual.reshape(len(self.channels), self.count)
        if self.mask is None:
            return rows
        whole = np.zeros(self.data.shape)
        whole[:, self.mask] = rows
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
            mask=None if self.mask is None else self.mask[first : first + count],
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
            idle_passes=idle, passes=passes, ring_down_passes=total - idle - passes,
            initial_displacement=nuisances.displacement, initial_velocity=nuisances.velocity,
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
