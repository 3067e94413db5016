"""Many shards become one data set: chunks are copied as they are, tables a shard at a time, so that memory stays flat."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path

import h5py
import numpy as np

from testbed.problem import InputProblem
from testbed.recording import CHANNEL_UNITS
from testbed.store import provenance
from testbed.store.chunk_writer import Compression, channel_data
from testbed.store.content_hash import DIGEST
from testbed.store.seal import seal
from testbed.store.store import RAGGED, Header, ragged, write_digests, write_hashes, write_header
from testbed.sweeps.shards import fault, remove
from testbed.system.atomic import replacing
from testbed.system.file_cache import leave
from testbed.system.steady_file import SteadyFile
from testbed.system.threads import in_order

_BOOKKEEPING = {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME", "_Netcdf4Dimid"}
_SHARED = {"run", "time", "mark", "pass", "digest_byte", "scenario_text", "model_text", "model_xml", provenance.NAME}


def consolidate(target: Path, header: Header, shards: Sequence[tuple[int, int, Path]], samples: int,
                compression: Compression, threads: int = 1, transients: bool = True) -> str:
    """Write one data set of all shards (first run, last run + 1, file), in order; returns its content hash.

    transients: without them the file is the index of a folder of shards: all tables, and the hash of the whole. Each
    shard's seal is checked before it is copied. InputProblem where one is damaged: it is removed, since what is missing
    is what a resumed sweep computes.
    """
    count = shards[-1][1]
    with replacing(target) as temporary:
        with SteadyFile(temporary) as disk, h5py.File(disk, "w", libver="v110") as file:
            writer = _Writer(file, shards, samples, compression, transients)
            write_header(file, header, count, samples, writer.made)
            for first, path in _whole(shards, threads, header.fingerprint):
                with h5py.File(path, "r") as shard:
                    writer.take(shard, first)
                disk.check()
                with path.open("rb", buffering=0) as taken:
                    if not transients:
                        os.fsync(taken.fileno())  # this shard stays
                    leave(taken.fileno())
            digests = {name: bytes(values) for name, values in writer.digests.items()}
            for name, values in digests.items():
                write_digests(file, name, values)
            digest = write_hashes(file, digests)
            for name in () if transients else digests:
                del file[name]  # nothing was written to it: it would be read as a record of nothing
        seal(temporary, threads)
    return digest


def _whole(shards: Iterable[tuple[int, int, Path]], threads: int, fingerprint: str) -> Iterator[tuple[int, Path]]:
    """Shards whose every byte is as it was written, for this scenario and these runs, checked a few ahead."""
    paths = [(first, path) for first, _, path in shards]
    faults = in_order(lambda one: fault(one[1], fingerprint), paths, max(1, threads), 2 * threads + 1)
    with closing(faults) as found:
        for (first, path), wrong in zip(paths, found, strict=True):
            if wrong is not None:
                remove(path, wrong)
                raise InputProblem(path, f"{wrong}; it is removed", "continue with --resume")
            yield first, path


class _Writer:
    """The data set under way. digests: a channel's row hashes, one after another. made: who made which runs."""

    def __init__(self, file: h5py.File, shards: Sequence[tuple[int, int, Path]], samples: int,
                 compression: Compression, transients: bool) -> None:
        self.file, self.samples, self.compression, self.transients = file, samples, compression, transients
        self.count = shards[-1][1]
        self.digests: dict[str, bytearray] = {}
        self.tables: dict[str, h5py.Dataset] = {}  # kept open: to open one takes longer than to write a shard's part of it
        self.widths = dict.fromkeys(RAGGED, 1)
        self.made: list[provenance.Made] = []
        self.rows: dict[str, int] = {}  # in a chunk: as in the largest shards, whose chunks are copied as they are
        for first, _, path in shards:
            with h5py.File(path, "r") as shard:
                self.made += provenance.read(shard, first)
                self.widths = {name: max(width, shard[name].shape[1]) for name, width in self.widths.items()}
                for name in shard:
                    if name in CHANNEL_UNITS:
                        self.rows[name] = max(self.rows.get(name, 1), shard[name].chunks[0])

    def take(self, shard: h5py.File, first: int) -> None:
        """Take all runs of a shard; the first of them becomes number `first`."""
        for name in shard:
            if name in self.rows:
                self._channel(shard[name], name, first)
                self.digests.setdefault(name, bytearray()).extend(shard[DIGEST + name][()].tobytes())
            elif name in RAGGED:
                self._ragged(shard[name], name, first)
            elif name not in _SHARED and not name.startswith(DIGEST):
                self._table(shard[name], name, first)

    def _table(self, source: h5py.Dataset, name: str, first: int) -> None:
        if name not in self.tables:
            data = self.tables[name] = self.file.create_dataset(name, (self.count,), source.dtype)
            data.dims[0].attach_scale(self.file["run"])
            _copy_attributes(source, data)
        self.tables[name][first:first + len(source)] = source[()]

    def _ragged(self, source: h5py.Dataset, name: str, first: int) -> None:
        data = self.file[name] if name in self.file else ragged(self.file, name, self.count, self.widths[name])
        values = np.full((len(source), data.shape[1]), np.nan)
        values[:, : source.shape[1]] = source[()]
        data[first:first + len(source)] = values

    def _channel(self, source: h5py.Dataset, name: str, first: int) -> None:
        if name not in self.file:
            data = channel_data(self.file, name, self.count, self.samples, source.dtype, self.compression,
                                min(self.rows[name], self.count))
            _copy_attributes(source, data)
        if not self.transients:
            return
        data = self.file[name]
        rows, wide = data.chunks
        if _storage(source) != _storage(data) or first % rows or (len(source) % rows and first + len(source) < self.count):
            for start in range(0, len(source), rows):
                data[first + start:first + min(start + rows, len(source))] = source[start:start + rows]
            return
        for start in range(0, len(source), rows):
            for column in range(0, self.samples, wide):
                skipped, raw = source.id.read_direct_chunk((start, column))
                data.id.write_direct_chunk((first + start, column), raw, filter_mask=skipped)


def _storage(data: h5py.Dataset) -> tuple[object, ...]:
    """Chunks and filters: where two data sets agree in them, a chunk's bytes mean the same in both."""
    filters = data.id.get_create_plist()
    return (data.dtype, data.chunks, *(filters.get_filter(place)[0] for place in range(filters.get_nfilters())))


def _copy_attributes(source: h5py.Dataset, data: h5py.Dataset) -> None:
    for key in source.attrs:
        if key not in _BOOKKEEPING:
            data.attrs[key] = source.attrs[key]
