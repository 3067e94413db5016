"""A data set: all runs of a scenario in one HDF5 file, with conditions, units, truth and outcome for each.

Transients stand in one 2-D data set (run, time) a channel, as the counts of the simulated converter with CF
`scale_factor`, or as float32 where there is none. Dimension scales and attributes follow CF, so that
`xarray.open_dataset(path, engine="h5netcdf")` opens it. `scenario_text`, `model_text` and `model_xml` tell how it came
about.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import h5py
import numpy as np

from testbed.machine import BASE_UNITS, Model
from testbed.recording import CHANNEL_UNITS, Outcome, Recording, Records
from testbed.scenario.scenario import Run, Runs, side_by_side
from testbed.sensors.chain import ChannelSensor
from testbed.store import provenance
from testbed.store.chunk_writer import ChannelWriter, Compression
from testbed.store.content_hash import ATTRIBUTE, DIGEST, PROVENANCE_ATTRIBUTE, content_hash, provenance_hash
from testbed.store.seal import seal, write_sealed
from testbed.system.atomic import replacing
from testbed.system.memory_file import MemoryFile
from testbed.system.steady_file import SteadyFile

MEMORY_BYTES = 256 * 2**20  # as 8-byte numbers, unpacked
_ROOM = 2**20  # bytes of a file besides its samples, about
FORMAT = 3  # 1: a content hash over values rather than rows, no seal; 2: over the versions too, those of one maker
SEALED_FROM = 2
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
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


@dataclass(frozen=True)
class Block:
    """Runs side by side as they are written.

    numbers: every single number of a run by its name, (runs,). channels: what was recorded, (runs, samples), `counts` of them
    the run's own. sensors: of the channels. marks, pass_times: (runs, most of any run), filled up with NaN.
    """

    numbers: Mapping[str, np.ndarray]
    channels: Mapping[str, np.ndarray]
    counts: np.ndarray
    sensors: Mapping[str, ChannelSensor]
    marks: np.ndarray
    pass_times: np.ndarray


def block(runs: Runs, channels: Mapping[str, np.ndarray], marks: np.ndarray, records: Records) -> Block:
    """What was recorded of runs, with all that is known of them."""
    count, cut = len(runs), runs.cuts.column
    numbers = {"scenario_run": np.arange(runs.first, runs.first + count)} | {name: getattr(cut, name) for name in CONDITIONS}
    numbers |= {"start": np.zeros(count), "sample_count": runs.counts,
                "outcome": np.array([OUTCOMES.index(one) for one in records.outcome]), "outcome_time": records.outcome_time}
    known = {id(chain): chain for chain in runs.sensors}
    place = {key: number for number, key in enumerate(known)}
    which = np.array([place[id(chain)] for chain in runs.sensors])
    for name in runs.sensors[0].channels:
        numbers[f"noise_{name}"] = np.array([chain.channels[name].noise for chain in known.values()])[which]
    numbers |= {TRUTH + name: values for name, values in _truth(runs.models).items()}
    numbers[TRUTH + "mark_angle"] = np.array([chain.mark_angle for chain in known.values()])[which]
    return Block(numbers, channels, runs.counts, runs.sensors[0].channels, marks, records.pass_times)


def block_of(run: Run, recording: Recording) -> Block:
    """One run and what its sensors recorded."""
    channels = {name: np.asarray(values, float)[None] for name, values in recording.channels.items()}
    marks, passes = np.asarray(recording.marks, float)[None], np.asarray(recording.pass_times, float)[None]
    runs = replace(side_by_side([run]), counts=np.array([len(recording)]))
    records = Records(channels, marks, passes, [recording.outcome], np.array([recording.outcome_time]))
    found = block(runs, channels, marks, records)
    return replace(found, numbers={**found.numbers, "start": np.array([recording.start])})


def _truth(models: Sequence[Model]) -> dict[str, np.ndarray]:
    """The true value of every parameter by its path, (runs,)."""
    known = {id(model): model for model in models}
    first = next(iter(known.values()))
    paths = [*first.base_parameters, *(f"{effect}.{name}" for effect, given in first.effects.items() for name in given)]
    place = {key: number for number, key in enumerate(known)}
    table = np.array([[model.value(path) for path in paths] for model in known.values()])
    return dict(zip(paths, table[[place[id(model)] for model in models]].T, strict=True))


def write_data_set(path: str | Path, header: Header, blocks: Iterable[Block], count: int,
                   samples: int, *, compression: Compression = "gzip", chunk_rows: int | None = None,
                   durable: bool = True) -> str:
    """Write `count` runs of at most `samples` samples, whole or not at all; returns the content hash.

    blocks: runs in order with what their sensors recorded, taken one block at a time. chunk_rows: runs in a chunk; chosen where
    None. durable: wait until the disk has it. InputProblem if `path` is not writable.
    """
    with replacing(path, durable) as temporary:
        if 8 * count * samples > MEMORY_BYTES:
            with SteadyFile(temporary) as disk, h5py.File(disk, "w", libver="v110") as file:
                digest = _write(file, header, iter(blocks), count, samples, compression, chunk_rows)
            seal(temporary)
            return digest
        # In memory where it fits: HDF5 does not stand a full disk, and its bytes are at hand for the seal.
        with MemoryFile(_ROOM + 4 * count * samples, keep=not durable) as memory:
            with h5py.File(memory, "w", libver="v110") as file:
                digest = _write(file, header, iter(blocks), count, samples, compression, chunk_rows)
            write_sealed(temporary, memory.content(), keep=durable)
        return digest


def _write(file: h5py.File, header: Header, blocks: Iterator[Block], count: int, samples: int,
           compression: Compression, chunk_rows: int | None) -> str:
    """All of an open file; returns its content hash, which is in it too."""
    write_header(file, header, count, samples)
    channels: dict[str, ChannelWriter] = {}
    taken: list[Block] = []
    written = 0
    while written < count:
        one = next(blocks)
        for name, values in one.channels.items():
            if not written:
                channels[name] = ChannelWriter(file, name, CHANNEL_UNITS[name], one.sensors[name], count, samples, compression,
                                               chunk_rows)
            channels[name].add(values, one.counts)
        written += len(one.counts)
        taken.append(replace(one, channels={}))  # what is written is not kept
    for channel in channels.values():
        channel.flush()
    _write_table(file, header, {name: np.concatenate([one.numbers[name] for one in taken]) for name in taken[0].numbers})
    for name, rows in (("marks", [one.marks for one in taken]), ("pass_times", [one.pass_times for one in taken])):
        width = max(1, *(row.shape[1] for row in rows))
        ragged(file, name, count, width)[...] = np.concatenate(
            [np.pad(row, ((0, 0), (0, width - row.shape[1])), constant_values=np.nan) for row in rows])
    digests = {name: b"".join(channel.digests) for name, channel in channels.items()}
    for name, rows_hashed in digests.items():
        write_digests(file, name, rows_hashed)
    return write_hashes(file, digests)


def write_hashes(file: h5py.File, digests: Mapping[str, bytes]) -> str:
    """Close a data set whose rows have these hashes with the hashes of all else; returns the content hash."""
    file.attrs[ATTRIBUTE] = digest = content_hash(file, digests)
    file.attrs[PROVENANCE_ATTRIBUTE] = provenance_hash(file)
    return digest


def write_header(file: h5py.File, header: Header, count: int, samples: int,
                 made: Sequence[provenance.Made] = ()) -> None:
    """What all runs share, and the dimensions `run` and `time`. made: who made which runs, where several did."""
    file.attrs["Conventions"] = "CF-1.11"
    file.attrs["title"] = header.name
    file.attrs["format"] = FORMAT
    file.attrs["origin"] = "synthetic"
    file.attrs["seed"] = header.seed
    file.attrs["engine"] = header.engine
    file.attrs["sampling_rate"] = header.sampling_rate
    file.attrs["flutes"] = header.flutes
    file.attrs["scenario_fingerprint"] = header.fingerprint
    provenance.write(file, made or [(0, count, {"engine": header.engine, **header.versions})])
    for name in ("scenario_text", "model_text", "model_xml"):
        file.create_dataset(name, data=getattr(header, name), dtype=h5py.string_dtype())
        file[name].attrs["long_name"] = {"scenario_text": "the scenario's file", "model_text": "the true model",
                                         "model_xml": "the MuJoCo model"}[name]
    _dimension(file, "run", np.arange(count), "1", "number of the run in the file")
    _dimension(file, "time", np.arange(samples) / header.sampling_rate, "s", "time since the run's first sample")


def _dimension(file: h5py.File, name: str, values: np.ndarray, unit: str, meaning: str) -> None:
    data = file.create_dataset(name, data=values)
    data.make_scale(name)
    data.attrs["units"], data.attrs["long_name"] = unit, meaning


def _write_table(file: h5py.File, header: Header, table: Mapping[str, np.ndarray]) -> None:
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


RAGGED = {"marks": ("mark", "times of the tachometer's once-per-revolution marks"),
          "pass_times": ("pass", "start of every tooth pass, and the end of the last")}


def ragged(file: h5py.File, name: str, count: int, width: int) -> h5py.Dataset:
    """An empty data set for rows of different lengths, shape (count, width), to be filled up with NaN."""
    dimension, meaning = RAGGED[name]
    _dimension(file, dimension, np.arange(width), "1", f"number of the {dimension}")
    data = file.create_dataset(name, (count, width), float, compression="gzip", compression_opts=1, shuffle=True,
                               fletcher32=True, fillvalue=np.nan, chunks=(max(1, min(count, 65_536 // width)), width))
    data.dims[0].attach_scale(file["run"])
    data.dims[1].attach_scale(file[dimension])
    data.attrs["units"], data.attrs["long_name"] = "s", meaning
    return data


def write_digests(file: h5py.File, channel: str, digests: bytes) -> None:
    """The SHA-256 of every run's stored samples of a channel: `testbed verify` names the run that was damaged."""
    values = np.frombuffer(digests, np.uint8).reshape(-1, 32)
    if "digest_byte" not in file:
        _dimension(file, "digest_byte", np.arange(32), "1", "number of the byte of a digest")
    data = file.create_dataset(DIGEST + channel, data=values)
    data.dims[0].attach_scale(file["run"])
    data.dims[1].attach_scale(file["digest_byte"])
    data.attrs["units"], data.attrs["long_name"] = "1", f"SHA-256 of each run's stored samples of {channel}"


def truth_units(model: Model, catalogue: Mapping[str, Any]) -> dict[str, str]:
    """Unit of every parameter of a model, by its path."""
    return {**model.base_parameters} | {f"{effect}.{name}": catalogue[effect].parameter(name).unit
            for effect, given in model.effects.items() for name in given}
