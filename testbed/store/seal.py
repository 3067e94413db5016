"""A seal at a file's end: a sum over all bytes before it, so that one flipped bit anywhere is noticed.

The content hash of a data set covers its values by SHA-256, not the bytes that HDF5 keeps for itself. The seal covers all of
them, against what disks and copies do: it is a sum, so that no value is hashed twice. It stands after HDF5's own end of file,
where no HDF5 reader looks: `\\nsealed sums64-16M DIGEST SIZE\\n`, SIZE the number of bytes before it, DIGEST the SHA-256 of
what each 16 MiB of them comes to. That is the SHA-256 of the sums, modulo 2^64, of the columns and of the rows of each 512 KiB,
laid out in rows of 1024 words of 8 bytes and filled up with zeros: up to three wrong bits wherever they are, a page that stands
twice or two that changed places leave them no chance to agree. A seal `sha256-16M`, of older files, has the SHA-256 of the
bytes themselves in their place.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import closing
from hashlib import sha256
from io import FileIO
from pathlib import Path
from typing import Any, Literal

import numpy as np

from testbed.system.file_cache import leave_when_written
from testbed.system.threads import in_order

BLOCK = 16 * 2**20  # bytes
_PIECE = 2**19  # bytes read or written at once
_ROW = 1024         # words of 8 bytes
SUMS, SHA256 = "sums64-16M", "sha256-16M"  # kinds of seal, of one length
_LENGTH = len(f"\nsealed {SUMS} ".encode() + b"0" * 64 + b" " + b"0" * 15 + b"\n")
_PATTERN = re.compile(rf"\nsealed ({SUMS}|{SHA256}) ([0-9a-f]{{64}}) ([0-9]{{15}})\n".encode())
State = Literal["whole", "broken", "absent"]


class _Sums:
    """The digest of a block from its pieces, in the manner of hashlib: each but the last of _PIECE bytes."""

    def __init__(self) -> None:
        self._found = sha256()

    def update(self, piece: bytes | memoryview) -> None:
        words = np.frombuffer(piece, "<u8", len(piece) // 8)
        whole = len(words) // _ROW * _ROW
        rows = words[:whole].reshape(-1, _ROW)
        columns, beside = rows.sum(axis=0, dtype="<u8"), rows.sum(axis=1, dtype="<u8")
        if 8 * whole < len(piece):
            rest = np.zeros(_ROW, "<u8")
            rest.view(np.uint8)[: len(piece) - 8 * whole] = np.frombuffer(piece, np.uint8)[8 * whole:]
            columns, beside = columns + rest, np.append(beside, rest.sum(dtype="<u8"))
        self._found.update(columns.tobytes() + beside.tobytes())

    def digest(self) -> bytes:
        return self._found.digest()


_KINDS: dict[str, Callable[[], Any]] = {SUMS: _Sums, SHA256: sha256}


def seal(path: Path, threads: int = 1) -> None:
    """Put the seal at the end of a finished file. OSError where it cannot be written."""
    size = path.stat().st_size
    with path.open("ab") as file:
        file.write(_trailer(_digest(path, size, threads, SUMS), size))


def write_sealed(path: Path, content: bytes | memoryview, keep: bool = True) -> None:
    """Write a file and its seal; `keep` it in the system's file cache. OSError where it cannot be written."""
    total, view = sha256(), memoryview(content)
    with path.open("wb") as file:
        for first in range(0, len(view), BLOCK):
            block, found = view[first:first + BLOCK], _Sums()
            for place in range(0, len(block), _PIECE):  # written while the processor still has what it summed at hand
                found.update(block[place:place + _PIECE])
                file.write(block[place:place + _PIECE])
            total.update(found.digest())
        file.write(_trailer(total.hexdigest(), len(view)))
        if not keep:
            file.flush()
            leave_when_written(file.fileno())


def _trailer(digest: str, size: int) -> bytes:
    return f"\nsealed {SUMS} {digest} {size:015d}\n".encode()


def sealed_size(path: Path) -> int | None:
    """Number of bytes before the seal; None where the file does not end in one that fits its length."""
    size = path.stat().st_size - _LENGTH
    if size < 0:
        return None
    with path.open("rb") as file:
        file.seek(size)
        found = _PATTERN.fullmatch(file.read())
    return size if found and int(found[3]) == size else None


def state(path: Path, threads: int = 1) -> State:
    """Whether a file is, to the last bit, what was sealed. Reads all of it. OSError where it cannot be read."""
    size = sealed_size(path)
    if size is None:
        return "absent"
    with path.open("rb") as file:
        file.seek(size)
        found = _PATTERN.fullmatch(file.read())
    return "whole" if found and found[2].decode() == _digest(path, size, threads, found[1].decode()) else "broken"


def cut_off(path: Path) -> bool:
    """True where a file ends in the beginning of a seal."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _LENGTH))
        end = file.read()
        return any(f"\nsealed {kind} ".encode() in end for kind in _KINDS)


def _digest(path: Path, size: int, threads: int, kind: str) -> str:
    total = sha256()
    if threads <= 1 or size <= BLOCK:
        piece = memoryview(bytearray(min(_PIECE, size)))
        with path.open("rb", buffering=0) as file:
            for first in range(0, size, BLOCK):
                total.update(_summed(file, min(BLOCK, size - first), piece, kind))
        return total.hexdigest()

    def block(first: int) -> bytes:
        with path.open("rb", buffering=0) as file:
            file.seek(first)
            return _summed(file, min(BLOCK, size - first), memoryview(bytearray(_PIECE)), kind)

    with closing(in_order(block, range(0, size, BLOCK), threads, 2 * threads)) as digests:  # so memory stays flat
        for digest in digests:
            total.update(digest)
    return total.hexdigest()


def _summed(file: FileIO, size: int, piece: memoryview, kind: str) -> bytes:
    """The digest of the next `size` bytes, read into the same memory again and again: new memory costs as much as summing."""
    found = _KINDS[kind]()
    while size > 0:
        wanted, held = min(size, len(piece)), 0
        while held < wanted and (read := file.readinto(piece[held:wanted])):
            held += read
        found.update(piece[:held])
        if held < wanted:  # cut short meanwhile
            break
        size -= wanted
    return found.digest()
