"""Ring-downs as they come: a record of its own for each blow, what of it is used, its frequencies and damping ratios."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.estimate import Estimate
from analysis.information import Z_95
from analysis.records.blows import decays, find_blows, grows, main_frequency, swing_length
from analysis.records.free_decay import FreeDecay, fit_free_decay, spectral_peak
from analysis.records.segments import Segment, find_segments, main_channel
from analysis.records.white_noise import rounding, white_noise
from testbed.recording import Recording

SWING = 8  # samples at the least in which a free decay's first large swing is looked for
LEAST, FEWEST = 64, 20  # samples that a fit of the machine needs, and one of a single vibration
MODES, ROUNDS = 2, 4  # free vibrations that are told apart, and how often each is fitted to what the other leaves
FADED, NOISE_SWING = 0.02, 7.0  # of a decay's first swing, and rms of the noise, that are left when it has died away
LEAVES = 2.0  # times the noise, beyond which one vibration leaves another
USED = 0.99  # of a record, of which nothing is said
DIFFERENTIATED = {"displacement": 0, "velocity": 1, "acceleration": 2}
NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


@dataclass(frozen=True)
class Decay:
    """One free vibration after a blow: from when to when (s), its frequency (undamped, Hz) and damping ratio."""

    start: float
    stop: float
    natural_frequency: Estimate
    damping_ratio: Estimate
    amplitude: float

    def as_json(self) -> dict[str, Any]:
        """SI values, for `--json`."""
        return {"start": self.start, "stop": self.stop, "natural_frequency": self.natural_frequency.as_json(),
                "damping_ratio": self.damping_ratio.as_json(), "amplitude": self.amplitude}


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
    notes = [f"{said_blows(times)}: each is taken as a ring-down of its own; give from and to for one alone"] if times else []
    if growth is not None:
        notes.append(f"its swings grow, to {growth:.3g} times what they were at first: this is no free decay")
    return notes


def separated(records: Iterable[Any]) -> tuple[Any, ...]:
    """The records of a campaign (testbed.campaign.Record), a ring-down of several blows as so many records."""
    found: list[Any] = []
    for record in records:
        times = blow_times(record.recording) if record.kind == "ring-down" else ()
        if not times:
            found.append(record)
            continue
        note = f"{said_blows(times)} in its file: each is taken as a ring-down of its own; give from and to for one alone"
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
            if DIFFERENTIATED.get(name, 0) > 0:
                first += math.ceil(0.5 * recording.sampling_rate / frequency)
            return max(0, min(count - LEAST, first)), count
    return 0, count


def used_times(
    recording: Recording, kind: str, segments: Sequence[Segment], name: str, vibrations: Sequence[Decay]
) -> tuple[float, float] | None:
    """From when to when (s) a fit uses a record; None for a kind that no model predicts."""
    if kind not in ("cut", "ring-down", "excited"):
        return None
    fastest = recording.sampling_rate / 4.0
    frequency = vibrations[0].natural_frequency.value if vibrations else fastest
    first, last = used_samples(recording, kind, segments, name, frequency)
    return recording.start + first / recording.sampling_rate, recording.start + last / recording.sampling_rate


def used_note(recording: Recording, kind: str) -> list[str]:
    """How much of a ring-down a fit uses, where that is not all but all of it."""
    if kind != "ring-down":
        return []
    segments = find_segments(recording, kind=kind)
    first, last = used_times(recording, kind, segments, main_channel(recording), free_vibrations(recording, segments)) or (0, 0)
    share = (last - first) * recording.sampling_rate / len(recording)
    return [f"used from {first:.5g} to {last:.5g} s, {100 * share:.3g} % of the record"] if share < USED else []


def free_vibrations(recording: Recording, segments: Sequence[Segment]) -> tuple[Decay, ...]:
    """The free vibrations of each ring-down of a record, in the order of time, of each blow the strongest first."""
    values, rate = _motion(recording), recording.sampling_rate
    found: list[Decay] = []
    for segment in segments:
        if segment.kind == "ring-down":
            first, last = (round((time - recording.start) * rate) for time in (segment.start, segment.stop))
            first += int(np.argmax(np.abs(values[first:last] - np.median(values)))) if grows(values) is None else 0
            found += [
                _decay(fit, rate, recording.start + first / rate, segment.stop) for fit in _vibrations(values[first:last])
            ]
    return tuple(found)


def _vibrations(values: np.ndarray) -> list[FreeDecay]:
    """Up to so many free vibrations of which a decay (samples,) is the sum, the strongest first."""
    if len(values) < FEWEST:
        return []
    found: list[FreeDecay] = []
    values = values[: _lasting(values)]
    rest, step, samples = values, rounding(values), np.arange(len(values))
    while len(found) < MODES:
        fit = _fitted(rest)
        if fit is None or fit.amplitude(0) < 2.0 * fit.rest:
            break
        found.append(fit)
        rest = rest - fit.at(samples)
        if fit.rest < LEAVES * max(white_noise(rest), step):
            break
    for _ in range(ROUNDS if len(found) > 1 else 0):  # beside each other they are fitted better
        for place, fit in enumerate(found):
            alone = rest + fit.at(samples)
            found[place] = fit_free_decay(alone, 0, fit.frequency, fit.decay) or fit
            rest = alone - found[place].at(samples)
    return sorted(found, key=lambda fit: -fit.amplitude(0))


def _lasting(values: np.ndarray) -> int:
    """Samples until a decay has all but died away: later ones only teach the offset."""
    swing = swing_length(values)
    sizes = np.array([np.ptp(values[first : first + swing]) for first in range(0, len(values) - swing, swing)])
    loud = np.flatnonzero(sizes > max(FADED * sizes.max(initial=0.0), NOISE_SWING * white_noise(values)))
    return max(FEWEST, (int(loud[-1]) + 3) * swing) if len(loud) else len(values)


def _fitted(values: np.ndarray) -> FreeDecay | None:
    """The free vibration that leaves least of a decay, from several first guesses of how fast it swings and dies."""
    guesses = {main_frequency(values), spectral_peak(values)} - {0.0}
    fits = [fit_free_decay(values, 0, frequency, dies / len(values)) for frequency in guesses for dies in (0.0, 3.0, 8.0)]
    return min((fit for fit in fits if fit is not None), key=lambda fit: fit.rest, default=None)


def _decay(fit: FreeDecay, rate: float, start: float, stop: float) -> Decay:
    """A fitted vibration in s and Hz; of a small damping the undamped frequency is as uncertain as the damped one."""
    turning = 2.0 * math.pi * fit.frequency
    natural = math.hypot(turning, fit.decay)
    frequency, damping = natural * rate / (2.0 * math.pi), fit.decay / natural
    wide = Z_95 * math.hypot(fit.frequency_error * turning / natural, fit.decay_error * damping / (2.0 * math.pi)) * rate
    spread = Z_95 * fit.decay_error * (turning / natural) ** 2 / natural
    return Decay(start, stop, Estimate(frequency, frequency - wide, frequency + wide, "Hz"),
                 Estimate(damping, damping - spread, damping + spread, "1"), fit.amplitude(0))
