"""A data set: all runs of a scenario in one HDF5 file, with conditions, units, truth and outcome for each.

Transients stand in one 2-D data set (run, time) a channel, as the counts of the simulated converter with CF
`scale_factor`, or as float32 where there is none. Dimension scales and attributes follow CF, so that
`xarray.open_dataset(path, engine="h5netcdf")` opens it. `scenario_text`, `model_text` and `model_xml` tell how it came
about.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import h5py
import numpy as np

from testbed.atomic import replacing
from testbed.content_hash import ATTRIBUTE, content_hash
from testbed.machine import BASE_PARAMETERS, BASE_UNITS, Model
from testbed.recording import CHANNEL_UNITS, Outcome, Recording
from testbed.scenario import Run
from testbed.sensors.chain import ChannelSensor

FORMAT = 1
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
CHUNK_BYTES = 1_000_000
TRUTH = "truth."
# Per run: unit and meaning of what was set.
CONDITIONS = {
    "spindle_speed": ("rad/s", "nominal spindle speed"),
    "axial_depth_of_cut": ("m", "axial depth of cut"),
    "feed_per_tooth": ("m", "feed per tooth"),
    "idle_passes": ("1", "tooth passes before the entry"),
    "passes": ("1", "tooth passes in the cut"),
    "ring_down_passes": ("1", "tooth passes after the exit"),
    "initial_displacement": ("m", "displacement at time 0"),
    "initial_velocity": ("m/s", "velocity at time 0"),
}
_WHOLE = ("idle_passes", "passes", "ring_down_passes")


@dataclass(frozen=True)
class Header:
    """What all runs of a data set share. units: of every truth path; versions: of the programs that made it."""

    name: str
    seed: int
    engine: str
    sampling_rate: float
    flutes: int
    scenario_text: str
    model_text: str
    model_xml: str
    fingerprint: str
    truth_units: Mapping[str, str]
    versions: Mapping[str, str]


def truth_of(run: Run) -> dict[str, float]:
    """The true value of every parameter by its path, and the tachometer's mark angle (rad)."""
    model = run.model
    names = [name for name in BASE_PARAMETERS if model.cutting is not None or name in ("mass", "natural_frequency",
                                                                                      "damping_ratio")]
    values = {name: model.value(name) for name in names}
    values |= {f"{effect}.{name}": value for effect, given in model.effects.items() for name, value in given.items()}
    return values | {"mark_angle": run.sensors.mark_angle}


def write_data_set(path: str | Path, header: Header, rows: Iterable[tuple[Run, Recording]], count: int,
                   samples: int) -> str:
    """Write `count` runs of at most `samples` samples, whole or not at all; returns the content hash.

    rows: runs in order with what their sensors recorded, taken one at a time. InputProblem if `path` is not writable.
    """
    with replacing(path) as temporary:
        with h5py.File(temporary, "w", libver="v110") as file:
            _write(file, header, iter(rows), count, samples)
            digest = content_hash(file)
            file.attrs[ATTRIBUTE] = digest
        return digest


def _write(file: h5py.File, header: Header, rows: Iterator[tuple[Run, Recording]], count: int, samples: int) -> None:
    _write_header(file, header)
    _dimension(file, "run", np.arange(count), "1", "number of the run in the file")
    _dimension(file, "time", np.arange(samples) / header.sampling_rate, "s", "time since the run's first sample")
    channels: dict[str, _ChannelWriter] = {}
    table: dict[str, list[float]] = {}
    marks: list[np.ndarray] = []
    passes: list[np.ndarray] = []
    for place in range(count):
        run, recording = next(rows)
        for name in recording.channels:
            if place == 0:
                sensor = run.sensors.channels[name]
                channels[name] = _ChannelWriter(file, name, recording.units[name], sensor, count, samples)
            channels[name].add(recording.channels[name])
        for name, value in _row(run, recording).items():
            table.setdefault(name, []).append(value)
        marks.append(np.asarray(recording.marks, float))
        passes.append(np.asarray(recording.pass_times, float))
    for channel in channels.values():
        channel.flush()
    _write_table(file, header, table)
    _write_ragged(file, "marks", "mark", marks, "times of the tachometer's once-per-revolution marks")
    _write_ragged(file, "pass_times", "pass", passes, "start of every tooth pass, and the end of the last")


def _row(run: Run, recording: Recording) -> dict[str, float]:
    """All single numbers of a run, in the order they are written."""
    row: dict[str, float] = {"scenario_run": run.index}
    row |= {name: getattr(run.cut, name) for name in CONDITIONS}
    row |= {"start": recording.start, "sample_count": len(recording), "outcome": OUTCOMES.index(recording.outcome),
            "outcome_time": recording.outcome_time}
    row |= {f"noise_{name}": sensor.noise for name, sensor in run.sensors.channels.items()}
    return row | {TRUTH + name: value for name, value in truth_of(run).items()}


def _write_header(file: h5py.File, header: Header) -> None:
    file.attrs["Conventions"] = "CF-1.11"
    file.attrs["title"] = header.name
    file.attrs["format"] = FORMAT
    file.attrs["origin"] = "synthetic"
    file.attrs["seed"] = header.seed
    file.attrs["engine"] = header.engine
    file.attrs["sampling_rate"] = header.sampling_rate
    file.attrs["flutes"] = header.flutes
    file.attrs["scenario_fingerprint"] = header.fingerprint
    file.attrs["versions"] = json.dumps(dict(header.versions), sort_keys=True)
    for name in ("scenario_text", "model_text", "model_xml"):
        file.create_dataset(name, data=getattr(header, name), dtype=h5py.string_dtype())
        file[name].attrs["long_name"] = {"scenario_text": "the scenario's file", "model_text": "the true model",
                                         "model_xml": "the MuJoCo model"}[name]


def _dimension(file: h5py.File, name: str, values: np.ndarray, unit: str, meaning: str) -> None:
    data = file.create_dataset(name, data=values)
    data.make_scale(name)
    data.attrs["units"], data.attrs["long_name"] = unit, meaning


def _write_table(file: h5py.File, header: Header, table: Mapping[str, list[float]]) -> None:
    for name, values in table.items():
        whole = name in (*_WHOLE, "sample_count", "scenario_run")
        kind = np.int8 if name == "outcome" else np.int64 if whole else np.float64
        data = file.create_dataset(name, data=np.asarray(values, kind))
        data.dims[0].attach_scale(file["run"])
        data.attrs["units"], data.attrs["long_name"] = _described(name, header)
        if name == "outcome":
            data.attrs["flag_values"] = np.arange(len(OUTCOMES), dtype=np.int8)
            data.attrs["flag_meanings"] = " ".join(OUTCOMES)
            del data.attrs["units"]


def _described(name: str, header: Header) -> tuple[str, str]:
    """Unit and meaning of a per-run number."""
    if name in CONDITIONS:
        return CONDITIONS[name]
    if name.startswith("noise_"):
        channel = name.removeprefix("noise_")
        return CHANNEL_UNITS[channel], f"rms of the sensor's white noise on {channel}"
    if name.startswith(TRUTH):
        path = name.removeprefix(TRUTH)
        unit = "rad" if path == "mark_angle" else BASE_UNITS.get(path) or header.truth_units[path]
        return unit, f"true {path.replace('_', ' ')}"
    return {"start": ("s", "time of the first sample; the simulation starts at 0"),
            "sample_count": ("1", "samples of this run; the rest of its row is filling"),
            "scenario_run": ("1", "number of the run in the scenario"), "outcome": ("1", "how the run ended"),
            "outcome_time": ("s", "when the run ended early; NaN if it did not")}[name]


def _write_ragged(file: h5py.File, name: str, dimension: str, rows: list[np.ndarray], meaning: str) -> None:
    """Rows of different lengths, filled up with NaN."""
    width = max(1, max(len(row) for row in rows))
    values = np.full((len(rows), width), np.nan)
    for target, row in zip(values, rows, strict=True):
        target[: len(row)] = row
    _dimension(file, dimension, np.arange(width), "1", f"number of the {dimension}")
    data = file.create_dataset(name, data=values, compression="gzip", shuffle=True, fletcher32=True)
    data.dims[0].attach_scale(file["run"])
    data.dims[1].attach_scale(file[dimension])
    data.attrs["units"], data.attrs["long_name"] = "s", meaning


class _ChannelWriter:
    """One channel of all runs, written a whole chunk of rows at a time."""

    def __init__(self, file: h5py.File, name: str, unit: str, sensor: ChannelSensor, count: int,
                 samples: int) -> None:
        self.step = step = sensor.step
        kind: Any = np.dtype(np.float32 if step is None else np.int16 if sensor.bits <= 16 else np.int32)
        self.fill = np.nan if step is None else np.iinfo(kind).min
        rows = max(1, min(count, CHUNK_BYTES // (samples * kind.itemsize)))
        chunk = (rows, max(1, min(samples, CHUNK_BYTES // kind.itemsize)))
        self.data = file.create_dataset(name, (count, samples), kind, chunks=chunk, compression="gzip",
                                        compression_opts=1, shuffle=True, fletcher32=True, fillvalue=self.fill)
        self.data.dims[0].attach_scale(file["run"])
        self.data.dims[1].attach_scale(file["time"])
        self.data.attrs["units"], self.data.attrs["long_name"] = unit, f"measured {name.replace('_', ' ')}"
        self.data.attrs["_FillValue"] = np.array(self.fill, kind)
        if step is not None:
            self.data.attrs["scale_factor"], self.data.attrs["add_offset"] = float(step), 0.0
        self.block = np.full((rows, samples), self.fill, kind)
        self.held = self.done = 0

    def add(self, values: np.ndarray) -> None:
        """Take the next run's samples."""
        row = self.block[self.held]
        row[:] = self.fill
        if self.step is None:
            row[: len(values)] = values
        else:
            counts = np.rint(values / self.step)
            row[: len(values)] = np.where(np.isfinite(counts), counts, self.fill).astype(row.dtype)
        self.held += 1
        if self.held == len(self.block):
            self.flush()

    def flush(self) -> None:
        """Write the rows held back."""
        self.data[self.done:self.done + self.held] = self.block[: self.held]
        self.done, self.held = self.done + self.held, 0


def truth_units(model: Model, catalogue: Mapping[str, Any]) -> dict[str, str]:
    """Unit of every effect parameter of a model, by its path."""
    return {f"{effect}.{name}": catalogue[effect].parameter(name).unit
            for effect, given in model.effects.items() for name in given}
