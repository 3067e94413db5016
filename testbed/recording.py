"""A recording: sampled channels with units, the time of the first sample, and where they came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

Origin = Literal["measured", "synthetic", "predicted"]
Outcome = Literal["ok", "diverged", "limit", "crashed"]
MOTIONS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
# motion without an axis is along x, the feed, of a sensor on the workpiece; `tool_`: of one on the tool
CHANNEL_UNITS = {**MOTIONS, "force": "N", "force_x": "N", "force_y": "N", "tachometer": "V", "spindle_angle": "rad"} | {
    f"{sensor}{quantity}_{axis}": unit for sensor in ("", "tool_") for axis in ("x", "y") for quantity, unit in MOTIONS.items()}


@dataclass(frozen=True)
class Recording:
    """Channels sampled together.

    channels: name -> float array (samples,), all of one length, in `units[name]` (SI unless uncalibrated).
    sampling_rate: Hz; start: time of the first sample, s. origin: measured, synthetic or predicted.
    marks: times (s) of the tachometer's once-per-revolution marks, empty where there is none; pulses_per_revolution: of
    so many pulses they may each be any, not the same one in every record.
    pass_times: times (s) of each tooth pass's start (simulated records only).
    filled: indices of samples that were not measured and were put in between their neighbours.
    outcome: how a simulated run ended; outcome_time is when (s), NaN if it ran to the end.
    conditions: operating conditions and whatever else is known of the record.
    """

    channels: Mapping[str, np.ndarray]
    sampling_rate: float
    units: Mapping[str, str]
    origin: Origin
    start: float = 0.0
    marks: np.ndarray = field(default_factory=lambda: np.empty(0))
    pass_times: np.ndarray = field(default_factory=lambda: np.empty(0))
    outcome: Outcome = "ok"
    outcome_time: float = float("nan")
    conditions: Mapping[str, Any] = field(default_factory=dict)
    pulses_per_revolution: int = 1
    filled: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))

    def __post_init__(self) -> None:
        if not self.channels:
            raise ValueError("a recording needs at least one channel")
        lengths = {name: np.shape(data) for name, data in self.channels.items()}
        if len(set(lengths.values())) != 1 or len(next(iter(lengths.values()))) != 1:
            raise ValueError(f"channels must be one-dimensional and of one length, not {lengths}")
        if not self.sampling_rate > 0:
            raise ValueError("sampling_rate must be above 0")
        missing = set(self.channels) - set(self.units)
        if missing:
            raise ValueError(f"no unit for channel {', '.join(sorted(missing))}")

    def __len__(self) -> int:
        return len(next(iter(self.channels.values())))

    @property
    def time(self) -> np.ndarray:
        """Sample times, s, shape (samples,)."""
        return self.start + np.arange(len(self)) / self.sampling_rate
