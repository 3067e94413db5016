"""Reading a data set: its small tables at once, its transients a block of runs at a time."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from testbed.content_hash import ATTRIBUTE, content_hash
from testbed.hdf5_guard import damaged, opened
from testbed.machine import Model
from testbed.problem import InputProblem
from testbed.recording import CHANNEL_UNITS, Recording
from testbed.store import CONDITIONS, FORMAT, OUTCOMES, TRUTH

# Each is read when the data set is opened; a file without one of them is none of ours.
_NEEDED = (*CONDITIONS, "scenario_run", "start", "sample_count", "outcome", "outcome_time", "marks", "pass_times",
           "model_text", "scenario_text", "model_xml")


@dataclass(frozen=True)
class DataSet:
    """A data set on disk. Iterating gives its Recordings in order.

    conditions and truth: name -> array (runs,), SI. outcome: array (runs,) of names. noise: channel -> rms (runs,).
    channels: names of the recorded channels. scenario_run: each run's number in the scenario.
    """

    path: Path
    name: str
    seed: int
    engine: str
    sampling_rate: float
    flutes: int
    channels: tuple[str, ...]
    conditions: Mapping[str, np.ndarray]
    truth: Mapping[str, np.ndarray]
    noise: Mapping[str, np.ndarray]
    outcome: np.ndarray
    scenario_run: np.ndarray
    scenario_text: str
    model_text: str
    model_xml: str
    fingerprint: str
    content_hash: str
    versions: Mapping[str, str]

    def __len__(self) -> int:
        return len(self.outcome)

    def __iter__(self) -> Iterator[Recording]:
        return self.recordings()

    def recordings(self, first: int = 0, last: int | None = None) -> Iterator[Recording]:
        """Recordings `first` up to, not including, `last`. InputProblem where the file turns out to be damaged."""
        last = len(self) if last is None else min(last, len(self))
        with opened(self.path) as file:
            rows = (file[self.channels[0]].chunks or (64,))[0]
            for start in range(first, last, rows):
                yield from self._block(file, start, min(start + rows, last))

    def recording(self, index: int) -> Recording:
        """One recording. IndexError if there is none of that number."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        return next(self.recordings(index, index + 1))

    def _block(self, file: h5py.File, first: int, last: int) -> list[Recording]:
        part = slice(first, last)
        channels = {name: _decoded(file[name], part) for name in self.channels}
        small = {name: file[name][part] for name in ("start", "sample_count", "outcome_time", "marks", "pass_times")}
        return [Recording(
            channels={name: values[row, : small["sample_count"][row]] for name, values in channels.items()},
            sampling_rate=self.sampling_rate, units={name: str(file[name].attrs["units"]) for name in channels},
            origin="synthetic", start=float(small["start"][row]), marks=_given(small["marks"][row]),
            pass_times=_given(small["pass_times"][row]), outcome=self.outcome[first + row],
            outcome_time=float(small["outcome_time"][row]), conditions=self._conditions(first + row))
            for row in range(last - first)]

    def _conditions(self, index: int) -> dict[str, Any]:
        given = {name: values[index].item() for name, values in self.conditions.items()}
        return given | {"kind": "cut", "flutes": self.flutes, "run": int(self.scenario_run[index])}

    def true_model(self, catalogue: Mapping[str, Any] | None = None) -> Model:
        """The model the runs were simulated with."""
        from testbed.model_file import model_from_text

        return model_from_text(self.model_text, f"{self.path} (its model)", catalogue)

    def verify(self) -> bool:
        """True where the content still has the hash that was written with it. Reads the whole file."""
        with opened(self.path) as file:
            return content_hash(file) == self.content_hash


def _decoded(data: h5py.Dataset, part: slice) -> np.ndarray:
    """Values of a channel, NaN where nothing was recorded."""
    raw = data[part]
    if "scale_factor" not in data.attrs:
        return raw.astype(float)
    values = raw * float(data.attrs["scale_factor"]) + float(data.attrs.get("add_offset", 0.0))
    values[raw == data.attrs["_FillValue"]] = np.nan
    return values


def _given(row: np.ndarray) -> np.ndarray:
    return row[~np.isnan(row)]


def read_data_set(path: str | Path) -> DataSet:
    """Open a data set that `testbed run` wrote. InputProblem if it is missing, damaged, unsafe or of another kind."""
    with opened(path) as file:
        missing = [name for name in _NEEDED if name not in file]
        if missing or "format" not in file.attrs:
            raise InputProblem(path, "is an HDF5 file, but no data set of `testbed run`",
                               "for measured files write a campaign.yaml that names them")
        if int(file.attrs["format"]) > FORMAT:
            raise InputProblem(path, f"is of a newer testbed (format {file.attrs['format']})", "update testbed")
        try:
            return _read(Path(path), file)
        except (KeyError, ValueError, IndexError, TypeError) as problem:
            raise damaged(path, problem) from None


def is_data_set(path: str | Path) -> bool:
    """True for a file that `testbed run` wrote, as far as its signature and marker tell."""
    try:
        if not h5py.is_hdf5(path):
            return False
        with h5py.File(path, "r") as file:
            return "format" in file.attrs and "scenario_fingerprint" in file.attrs
    except OSError:
        return False


def _read(path: Path, file: h5py.File) -> DataSet:
    attributes = file.attrs
    outcome = np.array(OUTCOMES)[file["outcome"][()]]
    channels = tuple(name for name in CHANNEL_UNITS if name in file and file[name].ndim == 2)
    if not channels:
        raise ValueError("it holds no channel")
    runs = len(outcome)
    short = [name for name in (*CONDITIONS, *channels, "marks", "pass_times") if file[name].shape[0] != runs]
    if short:
        raise ValueError(f"{short[0]} does not have {runs} rows")
    return DataSet(
        path=path, name=str(attributes["title"]), seed=int(attributes["seed"]), engine=str(attributes["engine"]),
        sampling_rate=float(attributes["sampling_rate"]), flutes=int(attributes["flutes"]), channels=channels,
        conditions={name: file[name][()] for name in CONDITIONS},
        truth={name.removeprefix(TRUTH): file[name][()] for name in file if name.startswith(TRUTH)},
        noise={name.removeprefix("noise_"): file[name][()] for name in file if name.startswith("noise_")},
        outcome=outcome, scenario_run=file["scenario_run"][()],
        scenario_text=file["scenario_text"].asstr()[()], model_text=file["model_text"].asstr()[()],
        model_xml=file["model_xml"].asstr()[()], fingerprint=str(attributes["scenario_fingerprint"]),
        content_hash=str(attributes.get(ATTRIBUTE, "")), versions=json.loads(attributes["versions"]))
