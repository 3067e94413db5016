"""Hashes of what an HDF5 file says, not of its bytes, which differ from one writing to the next.

The content hash covers every group's and data set's name, type, shape, attributes and values. Not covered: storage (chunks,
filters), the bookkeeping of dimension scales, and how the file came about (`PROVENANCE`: versions, wording), which has a hash
of its own. So equal values made by other versions have equal content hashes. A data set `x` beside which `digest_x` keeps the
hashes of its rows counts by those: many workers can hash the rows they write, and a reader checks all but the rows at once
and every row when it reads it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from hashlib import sha256
from typing import Any

import h5py
import numpy as np

BOOKKEEPING = frozenset({"REFERENCE_LIST", "DIMENSION_LIST", "CLASS", "NAME", "_Netcdf4Dimid", "_Netcdf4Coordinates",
                         "_NCProperties", "_nc3_strict"})
ATTRIBUTE = "content_hash"
PROVENANCE_ATTRIBUTE = "provenance_hash"
PROVENANCE = frozenset({"Conventions", "long_name", "format", "engine", "versions", "scenario_fingerprint", "model_xml",
                        "provenance"})  # names of attributes and data sets
TOGETHER_UP_TO = 2  # format: until then the content hash covered the provenance too
_ROWS_AT_ONCE = 16_000_000  # bytes
DIGEST = "digest_"
_DIGEST_BYTES = 32


Rows = Mapping[str, bytes]
Lent = Mapping[str, h5py.Dataset]


def content_hash(file: h5py.Group, rows: Rows | None = None, lent: Lent | None = None, today: bool = False) -> str:
    """SHA-256, in hexadecimal, of the values that an open file or group holds.

    rows: of data sets by name, the SHA-256 of all their rows one after another, where they are known already; it is not
    read from the file, which is to be checked. lent: data sets that stand elsewhere and count as the file's, with `rows`.
    today: by today's rule also where the file is of an older one.
    """
    together = _format(file) <= TOGETHER_UP_TO and not today
    return _hashed(file, rows or {}, lent or {}, lambda name: together or name not in PROVENANCE, frozenset({ATTRIBUTE}))


def provenance_hash(file: h5py.Group, lent: Lent | None = None) -> str:
    """SHA-256, in hexadecimal, of what the content hash leaves out, and of the content hash."""
    return _hashed(file, {}, lent or {}, lambda name: name in PROVENANCE or name == ATTRIBUTE, frozenset())


def contradiction(file: h5py.Group, lent: Lent | None = None) -> str | None:
    """What an open file says that is not what was written, or None. Reads all but the rows whose hashes are kept."""
    try:
        if content_hash(file, kept_rows(file), lent) != str(file.attrs.get(ATTRIBUTE, "")):
            return "its values are not those that its content hash was written for"
        if _format(file) > TOGETHER_UP_TO and provenance_hash(file, lent) != str(file.attrs.get(PROVENANCE_ATTRIBUTE, "")):
            return "what it says of its making is not what was written"
    except (KeyError, ValueError, TypeError, AttributeError, IndexError) as problem:  # of what no data set holds
        return f"it holds what was not written ({' '.join(str(problem).split()) or type(problem).__name__})"
    return None


def kept_rows(file: h5py.Group) -> dict[str, bytes]:
    """The hashes of rows that a file keeps, by data set, one after another."""
    return {name.removeprefix(DIGEST): file[name][()].tobytes() for name in file
            if name.startswith(DIGEST) and file[name].ndim == 2}


def _format(file: h5py.Group) -> int:
    return int(file.attrs.get("format", TOGETHER_UP_TO + 1))


def _hashed(file: h5py.Group, rows: Rows, lent: Lent, counts: Callable[[str], bool], own: frozenset[str]) -> str:
    digest = sha256()
    _add_attributes(digest, file, "/", counts, own)
    for name in sorted({*_names(file), *lent}):
        item = file[name] if name in file else lent[name]
        here, described = counts(name), any(map(counts, set(item.attrs) - BOOKKEEPING - own))
        if not here and not described:
            continue
        digest.update(f"{name}\0{'group' if isinstance(item, h5py.Group) else 'data'}\0".encode())
        _add_attributes(digest, item, name, counts, own)
        if here and isinstance(item, h5py.Dataset):
            if name in rows:
                shape = item.shape if name in file else (len(rows[name]) // _DIGEST_BYTES, *item.shape[1:])
                digest.update(f"{_type(item.dtype)}{shape}\0".encode())
                digest.update(rows[name])
            else:
                _add_values(digest, item, DIGEST + name in file)
    return digest.hexdigest()


def _names(file: h5py.Group) -> list[str]:
    found: list[str] = []
    file.visit(found.append)
    return found


def _add_attributes(digest: Any, item: Any, name: str, counts: Callable[[str], bool], own: frozenset[str]) -> None:
    for key in sorted(filter(counts, set(item.attrs) - BOOKKEEPING - own - {PROVENANCE_ATTRIBUTE})):
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
            and not (row.dtype.kind == "f" and np.isnan(row[:length] @ row[:length])):  # one NaN makes the product another
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
