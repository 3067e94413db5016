"""A recording: sampled channels with units, the time of the first sample, and where they came from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from testbed.machine import Carrier
from testbed.problem import optional

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

Origin = Literal["measured", "synthetic", "predicted"]
Outcome = Literal["ok", "diverged", "limit", "crashed"]
MOTION_UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
DERIVATIVES = {name: order for order, name in enumerate(MOTION_UNITS)}  # how often the displacement is derived
MOTIONS = tuple(f"{name}{axis}" for name in MOTION_UNITS for axis in ("", "_x", "_y"))  # one without an axis is along x
CHANNEL_UNITS = {**{name: MOTION_UNITS[name.split("_")[0]] for name in MOTIONS}, "force": "N", "force_x": "N",
                 "force_y": "N", "tachometer": "V", "spindle_angle": "rad"}

# what engines give: of a sensor on the tool by another name
ENGINE_UNITS = CHANNEL_UNITS | {f"tool_{quantity}_{axis}": unit for axis in "xy" for quantity, unit in MOTION_UNITS.items()}


def motion_channel(name: str, on: Carrier = "workpiece") -> str:
    """The engines' name of what a sensor gives: `displacement` is `displacement_x`; on the tool, `tool_displacement_x`."""
    if name not in MOTIONS:
        return name
    quantity, _, axis = name.partition("_")
    if on == "tool":
        return f"tool_{quantity}_{axis or 'x'}"
    return quantity if axis in ("", "x") else name


class Sensor(NamedTuple):
    """Where a sensor of motion sits, along which axis (0 for x, 1 for y), and how often the displacement is derived in it."""

    on: Carrier
    axis: int
    order: int


def sensor_of(channel: str) -> Sensor | None:
    """The sensor of a channel by its name, an engine's or a record's; None where it is no motion."""
    on: Carrier = "tool" if channel.startswith("tool_") else "workpiece"
    name = channel.removeprefix("tool_")
    quantity, _, axis = name.partition("_")
    return Sensor(on, int(axis == "y"), DERIVATIVES[quantity]) if name in MOTIONS else None


def quantity_of(channel: str) -> str:
    """What a channel measures, whatever its axis and place: `acceleration` of `tool_acceleration_y`, `force` of `force_x`."""
    return channel.removeprefix("tool_").split("_")[0]


def channel_in_words(channel: str) -> str:
    """A channel by the name that a campaign has for it, and whether its sensor sits on the tool."""
    sensor = sensor_of(channel)
    if sensor is None:
        return channel
    return f"{quantity_of(channel)}_{'xy'[sensor.axis]}{' of the tool' if sensor.on == 'tool' else ''}"


@dataclass(frozen=True, repr=False)
class Recording:
    """Channels sampled together.

    channels: name -> float array (samples,), all of one length, in `units[name]` (SI unless uncalibrated).
    sampling_rate: Hz; start: time of the first sample, s. origin: measured, synthetic or predicted.
    marks: times (s) of the tachometer's once-per-revolution marks, empty where there is none; pulses_per_revolution: of
    so many pulses they may each be any, not the same one in every record.
    pass_times: times (s) of each tooth pass's start (simulated records only).
    filled: indices of samples that were not measured and were put in between their neighbours.
    outcome: how a simulated run ended; outcome_time is when (s), NaN if it ran to the end.
    conditions: operating conditions and whatever else is known of the record. on_tool: channels whose sensor sits on the
    tool; the others' sit on the workpiece.
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
    on_tool: tuple[str, ...] = ()

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

    def along_feed(self) -> Recording:
        """What of it a workpiece that moves along x alone can show: `displacement_x` of the workpiece is `displacement`;
        motion along y and of the tool is left out, unless there is nothing else."""
        moved = {name: motion_channel(name) for name in self.channels if name not in self.on_tool}
        kept = {new: name for name, new in moved.items() if not (new in MOTIONS and new.endswith("_y"))}
        if not kept or list(kept) == list(self.channels):
            return self
        return replace(self, channels={new: self.channels[name] for new, name in kept.items()},
                       units={new: self.units[name] for new, name in kept.items()}, on_tool=())

    def in_the_plane(self) -> Recording:
        """The same with every channel of motion by the engines' name, which says where its sensor sits; of two that sit alike
        (`displacement_x` and `displacement_x_2`) the first."""
        names: dict[str, str] = {}
        for name in self.channels:
            head, _, number = name.rpartition("_")
            plain = head if head in MOTIONS and number.isdigit() else name
            names.setdefault(motion_channel(plain, "tool" if name in self.on_tool else "workpiece"), name)
        return replace(self, channels={new: self.channels[name] for new, name in names.items()},
                       units={new: self.units[name] for new, name in names.items()}, on_tool=())

    @property
    def time(self) -> np.ndarray:
        """Sample times, s, shape (samples,)."""
        return self.start + np.arange(len(self)) / self.sampling_rate

    def __repr__(self) -> str:
        names = ", ".join(f"{name} [{self.units[name]}]" for name in self.channels)
        ended = "" if self.outcome == "ok" else f", {self.outcome}"
        return f"<Recording: {names}, {len(self)} samples at {self.sampling_rate:g} Hz, {self.origin}{ended}>"

    def to_pandas(self) -> pandas.DataFrame:
        """Channels as columns over time (s), their units in `attrs["units"]`. InputProblem without pandas."""
        packages = optional("pandas")
        frame = packages.DataFrame(dict(self.channels), packages.Index(self.time, name="time"))
        frame.attrs["units"] = {"time": "s"} | dict(self.units)
        return frame  # type: ignore[no-any-return]

    def to_xarray(self) -> xarray.Dataset:
        """Channels over time (s), each with its unit; conditions in `attrs`. InputProblem without xarray."""
        parts = {name: ("time", values, {"units": self.units[name]}) for name, values in self.channels.items()}
        about = {"sampling_rate": self.sampling_rate, "origin": self.origin, "outcome": self.outcome} | dict(self.conditions)
        return optional("xarray").Dataset(parts, {"time": ("time", self.time, {"units": "s"})}, about)  # type: ignore[no-any-return]

    def plot(self) -> Figure:
        """Every channel over time."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9, 1.2 + 1.8 * len(self.channels)), layout="constrained")
        for axes, (name, values) in zip(figure.subplots(len(self.channels), 1, squeeze=False, sharex=True)[:, 0],
                                        self.channels.items(), strict=True):
            axes.plot(self.time, values, linewidth=0.6)
            axes.set_ylabel(f"{name} [{self.units[name] or '?'}]")
        axes.set_xlabel("time [s]")
        return figure


@dataclass(frozen=True)
class Records:
    """Predicted recordings side by side, of simulations from time 0 that share their sampling rate and number of passes.

    channels: by name, in SI units, shape (runs, samples); what is behind a run's own samples means nothing. marks, pass_times,
    outcome, outcome_time: of each run, see `Recording`.
    """

    channels: Mapping[str, np.ndarray]
    marks: np.ndarray
    pass_times: np.ndarray
    outcome: Sequence[Outcome]
    outcome_time: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence[Records], order: np.ndarray) -> Records:
        """The runs of all parts in this order; channels are as wide as the widest."""
        widest = max(next(iter(part.channels.values())).shape[1] for part in parts)
        channels = {name: np.concatenate([np.pad(part.channels[name], ((0, 0), (0, widest - part.channels[name].shape[1])))
                                          for part in parts])[order] for name in parts[0].channels}
        outcome = [one for part in parts for one in part.outcome]
        marks, passes, ended = (np.concatenate([getattr(part, name) for part in parts])[order]
                                for name in ("marks", "pass_times", "outcome_time"))
        return cls(channels, marks, passes, [outcome[place] for place in order], ended)
