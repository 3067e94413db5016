"""A file in memory for HDF5 to write to, on memory that a thread keeps from one file to the next.

New memory is dear: the system clears it page by page when it is first touched, which took longer than packing and summing.
Where there is no more of it, HDF5, which does not stand a write that fails, does not hear of it: `content` raises it.
"""

from __future__ import annotations

import io
import threading

import numpy as np

_kept = threading.local()


class MemoryFile:
    """Reads and writes as a binary file does; `content` is what was written. keep: leave the memory to the thread's next."""

    def __init__(self, size: int, keep: bool = False) -> None:
        """size: bytes expected; more are taken where they are needed."""
        room = getattr(_kept, "room", None) if keep else None
        self.room = np.empty(size, np.uint8) if room is None or len(room) < size else room
        _kept.room = None  # two files of one thread do not share it
        self.keep, self.place, self.end = keep, 0, 0
        self.problem: BaseException | None = None

    def __enter__(self) -> MemoryFile:
        return self

    def __exit__(self, *_: object) -> None:
        if self.keep:
            _kept.room = self.room

    def content(self) -> memoryview:
        """All bytes; good until the file is left. Raises what kept them from being written."""
        if self.problem is not None:
            raise self.problem
        return self.room.data[: self.end]

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self.place = offset + (0, self.place, self.end)[whence]
        return self.place

    def tell(self) -> int:
        return self.place

    def write(self, data: memoryview) -> int:
        size = len(data)
        try:
            if size and self.place + size > self.end:
                self._reach(self.place, self.place + size)
            self.room[self.place:self.place + size] = np.frombuffer(data, np.uint8)
        except BaseException as problem:  # no room, or an interruption that strikes here
            self.problem = problem
        self.place += size
        return size

    def read(self, size: int = -1) -> bytes:
        end = self.end if size < 0 else min(self.end, self.place + size)
        first, self.place = self.place, max(self.place, end)
        return self.room[first:end].tobytes()

    def readinto(self, data: memoryview) -> int:
        size = max(0, min(len(data), self.end - self.place))
        data[:size] = self.room.data[self.place:self.place + size]
        self.place += size
        return size

    def truncate(self, size: int | None = None) -> int:
        size = self.place if size is None else size
        try:
            if size > self.end:
                self._reach(size, size)
            self.end = size
        except MemoryError as problem:
            self.problem = problem
        return size

    def flush(self) -> None:
        """Nothing waits to be written."""

    def _reach(self, written: int, end: int) -> None:
        """Make the file `end` bytes long, zero between its end so far and `written`: the memory holds what was there before."""
        if end > len(self.room):
            larger = np.empty(max(end, len(self.room) + len(self.room) // 2), np.uint8)
            larger[: self.end] = self.room[: self.end]
            self.room = larger
        if written > self.end:
            self.room[self.end:written] = 0
        self.end = end


def release() -> None:
    """Give back the memory this thread keeps."""
    _kept.room = None
