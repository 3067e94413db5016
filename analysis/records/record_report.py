"""One record looked over: its channels, the speed found, its segments, noise and lines, and what is doubtful."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from testbed.analysis.records.chatter import Chatter, judge_cut
from testbed.analysis.records.chatter_line import LineTrack, chatter_track
from testbed.analysis.records.lines import SpectralLine, comb_speed, fed_by_the_cut, find_peaks, spectral_lines
from testbed.analysis.records.noise import Noise, noise_floor, samples_of
from testbed.analysis.records.passing_speed import REACH
from testbed.analysis.records.ring_downs import RingDown, blow_times, notes_of, ring_downs, used_times
from testbed.analysis.records.segments import Segment, find_segments, main_channel
from testbed.readers import checks
from testbed.readers.tachometer import speed as marks_speed
from testbed.recording import MOTIONS, Recording

MOST_TEETH = 8  # that a cutter whose flutes are not given may have
ALONE = 0.1  # share of the lines that need not be of the teeth: hum, or the cutter's runout where it is faint


@dataclass(frozen=True)
class ChannelReport:
    """Range of one channel in its unit, and how many samples are clipped."""

    unit: str
    low: float
    high: float
    rms: float
    clipped: int


@dataclass(frozen=True)
class RecordReport:
    """One record looked over. Times in s, speeds in rad/s; speed_basis says what `speed_found` was read from."""

    name: str
    kind: str
    recording: Recording
    channels: Mapping[str, ChannelReport]
    conditions: Mapping[str, Any]
    speed_found: float | None
    speed_basis: str
    segments: tuple[Segment, ...]
    noise: Noise | None
    lines: tuple[SpectralLine, ...]
    dropped: int
    repeated: int
    notes: tuple[str, ...]
    chatter: Chatter | None = None  # of a cut alone
    chatter_line: LineTrack | None = None
    blows: tuple[float, ...] = ()
    ring_downs: tuple[RingDown, ...] = ()
    used: tuple[float, float] | None = None

    @property
    def share(self) -> float:
        """Share of the record that a fit uses."""
        if self.used is None:
            return 0.0
        return (self.used[1] - self.used[0]) * self.recording.sampling_rate / len(self.recording)

    def as_json(self) -> dict[str, Any]:
        """SI values, for `--json`."""
        recording = self.recording
        return {
            "name": self.name,
            "kind": self.kind,
            "origin": recording.origin,
            "samples": len(recording),
            "sampling_rate": recording.sampling_rate,
            "start": recording.start,
            "duration": len(recording) / recording.sampling_rate,
            "outcome": recording.outcome,
            "conditions": {
                key: value for key, value in self.conditions.items() if isinstance(value, (int, float, str))
            },
            "channels": {
                name: {
                    "unit": channel.unit,
                    **({"on": "tool"} if name in recording.on_tool else {"on": "workpiece"} if name in MOTIONS else {}),
                    "min": channel.low,
                    "max": channel.high,
                    "rms": channel.rms,
                    "clipped": channel.clipped,
                }
                for name, channel in self.channels.items()
            },
            "speed": {
                "nominal": self.conditions.get("spindle_speed"),
                "found": self.speed_found,
                "basis": self.speed_basis,
                "marks": len(recording.marks),
            },
            "segments": [{"kind": part.kind, "start": part.start, "stop": part.stop} for part in self.segments],
            "noise_floor": None
            if self.noise is None or not self.noise.known
            else {"rms": self.noise.rms, "basis": self.noise.basis, "channel": self.noise.channel},
            "lines": [
                {"frequency": line.frequency, "amplitude": line.amplitude, "kind": line.kind, "order": line.order}
                for line in self.lines
            ],
            "blows": list(self.blows),
            "ring_downs": [one.as_json() for one in self.ring_downs],
            "used": None if self.used is None else {"start": self.used[0], "stop": self.used[1], "share": self.share},
            "chatter": None if self.chatter is None else self.chatter.as_json(),
            "chatter_line": None if self.chatter_line is None else self.chatter_line.as_json(),
            "dropped_samples": self.dropped,
            "repeated_samples": self.repeated,
            "notes": list(self.notes),
        }


def report(recording: Recording, name: str, kind: str, notes: tuple[str, ...]) -> RecordReport:
    """One record looked over; a run that diverged is described but not segmented."""
    recording, more = _finite(recording)
    channel = main_channel(recording)
    channels = {
        label: _channel(label, np.asarray(values), recording.units[label])
        for label, values in recording.channels.items()
    }
    conditions = recording.conditions
    if recording.outcome != "ok" or len(recording) < 64:
        unknown = Chatter("unknown", "the run broke off, or is too short") if kind == "cut" else None
        return RecordReport(
            name, kind, recording, channels, conditions, None, "none", (), None, (), 0, 0, (*notes, *more), unknown
        )
    segments = find_segments(recording, kind=kind) if kind != "file" else ()
    noise = noise_floor(recording, segments) if kind != "excited" else None
    found, basis = _speed(recording, segments, channel)
    if basis not in ("tachometer", "none"):
        more += checks.speed_notes(conditions.get("spindle_speed"), found, basis)
    lines = _lines(recording, segments, channel, found)
    chatter = judge_cut(recording, segments) if kind == "cut" else None
    track = None
    if chatter is not None and chatter.verdict == "chatter" and chatter.frequency is not None:
        lines = fed_by_the_cut(lines, chatter.frequency, found, int(conditions.get("flutes", 1)))
        track = _chatter_line(recording, segments, chatter.channel or channel, chatter.frequency)
    if kind == "cut" and not any(part.kind == "steady" for part in segments):
        more.append("the cut never settles: it grows (chatter), or it is too short")
    if noise is not None and noise.basis == "high-frequency residual":
        more.append(
            "no idling and no steady cut: the noise floor is read at high frequencies, which show white noise only"
        )
    if noise is not None and not noise.known:
        more.append(f"the noise is not known: fast motion may look like it. It is at most {noise.rms:.3g} "
                    f"{recording.units[noise.channel]} rms")
    rings = ring_downs(recording, segments) if kind == "ring-down" else ()
    more += [*notes_of(recording, kind), *dict.fromkeys(note for ring in rings for note in ring.notes)]
    return RecordReport(
        name,
        kind,
        recording,
        channels,
        conditions,
        found,
        basis,
        segments,
        noise,
        lines,
        int(conditions.get("dropped_samples", 0)),
        int(conditions.get("repeated_samples", 0)),
        (*notes, *more),
        chatter,
        track,
        blow_times(recording) if kind == "ring-down" else (),
        rings,
        used_times(recording, kind, segments, channel, rings),
    )


def _chatter_line(
    recording: Recording, segments: tuple[Segment, ...], channel: str, frequency: float
) -> LineTrack | None:
    """The chatter line, followed from the end of the cut, where it was found."""
    cutting = [part for part in segments if part.kind in ("entry", "steady")]
    start, stop = min(part.start for part in cutting), max(part.stop for part in cutting)
    values = np.asarray(recording.channels[channel])
    return chatter_track(values, recording.sampling_rate, frequency, 0.25 * start + 0.75 * stop, recording.start)


def _finite(recording: Recording) -> tuple[Recording, list[str]]:
    """A simulated record up to its first sample that was not recorded."""
    missing = [np.flatnonzero(~np.isfinite(values)) for values in recording.channels.values()]
    first = min((int(places[0]) for places in missing if len(places)), default=len(recording))
    if first == len(recording):
        return recording, []
    kept = {name: values[: max(first, 1)] for name, values in recording.channels.items()}
    return replace(recording, channels=kept), [f"the run ended ({recording.outcome}) after {first} samples"]


def _channel(name: str, values: np.ndarray, unit: str) -> ChannelReport:
    stuck = 0 if name.startswith("tachometer") else checks.clipped(values)
    return ChannelReport(unit, float(values.min()), float(values.max()), float(values.std()), stuck)


def _speed(recording: Recording, segments: tuple[Segment, ...], channel: str) -> tuple[float | None, str]:
    """Spindle speed (rad/s) and where it comes from: the tachometer, else the spacing of spectral lines."""
    found = marks_speed(recording.marks)
    if found is not None:
        return found, "tachometer"
    nominal = recording.conditions.get("spindle_speed")
    cutting = [part for part in segments if part.kind == "steady"] or [
        part for part in segments if part.kind == "entry"
    ]
    if not nominal or not cutting:
        return None, "none"
    values = np.asarray(recording.channels[channel])
    longest = max(cutting, key=lambda part: part.duration)
    flutes = int(recording.conditions.get("flutes", 1))
    comb = comb_speed(
        values[samples_of(recording, longest)],
        recording.sampling_rate,
        nominal,
        flutes,
        idle=_idle(recording, segments, values),
    )
    if comb is None:
        return None, "none"
    if "flutes" not in recording.conditions and abs(comb.spindle_speed / nominal - 1.0) > REACH \
            and _teeth_of(values[samples_of(recording, longest)], recording.sampling_rate, comb.spindle_speed) > 1:
        return None, "none"  # of so many teeth they show that speed, of others another
    # what one spectrum cannot resolve is no contradiction
    if abs(comb.spindle_speed - nominal) < 2 * math.pi * 0.5 / (longest.duration * flutes):
        return nominal if abs(comb.spindle_speed / nominal - 1) < 1e-4 else comb.spindle_speed, comb.basis
    return comb.spindle_speed, comb.basis


def _teeth_of(values: np.ndarray, rate: float, speed: float) -> int:
    """The most teeth whose passing has all lines that are multiples of a speed (rad/s), but for ALONE of them."""
    orders, sizes = np.array(find_peaks(values, rate, above=3.0)).T * [[2.0 * np.pi / speed], [1.0]]
    near = np.abs(orders - np.round(orders)) < 0.1
    whole, sizes = np.round(orders[near]), np.sqrt(sizes[near])
    return max(teeth for teeth in range(1, MOST_TEETH + 1) if sizes[whole % teeth > 0].sum() <= ALONE * sizes.sum())


def _idle(recording: Recording, segments: tuple[Segment, ...], values: np.ndarray) -> np.ndarray | None:
    idle = [part for part in segments if part.kind == "idle"]
    return values[samples_of(recording, max(idle, key=lambda part: part.duration))] if idle else None


def _lines(
    recording: Recording, segments: tuple[Segment, ...], channel: str, speed: float | None
) -> tuple[SpectralLine, ...]:
    """The strongest lines of steady cutting, else of the whole record; its ring-down gives the natural frequency."""
    values = np.asarray(recording.channels[channel])
    parts = {part.kind: part for part in sorted(segments, key=lambda part: part.duration)}
    chosen = parts.get("steady") or parts.get("ring-down")
    idle = _idle(recording, segments, values)
    natural: list[float] = []
    ring = parts.get("ring-down")
    if ring is not None and ring.duration * recording.sampling_rate > 256:
        strongest = spectral_lines(values[samples_of(recording, ring)], recording.sampling_rate, idle=idle, count=1)
        natural = [line.frequency for line in strongest]
    part = values[samples_of(recording, chosen)] if chosen else values
    if len(part) < 256:
        return ()
    return spectral_lines(
        part,
        recording.sampling_rate,
        spindle_speed=speed,
        flutes=int(recording.conditions.get("flutes", 1)),
        natural_frequencies=natural,
        idle=idle,
        count=12,
    )
