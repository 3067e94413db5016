"""One channel of all runs in HDF5, packed here and handed over chunk by chunk as the bytes that go to the disk.

HDF5 would pack under its one lock, a thread at a time. Here shuffling, deflating and summing run beside each other; the
file is the same as HDF5's own filters would make: shuffle, deflate (gzip) and Fletcher's checksum, read by any reader.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any, Literal, get_args

import h5py
import numpy as np

from testbed.problem import InputProblem
from testbed.sensors.chain import ChannelSensor
from testbed.store.content_hash import row_digest

CHUNK_BYTES = 1_000_000
Compression = Literal["gzip", "none", "zstd"]
COMPRESSIONS: tuple[Compression, ...] = get_args(Compression)
_SAMPLE = 4096  # bytes of a plane that tell whether it can be packed
_WORTH = 0.9    # packed to less than this
_MOST_STORED = 65_535  # bytes in a stored block


def chunk_rows(samples: int, itemsize: int, most: int) -> int:
    """Runs in a chunk: a power of two, near CHUNK_BYTES, at most `most`. Batches are whole chunks where they can be."""
    rows = max(1, CHUNK_BYTES // (samples * itemsize))
    return min(1 << (rows.bit_length() - 1), max(1, most))


def kind_of(sensor: ChannelSensor) -> np.dtype:
    """How a sensor's samples are held: the counts of its converter, or float32 where there is none."""
    return np.dtype(np.float32 if sensor.step is None else np.int16 if sensor.bits <= 16 else np.int32)


def check_packing(compression: Compression) -> None:
    """InputProblem where the package that packs is not installed."""
    if compression == "zstd" and find_spec("hdf5plugin") is None:
        raise InputProblem("--compression zstd", "needs hdf5plugin, which is not installed",
                           'pip install "machining-testbed[fast]", or take gzip or none')


class ChannelWriter:
    """One channel, written a whole chunk of rows at a time; `digests` has the SHA-256 of every row written."""

    def __init__(self, file: h5py.File, name: str, unit: str, sensor: ChannelSensor, count: int, samples: int,
                 compression: Compression = "gzip", rows: int | None = None) -> None:
        kind = kind_of(sensor)
        self.step, self.compression = sensor.step, compression
        self.fill: Any = np.nan if self.step is None else np.iinfo(kind).min
        self.data = channel_data(file, name, count, samples, kind, compression,
                                 min(rows or chunk_rows(samples, kind.itemsize, count), max(1, count)))
        self.data.attrs["units"], self.data.attrs["long_name"] = unit, f"measured {name.replace('_', ' ')}"
        if sensor.on == "tool":
            self.data.attrs["on"] = sensor.on
        self.data.attrs["_FillValue"] = np.array(self.fill, kind)
        if self.step is not None:
            self.data.attrs["scale_factor"], self.data.attrs["add_offset"] = float(self.step), 0.0
        # One buffer for all chunks, with room for the checksum behind the rows: new memory a chunk costs more than packing it.
        size = self.data.chunks[0] * samples * kind.itemsize
        self.buffer = np.empty(size + 4, np.uint8)
        self.block = self.buffer[:size].view(kind).reshape(self.data.chunks[0], samples)
        self.planes = np.empty((kind.itemsize, self.block.size if compression == "gzip" else 0), np.uint8)
        self.held = self.done = 0
        self.digests: list[bytes] = []

    def add(self, values: np.ndarray, counts: np.ndarray) -> None:
        """Take the next runs' samples, shape (runs, samples); `counts` of them are a run's own."""
        begin = 0
        while begin < len(values):
            end = min(len(values), begin + len(self.block) - self.held)
            self._take(values[begin:end], counts[begin:end])
            if self.held == len(self.block):
                self.flush()
            begin = end

    def _take(self, values: np.ndarray, counts: np.ndarray) -> None:
        """Take runs that the chunk has room for."""
        rows, width = self.block[self.held:self.held + len(values)], min(values.shape[1], self.block.shape[1])
        if self.step is None:
            rows[:, :width] = values[:, :width]
        else:
            found = np.rint(values[:, :width] / self.step)
            rows[:, :width] = np.where(np.isfinite(found), found, self.fill)
        for row, count in zip(rows, counts.tolist(), strict=True):
            row[count:] = self.fill
            self.digests.append(row_digest(row, count))
        self.held += len(values)

    def flush(self) -> None:
        """Write the rows held back."""
        if not self.held:
            return
        self.block[self.held:] = self.fill
        if self.compression == "zstd":
            self.data[self.done:self.done + self.held] = self.block[: self.held]
        elif self.data.chunks[1] < self.block.shape[1]:
            self._write_pieces(self.data.chunks[1])
        else:
            self._hand_over(0, self._packed_block())
        self.done, self.held = self.done + self.held, 0

    def _hand_over(self, column: int, content: Any) -> None:
        self.data.id.write_direct_chunk((self.done, column), content)

    def _packed_block(self) -> Any:
        """The held rows as one chunk, in the writer's own memory where it can be."""
        content = self.buffer[:-4]
        if self.compression == "gzip":
            self.planes[...] = content.reshape(-1, self.block.itemsize).T
            return summed(deflated(self.planes))
        self.buffer[-4:] = np.frombuffer(fletcher32(content).to_bytes(4, "little"), np.uint8)
        return self.buffer

    def _write_pieces(self, wide: int) -> None:
        """Write rows too long for a chunk."""
        for first in range(0, self.block.shape[1], wide):
            chunk = np.full(self.data.chunks, self.fill, self.block.dtype)
            part = self.block[:, first:first + wide]
            chunk[:, : part.shape[1]] = part
            self._hand_over(first, packed(chunk, self.compression))


def channel_data(file: h5py.File, name: str, count: int, samples: int, kind: np.dtype, compression: Compression,
                 rows: int) -> h5py.Dataset:
    """The empty data set of a channel, shape (count, samples), with its filters and dimension scales."""
    wide = max(1, min(samples, CHUNK_BYTES // kind.itemsize))
    fill = np.nan if kind.kind == "f" else np.iinfo(kind).min
    data = file.create_dataset(name, (count, samples), kind, chunks=(rows, wide), fillvalue=fill, fletcher32=True,
                               **_filters(compression))
    data.dims[0].attach_scale(file["run"])
    data.dims[1].attach_scale(file["time"])
    return data


def _filters(compression: Compression) -> dict[str, Any]:
    if compression == "none":
        return {}
    if compression == "gzip":
        return {"compression": "gzip", "compression_opts": 1, "shuffle": True}
    import hdf5plugin

    return {**hdf5plugin.Zstd(clevel=1), "shuffle": True}


def packed(chunk: np.ndarray, compression: Compression) -> bytes:
    """A chunk as HDF5's filters would leave it (`none`: the checksum alone)."""
    raw = np.ascontiguousarray(chunk).view(np.uint8).reshape(-1)
    planes = raw.reshape(-1, chunk.dtype.itemsize).T
    return summed(deflated(np.ascontiguousarray(planes)) if compression == "gzip" else raw.tobytes())


def summed(data: bytes) -> bytes:
    """A chunk's bytes with Fletcher's checksum behind them."""
    return data + fletcher32(data).to_bytes(4, "little")


def deflated(planes: np.ndarray) -> bytes:
    """A zlib stream of byte planes, shape (itemsize, values); a plane that is mere noise is stored as it is.

    The low bytes of a sample's mantissa do not pack, and trying takes most of the time.
    """
    parts: list[bytes | memoryview] = [b"\x78\x01"]
    worth = [_packs(plane) for plane in planes]
    place = 0
    while place < len(planes):
        end = place + 1
        while worth[place] and end < len(planes) and worth[end]:  # neighbours in one stream
            end += 1
        together, last = planes[place:end].reshape(-1), end == len(planes)
        if worth[place]:
            stream = zlib.compressobj(1, zlib.DEFLATED, -15, 9)
            parts.append(stream.compress(together.data))
            parts.append(stream.flush(zlib.Z_FINISH if last else zlib.Z_FULL_FLUSH))
        else:
            parts += _stored(together, last)
        place = end
    return b"".join([*parts, zlib.adler32(planes.data).to_bytes(4, "big")])


def _packs(plane: np.ndarray) -> bool:
    """Whether deflating makes a plane of bytes notably smaller, by a piece from its middle."""
    middle = max(0, plane.size // 2 - _SAMPLE // 2)
    sample = plane[middle:middle + _SAMPLE]
    stream = zlib.compressobj(1, zlib.DEFLATED, -12, 6)  # a small one: its tables are cleared each time
    return len(stream.compress(sample.data)) + len(stream.flush()) < _WORTH * sample.size


def _stored(plane: np.ndarray, last: bool) -> Iterator[bytes | memoryview]:
    """Bytes as deflate's stored blocks (RFC 1951, 3.2.4), which begin and end at whole bytes."""
    for first in range(0, plane.size, _MOST_STORED):
        size = min(_MOST_STORED, plane.size - first)
        final = last and first + size == plane.size
        yield bytes([final]) + size.to_bytes(2, "little") + (size ^ 0xFFFF).to_bytes(2, "little")
        yield plane[first:first + size].data


_WORDS = 8192  # in a block of the checksum: all its sums are whole numbers below 2^53, so that a float holds them
_BLOCKS = 16   # summed at once
_WEIGHTS = np.stack([np.ones(_WORDS), np.arange(_WORDS, 0, -1, dtype=float)], axis=1)


def fletcher32(data: bytes | np.ndarray) -> int:
    """HDF5's Fletcher checksum: sums of the big-endian 16-bit words, and of those sums, modulo 65535.

    Words are taken as this machine's kind holds them, low byte first: exchanged bytes are a factor of 256 modulo 65535.
    """
    size = len(data)
    words = np.frombuffer(data, "<u2", size // 2)
    first = second = 0
    whole = len(words) // _WORDS * _WORDS
    blocks = words[:whole].reshape(-1, _WORDS)
    numbers = np.empty((min(_BLOCKS, len(blocks)), _WORDS))
    for begin in range(0, len(blocks), _BLOCKS):
        some = numbers[: len(blocks) - begin]
        some[...] = blocks[begin:begin + _BLOCKS]
        for plain, weighted in (some @ _WEIGHTS).tolist():
            second += _WORDS * first + int(weighted)
            first += int(plain)
    rest = words[whole:].astype(float)
    second += len(rest) * first + int(rest @ _WEIGHTS[_WORDS - len(rest):, 1])
    first += int(rest.sum())
    if size % 2:
        first += int(data[size - 1])
        second += first
    return (_folded(256 * second) << 16) | _folded(256 * first)


def _folded(total: int) -> int:
    """A sum modulo 65535 as repeated end-around carries leave it: 65535, not 0, unless the sum is 0."""
    return total if total == 0 else (total - 1) % 65535 + 1
