"""A seal at a file's end: the hash of all bytes before it, so that one flipped bit anywhere is noticed.

The content hash of a data set covers its values, not the bytes that HDF5 keeps for itself. The seal covers all of them.
It stands after HDF5's own end of file, where no HDF5 reader looks: `\\nsealed sha256-16M DIGEST SIZE\\n`, SIZE the
number of bytes before it, DIGEST the SHA-256 of the SHA-256 of each 16 MiB of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from hashlib import sha256
from io import FileIO
from pathlib import Path
from typing import Literal

from testbed.file_cache import leave_when_written

BLOCK = 16 * 2**20  # bytes
_PIECE = 2**19  # bytes read or written at once
_LENGTH = len(b"\nsealed sha256-16M " + b"0" * 64 + b" " + b"0" * 15 + b"\n")
_PATTERN = re.compile(rb"\nsealed sha256-16M ([0-9a-f]{64}) ([0-9]{15})\n")
State = Literal["whole", "broken", "absent"]


def seal(path: Path, threads: int = 1) -> None:
    """Put the seal at the end of a finished file. OSError where it cannot be written."""
    size = path.stat().st_size
    with path.open("ab") as file:
        file.write(_trailer(_digest(path, size, threads), size))


def write_sealed(path: Path, content: bytes | memoryview, keep: bool = True) -> None:
    """Write a file and its seal; `keep` it in the system's file cache. OSError where it cannot be written."""
    total, view = sha256(), memoryview(content)
    with path.open("wb") as file:
        for first in range(0, len(view), BLOCK):
            block, found = view[first:first + BLOCK], sha256()
            for place in range(0, len(block), _PIECE):  # written while the processor still has what it hashed at hand
                found.update(block[place:place + _PIECE])
                file.write(block[place:place + _PIECE])
            total.update(found.digest())
        file.write(_trailer(total.hexdigest(), len(view)))
        if not keep:
            file.flush()
            leave_when_written(file.fileno())


def _trailer(digest: str, size: int) -> bytes:
    return f"\nsealed sha256-16M {digest} {size:015d}\n".encode()


def sealed_size(path: Path) -> int | None:
    """Number of bytes before the seal; None where the file does not end in one that fits its length."""
    size = path.stat().st_size - _LENGTH
    if size < 0:
        return None
    with path.open("rb") as file:
        file.seek(size)
        found = _PATTERN.fullmatch(file.read())
    return size if found and int(found[2]) == size else None


def state(path: Path, threads: int = 1) -> State:
    """Whether a file is, to the last bit, what was sealed. Reads all of it. OSError where it cannot be read."""
    size = sealed_size(path)
    if size is None:
        return "absent"
    with path.open("rb") as file:
        file.seek(size)
        found = _PATTERN.fullmatch(file.read())
    return "whole" if found and found[1].decode() == _digest(path, size, threads) else "broken"


def cut_off(path: Path) -> bool:
    """True where a file ends in the beginning of a seal."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _LENGTH))
        return b"\nsealed sha256-16M " in file.read()


def _digest(path: Path, size: int, threads: int) -> str:
    total = sha256()
    if threads <= 1 or size <= BLOCK:
        piece = memoryview(bytearray(min(_PIECE, size)))
        with path.open("rb", buffering=0) as file:
            for first in range(0, size, BLOCK):
                total.update(_hashed(file, min(BLOCK, size - first), piece))
        return total.hexdigest()

    def block(first: int) -> bytes:
        with path.open("rb", buffering=0) as file:
            file.seek(first)
            return _hashed(file, min(BLOCK, size - first), memoryview(bytearray(_PIECE)))

    with ThreadPoolExecutor(threads) as pool:
        for digest in _few_ahead(pool, block, size, 2 * threads):
            total.update(digest)
    return total.hexdigest()


def _hashed(file: FileIO, size: int, piece: memoryview) -> bytes:
    """SHA-256 of the next `size` bytes, read into the same memory again and again: new memory costs as much as hashing."""
    found = sha256()
    while size > 0 and (read := file.readinto(piece[: min(size, len(piece))])):
        found.update(piece[:read])
        size -= read
    return found.digest()


def _few_ahead(pool: ThreadPoolExecutor, block: Callable[[int], bytes], size: int, ahead: int) -> Iterator[bytes]:
    """The blocks' digests in order, with a few in work at a time: memory stays flat however large the file."""
    waiting: list[Future[bytes]] = []
    for first in range(0, size, BLOCK):
        waiting.append(pool.submit(block, first))
        if len(waiting) >= ahead:
            yield waiting.pop(0).result()
    for future in waiting:
        yield future.result()
