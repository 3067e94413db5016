"""Ring-downs as they come: a record of its own for each blow, what of it is used, and the modes that ring in it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from testbed.analysis.estimate import Estimate
from testbed.analysis.information import Z_95
from testbed.analysis.records.blows import decays, find_blows, grows, swing_length
from testbed.analysis.records.decay_modes import DecayModes, decay_modes
from testbed.analysis.records.segments import Segment, find_segments, main_channel
from testbed.analysis.records.white_noise import white_noise
from testbed.recording import DERIVATIVES, MOTIONS, Recording

SWING = 8  # samples at the least in which a free decay's first large swing is looked for
LEAST, FEWEST = 64, 20  # samples that a fit of the machine needs, and one of a single vibration
FADED, NOISE_SWING = 0.02, 7.0  # of a decay's first swing, and rms of the noise, that are left when it has died away
USED = 0.99  # of a record, of which nothing is said
OUT_OF_STEP = 0.2  # of a channel's motion in a mode, against the main one's, beyond which it is told
NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


@dataclass(frozen=True)
class RungMode:
    """One mode of a free decay: frequency (undamped, Hz), damping ratio, amplitude at the start in the main channel's unit.

    shape: of each channel its displacement over that of the one which moves most, signed. direction: rad from x towards y,
    where both are measured by sensors on one carrier.
    """

    natural_frequency: Estimate
    damping_ratio: Estimate
    amplitude: float
    shape: Mapping[str, Estimate]
    direction: Estimate | None = None

    def as_json(self) -> dict[str, Any]:
        """SI values, for `--json`."""
        return {"natural_frequency": self.natural_frequency.as_json(), "damping_ratio": self.damping_ratio.as_json(),
                "amplitude": self.amplitude, "shape": {name: one.as_json() for name, one in self.shape.items()},
                "direction": None if self.direction is None else self.direction.as_json()}


@dataclass(frozen=True)
class RingDown:
    """What rings after one blow, from when to when (s), the strongest mode first. notes: what is no mode, and why.

    residual: rms of what the modes leave over the decay's own, pooled over the channels.
    """

    start: float
    stop: float
    modes: tuple[RungMode, ...]
    residual: float
    notes: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """SI values, for `--json`."""
        return {"start": self.start, "stop": self.stop, "modes": [mode.as_json() for mode in self.modes],
                "residual": self.residual, "notes": list(self.notes)}


def _motion(recording: Recording) -> np.ndarray:
    return np.asarray(recording.channels[main_channel(recording)], dtype=float)


def blow_times(recording: Recording) -> tuple[float, ...]:
    """Times (s) at which the structure of a ring-down was struck, where that was more than once; else ()."""
    found = find_blows(_motion(recording))
    return tuple(recording.start + place / recording.sampling_rate for place in found) if len(found) > 1 else ()


def said_blows(times: Sequence[float]) -> str:
    """How many blows there are, and when."""
    count = NUMBERS[len(times)] if len(times) < len(NUMBERS) else str(len(times))
    return f"{count} blows (at {', '.join(f'{time:.5g}' for time in times)} s)"


def notes_of(recording: Recording, kind: str) -> list[str]:
    """What of a ring-down is no single free decay: several blows, or swings that grow."""
    if kind != "ring-down":
        return []
    times, growth = blow_times(recording), grows(_motion(recording))
    notes = [f"{said_blows(times)}: each is read as its own ring-down. For one alone, give from and to"] if times else []
    if growth is not None:
        notes.append(f"its vibration grows to {growth:.3g} times its first amplitude: this is no free decay")
    return notes


def separated(records: Iterable[Any]) -> tuple[Any, ...]:
    """The records of a campaign (testbed.files.campaign.Record), a ring-down of several blows as so many records."""
    found: list[Any] = []
    for record in records:
        times = blow_times(record.recording) if record.kind == "ring-down" else ()
        if not times:
            found.append(record)
            continue
        note = f"{said_blows(times)} in its file: each is read as its own ring-down. For one alone, give from and to"
        parts = [_part(record.recording, *place) for place in decays(_motion(record.recording))]
        found += [
            replace(record, recording=part, name=f"{record.name} blow {number}", notes=record.notes if number > 1 else
                    (note, *record.notes))
            for number, part in enumerate(parts, 1) if len(part) >= LEAST
        ]  # fmt: skip
    return tuple(found)


def _part(recording: Recording, first: int, last: int) -> Recording:
    """Samples `first` up to, not including, `last` of a recording."""
    filled = np.asarray(recording.filled)
    return replace(
        recording,
        channels={name: values[first:last] for name, values in recording.channels.items()},
        start=recording.start + first / recording.sampling_rate,
        filled=filled[(filled >= first) & (filled < last)] - first,
    )


def used_samples(recording: Recording, kind: str, segments: Sequence[Segment], name: str, frequency: float) -> tuple[int, int]:
    """The samples of a record that a fit uses: all, but a free decay only from its first large swing on.

    Before that, something pushed the structure or held it: a single sample of that weighs more than all the noise. A velocity
    or an acceleration swings most while it is still pushed: of those, half a period more is left out. frequency: Hz, believed.
    """
    count = len(recording)
    for segment in segments:
        if kind == "ring-down" and segment.kind == "ring-down":
            first = max(0, min(count - LEAST, round((segment.start - recording.start) * recording.sampling_rate)))
            values = np.asarray(recording.channels[name], dtype=float)
            if grows(values) is not None:  # its largest swing is its last
                return first, count
            opening = np.abs(values[first : first + max(SWING, (count - first) // 50)] - float(np.median(values)))
            first += int(np.argmax(opening))
            if _order(name) > 0:
                first += math.ceil(0.5 * recording.sampling_rate / frequency)
            return max(0, min(count - LEAST, first)), count
    return 0, count


def used_times(
    recording: Recording, kind: str, segments: Sequence[Segment], name: str, rings: Sequence[RingDown]
) -> tuple[float, float] | None:
    """From when to when (s) a fit uses a record; None for a kind that no model predicts."""
    if kind not in ("cut", "ring-down", "excited"):
        return None
    fastest = recording.sampling_rate / 4.0
    frequency = next((ring.modes[0].natural_frequency.value for ring in rings if ring.modes), fastest)
    first, last = used_samples(recording, kind, segments, name, frequency)
    return recording.start + first / recording.sampling_rate, recording.start + last / recording.sampling_rate


def used_note(recording: Recording, kind: str) -> list[str]:
    """How much of a ring-down a fit uses, where that is not all but all of it."""
    if kind != "ring-down":
        return []
    segments = find_segments(recording, kind=kind)
    first, last = used_times(recording, kind, segments, main_channel(recording), ring_downs(recording, segments)) or (0, 0)
    share = (last - first) * recording.sampling_rate / len(recording)
    return [f"used from {first:.5g} to {last:.5g} s, {100 * share:.3g} % of the record"] if share < USED else []


def ring_downs(recording: Recording, segments: Sequence[Segment]) -> tuple[RingDown, ...]:
    """The modes that ring after each blow of a record, in the order of time."""
    values, rate = _motion(recording), recording.sampling_rate
    names = _moving(recording)
    found: list[RingDown] = []
    for segment in segments:
        if segment.kind == "ring-down":
            first, last = (round((time - recording.start) * rate) for time in (segment.start, segment.stop))
            first += int(np.argmax(np.abs(values[first:last] - np.median(values)))) if grows(values) is None else 0
            if last - first >= FEWEST:
                last = min(last, first + _lasting(values[first:last]))
                data = np.array([np.asarray(recording.channels[name], dtype=float)[first:last] for name in names])
                modes = decay_modes(data)
                if modes is not None:
                    left = float(np.sqrt(np.mean((modes.rest / np.maximum(np.std(data, axis=1), 1e-300)) ** 2)))
                    told, notes = _told(modes, names, recording)
                    found.append(RingDown(recording.start + first / rate, segment.stop, told, left, notes))
    return tuple(found)


def _moving(recording: Recording) -> list[str]:
    """The channels whose free decay is looked at: the main one first, and what else tells motion."""
    main = main_channel(recording)
    return [main, *(name for name in recording.channels if name in MOTIONS and name != main)]


def _order(name: str) -> int:
    """How often a channel is the derivative of a displacement."""
    return DERIVATIVES.get(name.split("_")[0], 0)


def _told(modes: DecayModes, names: Sequence[str], recording: Recording) -> tuple[tuple[RungMode, ...], tuple[str, ...]]:
    """The modes of a decay in s and Hz, and what is to be said of them."""
    rate = recording.sampling_rate
    notes = [f"{abs(pole) * rate / (2.0 * math.pi):.5g} Hz {why}: no mode of its own" for pole, why in modes.left_out]
    if modes.bends is not None:
        notes.append(f"one mode does not explain all that rings near {abs(modes.bends) * rate / (2.0 * math.pi):.5g} Hz: its "
                     "frequency or damping may change with the amplitude")
    told = []
    for place in range(len(modes)):
        shape, against = _shape(modes, place, names, rate)
        told.append(_mode(modes, place, rate, shape, _direction(shape, recording)))
        notes += [f"{told[-1].natural_frequency.value:.5g} Hz: {', '.join(against)} out of step: no real mode's shape"
                  ] if against else []
    return tuple(told), tuple(notes)


def _mode(modes: DecayModes, place: int, rate: float, shape: Mapping[str, Estimate], direction: Estimate | None) -> RungMode:
    """A mode in s and Hz, its intervals by the slopes of modulus and damping ratio over decay and turning."""
    pole, covariance = modes.poles[place], modes.covariance[place]
    decay, turning, natural = -pole.real, pole.imag, abs(pole)
    slopes = np.array([[decay / natural, turning / natural], [turning**2 / natural**3, -decay * turning / natural**3]])
    wide = Z_95 * np.sqrt(np.maximum(np.diag(slopes @ covariance @ slopes.T), 0.0))
    hertz, spread = natural * rate / (2.0 * math.pi), wide[0] * rate / (2.0 * math.pi)
    damping = decay / natural
    return RungMode(Estimate(hertz, hertz - spread, hertz + spread, "Hz"),
                    Estimate(damping, damping - wide[1], damping + wide[1], "1"),
                    float(abs(modes.residues[place, 0])), shape, direction)


def _shape(modes: DecayModes, place: int, names: Sequence[str], rate: float) -> tuple[dict[str, Estimate], list[str]]:
    """Displacement of each channel over that of the one that moves most, and the channels that are out of step with it."""
    factor = (modes.poles[place] * rate) ** -np.array([_order(name) for name in names], dtype=float)
    moved, error = modes.residues[place] * factor, modes.residue_error[place] * np.abs(factor)
    main = int(np.argmax(np.abs(moved)))
    ratio = moved / moved[main]
    wide = Z_95 * np.sqrt(error**2 + np.abs(ratio) ** 2 * error[main] ** 2) / abs(moved[main])
    wide[main] = 0.0
    shape = {name: Estimate(float(one.real), float(one.real - own), float(one.real + own), "1", size=1.0)
             for name, one, own in zip(names, ratio, wide, strict=True)}
    against = [name for name, one, own in zip(names, ratio, wide, strict=True)
               if abs(one.imag) > max(2.0 * own, OUT_OF_STEP * abs(one))]
    return shape, against


def _direction(shape: Mapping[str, Estimate], recording: Recording) -> Estimate | None:
    """The direction (rad, from x towards y) of a mode that sensors along x and y on one carrier see; of several the first."""
    for name, along_y in shape.items():
        x_names = [name[:-2], f"{name[:-2]}_x"] if name.endswith("_y") else []
        alike = [one for one in x_names if one in shape and (one in recording.on_tool) == (name in recording.on_tool)]
        along_x = shape[alike[0]] if alike else None
        if along_x is None or along_x.value == along_y.value == 0.0:
            continue
        size = along_x.value**2 + along_y.value**2
        angle = math.atan2(along_y.value, along_x.value)
        angle += math.pi if angle <= -math.pi / 2.0 else -math.pi if angle > math.pi / 2.0 else 0.0
        wide = math.hypot((along_x.high - along_x.value) * along_y.value, (along_y.high - along_y.value) * along_x.value) / size
        return Estimate(angle, angle - wide, angle + wide, "rad", size=1.0)
    return None


def _lasting(values: np.ndarray) -> int:
    """Samples until a decay has all but died away: later ones only teach the offset."""
    swing = swing_length(values)
    sizes = np.array([np.ptp(values[first : first + swing]) for first in range(0, len(values) - swing, swing)])
    loud = np.flatnonzero(sizes > max(FADED * sizes.max(initial=0.0), NOISE_SWING * white_noise(values)))
    return max(FEWEST, (int(loud[-1]) + 3) * swing) if len(loud) else len(values)
