"""The chain of a simulated measurement: offset, slow drift, white noise, then an analogue-to-digital converter.

    measured = LSB round((true + offset + drift t + noise) / LSB),   LSB = 2 range / 2^bits,   clipped at +-range

The tachometer's mark sits at a constant angle from the tooth's entry, unknown to whoever reads the record.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from testbed.machine import Carrier
from testbed.noise import NoiseRecipe
from testbed.recording import CHANNEL_UNITS, Recording, motion_channel


@dataclass(frozen=True)
class ChannelSensor:
    """One channel's sensor, in the channel's SI unit.

    noise: white noise, rms. bits, full_scale: a converter of 2 full_scale / 2^bits a count; none where bits is 0.
    offset: constant. drift: slope of the slow drift, unit/s. recipe: disturbances beyond white noise. on: what it sits on.
    """

    noise: float = 0.0
    bits: int = 0
    full_scale: float = 0.0
    offset: float = 0.0
    drift: float = 0.0
    recipe: NoiseRecipe | None = None
    on: Carrier = field(default="workpiece", repr=False)  # not in the text of old scenarios' fingerprints

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) for value in (self.noise, self.full_scale, self.offset, self.drift)):
            raise ValueError("a sensor's values must be finite")
        if self.noise < 0:
            raise ValueError("noise must be at least 0")
        if self.bits != 0 and not 2 <= self.bits <= 24:
            raise ValueError("bits must be 0 (no converter) or 2 to 24")
        if self.bits and not self.full_scale > 0:
            raise ValueError("a converter needs a range above 0")

    @property
    def step(self) -> float | None:
        """The value of one count, or None where there is no converter."""
        return 2.0 * self.full_scale / 2**self.bits if self.bits else None

    @property
    def chance(self) -> bool:
        """Whether random numbers are drawn."""
        return bool(self.noise) or self.recipe is not None

    def apply(self, signal: np.ndarray, time: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
        """The measured samples, shape (samples,), of a true signal; a NaN (after a run diverged) stays one.

        time: read where there is a drift or a recipe. rng: needed where there is `chance`.
        """
        measured = signal + self.offset
        if self.drift:
            measured = measured + self.drift * time
        if self.noise:
            assert rng is not None
            measured = measured + self.noise * rng.standard_normal(len(signal))
        if self.recipe is not None and len(signal) > 1:
            assert rng is not None
            measured = self.recipe.disturbed(measured, 1.0 / (time[1] - time[0]), rng)
        if self.step is None:
            return measured
        # The lowest count is left out, so that it can mean "no sample" in a file.
        highest = 2 ** (self.bits - 1) - 1
        return np.clip(np.rint(measured / self.step), -highest, highest) * self.step


@dataclass(frozen=True)
class SensorChain:
    """All sensors of a test: `channels` by name, and the tachometer.

    mark_angle (rad): how far the spindle turns from a tooth's entry to the mark. mark_jitter: rms error of its time, s.
    """

    channels: Mapping[str, ChannelSensor] = field(default_factory=lambda: {"displacement": ChannelSensor()})
    mark_angle: float = 0.0
    mark_jitter: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", MappingProxyType(dict(self.channels)))
        if not self.channels:
            raise ValueError("a sensor chain needs at least one channel")
        if not (math.isfinite(self.mark_angle) and self.mark_jitter >= 0):
            raise ValueError("mark_angle must be finite and mark_jitter at least 0")

    def __reduce__(self):  # mapping proxies do not pickle
        return (SensorChain, (dict(self.channels), self.mark_angle, self.mark_jitter))

    @property
    def sources(self) -> tuple[str, ...]:
        """The engines' names of what the channels' sensors sit on, in the order of `channels`."""
        return tuple(motion_channel(name, sensor.on) for name, sensor in self.channels.items())

    @property
    def on_tool(self) -> tuple[str, ...]:
        """Channels whose sensor sits on the tool."""
        return tuple(name for name, sensor in self.channels.items() if sensor.on == "tool")

    @property
    def chance(self) -> bool:
        """Whether random numbers are drawn."""
        return bool(self.mark_jitter) or any(sensor.chance for sensor in self.channels.values())

    @property
    def timed(self) -> bool:
        """Whether what is measured depends on the time since the record's first sample."""
        return any(sensor.drift or sensor.recipe is not None for sensor in self.channels.values())

    def apply(self, recording: Recording, rng: np.random.Generator | None) -> Recording:
        """What these sensors make of a predicted recording: the channels they see, origin "synthetic".

        Raises KeyError where the recording lacks a channel. The same generator state gives the same samples; rng may be
        None where there is no `chance`.
        """
        channels = {source: np.asarray(recording.channels[source], float) for source in self.sources}
        measured, marks = self.measured(channels, recording.start, recording.sampling_rate, recording.marks, rng)
        return replace(recording, channels=measured, units={name: CHANNEL_UNITS[name] for name in measured},
                       origin="synthetic", marks=marks, on_tool=self.on_tool)

    def measured(self, sources: Mapping[str, np.ndarray], start: float, rate: float, marks: np.ndarray,
                 rng: np.random.Generator | None) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """(what the channels measure, by name; the marks) of the signals in `sources`, each (samples,); see `apply`.

        Where neither time nor chance plays a part, of many runs too: (runs, samples).
        """
        count = len(next(iter(sources.values())))
        time = start + np.arange(count) / rate - start if self.timed else np.empty(0)
        measured = {name: sensor.apply(sources[source], time, rng)
                    for (name, sensor), source in zip(self.channels.items(), self.sources, strict=True)}
        marks = shifted_marks(marks, self.mark_angle)
        if self.mark_jitter:
            assert rng is not None
            marks = marks + self.mark_jitter * rng.standard_normal(len(marks))
        return measured, marks


def shifted_marks(marks: np.ndarray, angle: float) -> np.ndarray:
    """Times (s) at which the spindle stands `angle` (rad) beyond each once-per-revolution mark, (marks,) or (runs, marks).

    Each revolution's own duration is used, so that a changing speed is followed; the last takes the one before.
    """
    if marks.shape[-1] < 2:
        return np.asarray(marks, float)
    durations = np.empty(marks.shape)
    np.subtract(marks[..., 1:], marks[..., :-1], out=durations[..., :-1])
    durations[..., -1] = durations[..., -2]
    return marks + angle / (2.0 * math.pi) * durations
