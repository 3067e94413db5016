"""A hash of what an HDF5 file says, not of its bytes, which differ from one writing to the next.

Covered: every group's and data set's name, type, shape, attributes and values. Not covered: storage (chunks, filters),
the bookkeeping of dimension scales, and the attribute `content_hash` itself. A data set `x`
beside which `digest_x` keeps the hashes of its rows counts by those, so that many workers can hash the rows they write.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from hashlib import sha256
from typing import Any

import h5py
import numpy as np

BOOKKEEPING = frozenset({"REFERENCE_LIST", "DIMENSION_LIST", "CLASS", "NAME", "_Netcdf4Dimid", "_Netcdf4Coordinates",
                         "_NCProperties", "_nc3_strict"})
ATTRIBUTE = "content_hash"
_ROWS_AT_ONCE = 16_000_000  # bytes
DIGEST = "digest_"


def content_hash(file: h5py.Group, rows: Mapping[str, bytes] | None = None) -> str:
    """SHA-256, in hexadecimal, of all that an open file or group holds.

    rows: of data sets by name, the SHA-256 of all their rows one after another, where they are known already; it is not
    read from the file, which is to be checked.
    """
    digest = sha256()
    known = {} if rows is None else rows
    _add_attributes(digest, file, "/")
    for name in sorted(_names(file)):
        item = file[name]
        digest.update(f"{name}\0{'group' if isinstance(item, h5py.Group) else 'data'}\0".encode())
        _add_attributes(digest, item, name)
        if isinstance(item, h5py.Dataset):
            if name in known:
                digest.update(f"{_type(item.dtype)}{item.shape}\0".encode())
                digest.update(known[name])
            else:
                _add_values(digest, item, DIGEST + name in file)
    return digest.hexdigest()


def _names(file: h5py.Group) -> list[str]:
    found: list[str] = []
    file.visit(found.append)
    return found


def _add_attributes(digest: Any, item: Any, name: str) -> None:
    for key in sorted(set(item.attrs) - BOOKKEEPING - {ATTRIBUTE}):
        digest.update(f"{name}@{key}\0".encode())
        _add_array(digest, np.asarray(item.attrs[key]))


def _add_values(digest: Any, data: h5py.Dataset, by_rows: bool) -> None:
    digest.update(f"{_type(data.dtype)}{data.shape}\0".encode())
    if data.ndim == 0:
        _add_array(digest, np.asarray(data[()]))
        return
    row = max(1, data.dtype.itemsize * int(np.prod(data.shape[1:])))
    rows = max(1, _ROWS_AT_ONCE // row)
    if data.chunks:  # whole chunks, so that none is unpacked twice
        rows = max(rows // data.chunks[0], 1) * data.chunks[0]
    for first in range(0, data.shape[0], rows):
        block = np.asarray(data[first:first + rows])
        if by_rows:
            digest.update(b"".join(map(row_digest, block)))
        else:
            _add_bytes(digest, block)


def row_digest(row: np.ndarray, length: int | None = None) -> bytes:
    """SHA-256 of one row's numbers, little-endian, every NaN the same; behind `length` it holds numpy's own NaN, if any."""
    if length is not None and row.dtype.isnative and sys.byteorder == "little" and row.flags.c_contiguous \
            and not (row.dtype.kind == "f" and np.isnan(row[:length]).any()):
        return sha256(row.data).digest()
    return sha256(_canonical(row).data).digest()


def _type(dtype: np.dtype) -> str:
    """A type's name that does not tell how wide a text happened to be held."""
    return "text" if dtype.kind in "OSU" else dtype.newbyteorder("<").str


def _add_array(digest: Any, array: np.ndarray) -> None:
    digest.update(f"{_type(array.dtype)}{array.shape}\0".encode())
    _add_bytes(digest, array)


def _add_bytes(digest: Any, array: np.ndarray) -> None:
    """Values in a fixed byte order; every NaN counts as the same."""
    if array.dtype.kind in "OSU":
        for item in array.ravel():
            text = item if isinstance(item, bytes) else str(item).encode()
            digest.update(f"{len(text)}:".encode() + text)
        return
    digest.update(_canonical(array))


def _canonical(array: np.ndarray) -> np.ndarray:
    values = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    if values.dtype.kind == "f":
        unknown = np.isnan(values)
        if unknown.any():
            values = np.where(unknown, np.array(np.nan, values.dtype), values)
    return values
