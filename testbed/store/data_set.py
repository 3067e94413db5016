"""Reading a data set: its small tables at once, its transients a block of runs at a time.

What is read is checked: all but the transients against the hashes of the whole when the file is opened, every run's samples
against their own hash when they are read. So an edited file is refused at the price of what is used of it, however large it is.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from testbed.files.door import plain_file
from testbed.files.hdf5_guard import damaged, opened
from testbed.machine import Model
from testbed.problem import InputProblem, InputWarning, optional
from testbed.readers.rehearsal import rehearse
from testbed.recording import CHANNEL_UNITS, Recording
from testbed.store import provenance
from testbed.store.content_hash import ATTRIBUTE, BOOKKEEPING, DIGEST, content_hash, contradiction
from testbed.store.data_set_form import check_form, newer
from testbed.store.rows import changed, check_rows, decoded, unpackable
from testbed.store.seal import cut_off, sealed_size, state
from testbed.store.store import CONDITIONS, OUTCOMES, SEALED_FROM, TRUTH
from testbed.sweeps.shards import INDEX, NOTE, Shard, find, gaps, overlaps

if TYPE_CHECKING:
    import pandas
    import xarray

# Each is read when the data set is opened; a file without one of them is none of ours.
_NEEDED = (*CONDITIONS, "scenario_run", "start", "sample_count", "outcome", "outcome_time", "marks", "pass_times",
           "model_text", "scenario_text", "model_xml")
_CHECKED_WHOLE = 256 * 2**20  # bytes; the seal of a smaller file is checked whenever it is opened


@dataclass(frozen=True, repr=False)
class DataSet:
    """A data set on disk. Iterating gives its Recordings in order.

    conditions and truth: name -> array (runs,), SI. outcome: array (runs,) of names. noise: channel -> rms (runs,).
    channels: the recorded channels with their attributes. scenario_run: each run's number in the scenario. made: who made
    which runs.
    """

    path: Path
    name: str
    seed: int
    engine: str
    sampling_rate: float
    flutes: int
    channels: Mapping[str, Mapping[str, Any]]
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
    made: tuple[provenance.Made, ...]
    format: int
    shards: tuple[Shard, ...] = ()

    @property
    def versions(self) -> dict[str, str]:
        """Versions of the programs that made it, those of all its runs."""
        return provenance.summary(self.made)

    def __repr__(self) -> str:
        return f"<DataSet: {self.path}, {len(self)} runs, {', '.join(self.channels)} at {self.sampling_rate:g} Hz>"

    def to_pandas(self) -> pandas.DataFrame:
        """A row for every run: its conditions, its true parameters and its outcome. InputProblem without pandas."""
        truth = {f"true {name}": values for name, values in self.truth.items()}
        return optional("pandas").DataFrame({**self.conditions, **truth, "outcome": self.outcome})  # type: ignore[no-any-return]

    def to_xarray(self) -> xarray.Dataset:
        """The whole file, its samples read when they are used. InputProblem without xarray and h5netcdf, and of shards."""
        if self.shards:
            raise InputProblem(self.path, "is a folder of shards", "take its recordings one by one")
        optional("h5netcdf")
        return optional("xarray").open_dataset(self.path, engine="h5netcdf")  # type: ignore[no-any-return]

    def __len__(self) -> int:
        return len(self.outcome)

    def __iter__(self) -> Iterator[Recording]:
        return self.recordings()

    def recordings(self, first: int = 0, last: int | None = None) -> Iterator[Recording]:
        """Recordings `first` up to, not including, `last`. InputProblem where the file turns out to be damaged."""
        last = len(self) if last is None else min(last, len(self))
        with opened(self.path / INDEX if self.shards else self.path) as tables:
            for begin, end, path in self.shards or ((0, len(self), self.path),):
                if begin >= last or end <= first:
                    continue
                with ExitStack() as stack:
                    if self.shards:
                        look_over(path)
                    file = stack.enter_context(opened(path)) if self.shards else tables
                    rows = (file[next(iter(self.channels))].chunks or (64,))[0]
                    stop = min(end, last)
                    for start in range(max(begin, first), stop, rows):
                        yield from self._block(file, tables, start, min(start + rows, stop), begin)

    def recording(self, index: int) -> Recording:
        """One recording. IndexError if there is none of that number."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        return next(self.recordings(index, index + 1))

    def _block(self, file: h5py.File, tables: h5py.File, first: int, last: int, begin: int) -> list[Recording]:
        """Recordings of a file whose first run is number `begin`. tables: the file with those of all runs."""
        raw = {name: file[name][first - begin:last - begin] for name in self.channels}
        for name, values in raw.items():
            check_rows(file.filename, values, tables.get(DIGEST + name), first, name)
        channels = {name: decoded(values, self.channels[name]) for name, values in raw.items()}
        small = {name: tables[name][first:last] for name in ("start", "sample_count", "outcome_time", "marks", "pass_times")}
        on_tool = tuple(name for name, given in self.channels.items() if given.get("on") == "tool")
        return [Recording(
            channels={name: values[row, : small["sample_count"][row]] for name, values in channels.items()},
            sampling_rate=self.sampling_rate, units={name: str(given["units"]) for name, given in self.channels.items()},
            origin="synthetic", start=float(small["start"][row]), marks=_given(small["marks"][row]),
            pass_times=_given(small["pass_times"][row]), outcome=self.outcome[first + row],
            outcome_time=float(small["outcome_time"][row]), conditions=self._conditions(first + row),
            on_tool=on_tool)
            for row in range(last - first)]

    def _conditions(self, index: int) -> dict[str, Any]:
        given = {name: values[index].item() for name, values in self.conditions.items()}
        return given | {"kind": "cut", "flutes": self.flutes, "run": int(self.scenario_run[index])}

    def true_model(self, catalogue: Mapping[str, Any] | None = None, run: int | None = None) -> Model:
        """The model the runs were simulated with; that of one run where each has drawn parameters of its own."""
        from testbed.files.model_file import model_from_text

        model = model_from_text(self.model_text, f"{self.path} (its model)", catalogue)
        if run is None:
            return model
        own = {name: float(values[run]) for name, values in self.truth.items() if name != "mark_angle"}
        return model.with_values(own)

    def verify(self) -> bool:
        """True where the content still has its hash, or of shards every file is as it was written. Reads the whole file."""
        if self.shards:
            return all(state(path) == "whole" for path in (self.path / INDEX, *(path for _, _, path in self.shards)))
        with opened(self.path) as file:
            return content_hash(file) == self.content_hash


def _given(row: np.ndarray) -> np.ndarray:
    return row[~np.isnan(row)]


def read_data_set(path: str | Path, checked: bool = False) -> DataSet:
    """Open a data set that `testbed run` wrote. InputProblem if it is missing, damaged, unsafe or of another kind.

    A damaged file can bring the HDF5 library down, and this process with it. So a file without a seal that holds is
    first read in a child process. checked: it was looked over already. The path may be a folder of shards.
    """
    place = Path(path)
    if place.name == INDEX and (place.parent / NOTE).is_file():
        place = place.parent
    if place.is_dir():
        return _read_folder(place)
    if not checked:
        look_over(place)
    with opened(place) as file:
        found = _checked(place, file, file)
    if not checked and found.format >= SEALED_FROM and sealed_size(place) is None:
        warnings.warn(f"{place}: another program has written to it, its seal is gone: its content is still that of its hash",
                      InputWarning, stacklevel=2)
    return found


def _checked(path: Path, file: h5py.File, channels: h5py.File) -> DataSet:
    """The data set of an open file, whose channels may stand in another. InputProblem where it is none, or was changed."""
    missing = [name for name in _NEEDED if name not in file]
    if missing or "format" not in file.attrs:
        raise InputProblem(path, "is an HDF5 file, but no data set of `testbed run`",
                           "for measured files write a campaign.yaml that names them")
    if newer(file.attrs):
        raise InputProblem(path, f"is of a newer testbed (format {file.attrs['format']})", "update testbed")
    check_form(path, file)
    try:
        lent = {} if channels is file else {name: channels[name] for name in CHANNEL_UNITS if DIGEST + name in file}
        if (edited := contradiction(file, lent)) is not None:
            raise changed(path, edited)
        return _read(path, file, channels)
    except (KeyError, ValueError, IndexError, TypeError, AttributeError) as problem:
        if isinstance(problem, InputProblem):
            raise
        raise damaged(path, problem) from None


def _read_folder(folder: Path) -> DataSet:
    """A data set that stayed a folder of shards. InputProblem where a shard is missing or stands there twice."""
    if not (folder / NOTE).is_file():
        raise InputProblem(folder, "is a folder", "name the HDF5 file in it")
    if not (folder / INDEX).is_file():
        raise InputProblem(folder, "is an unfinished sweep", "continue it with `testbed run ... --resume`")
    shards = tuple(find(folder))
    if not shards:
        raise InputProblem(folder, "holds no shard", "copy it again from where it came from, or simulate it again")
    for path in (folder / INDEX, shards[0][2]):
        look_over(path)
    with opened(folder / INDEX) as file, opened(shards[0][2]) as shard:
        whole = _checked(folder / INDEX, file, shard)
    wrong = gaps(list(shards), len(whole)) or overlaps(list(shards))
    if wrong:
        raise InputProblem(folder, f"runs {wrong[0][0]} to {wrong[0][1] - 1} are missing or double",
                           "`testbed verify` says more; simulate them again with `testbed run ... --resume`")
    return replace(whole, path=folder, shards=shards)


def look_over(path: Path, trusted: bool = True) -> None:
    """InputProblem where a file is not as it was written, or brings the HDF5 library down.

    trusted: a seal that holds is enough, one that does not is damage; else the file is read in a child whatever it has.
    """
    if not trusted:
        rehearse(path, lambda: _read_about(path, everything=True))
        return
    plain_file(path, "name the HDF5 file in it")
    try:
        large = path.stat().st_size > _CHECKED_WHOLE
        found = "absent" if large else state(path)
        cut = found == "absent" and not large and cut_off(path)
    except OSError as problem:
        raise InputProblem(path, f"cannot be read ({problem.strerror})", "check the file and its permissions") from None
    if found == "broken" or cut:
        raise InputProblem(path, "is damaged: it is not as it was written" + (", but cut short" if cut else ""),
                           "copy it again from where it came from; `testbed verify` says where")
    if found == "absent":
        rehearse(path, lambda: _read_about(path, everything=not large))


def _read_about(path: Path, everything: bool) -> None:
    """Read what a reader will: the tables, the index of every data set, and all values where `everything` is set."""
    with h5py.File(path, "r") as file:
        if "outcome" in file and path.name != INDEX:
            _read(path, file, file)
        for item in file.values():
            if isinstance(item, h5py.Dataset) and item.shape:
                places = range(item.id.get_num_chunks()) if item.chunks else ()
                for place in places:
                    item.id.get_chunk_info(place)
                rows = item.chunks[0] if item.chunks else max(1, item.shape[0])
                for first in range(0, item.shape[0] if everything else rows, rows):
                    item[first:first + rows]


def is_data_set(path: str | Path) -> bool:
    """True for a file that `testbed run` wrote, as far as its signature and marker tell."""
    try:
        if Path(path).is_dir():
            return (Path(path) / NOTE).is_file() and (Path(path) / INDEX).is_file()
        if not Path(path).is_file() or not h5py.is_hdf5(path):
            return False
        with h5py.File(path, "r") as file:
            return "format" in file.attrs and "scenario_fingerprint" in file.attrs
    except (OSError, RuntimeError, KeyError, ValueError):  # what HDF5 makes of a damaged file
        return False


def _read(path: Path, file: h5py.File, recorded: h5py.File) -> DataSet:
    """The data set of an open file; recorded: the file with the channels, itself or, of a folder, its first shard."""
    attributes = file.attrs
    outcome = np.array(OUTCOMES)[file["outcome"][()]]
    channels = {name: {key: recorded[name].attrs[key] for key in set(recorded[name].attrs) - BOOKKEEPING}
                for name in CHANNEL_UNITS if name in recorded}
    if not channels:
        raise ValueError("it holds no channel")
    unpackable(path, recorded[next(iter(channels))])
    runs = len(outcome)
    own = () if recorded is not file else channels
    short = [name for name in (*CONDITIONS, *own, "marks", "pass_times") if file[name].shape[0] != runs]
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
        content_hash=str(attributes.get(ATTRIBUTE, "")), made=tuple(provenance.read(file)),
        format=int(attributes["format"]))
