"""A file on the disk for HDF5 to write to, which never learns that the disk failed.

HDF5 does not stand a write that fails: its file cannot be closed any more, and the process may crash at its end. So the first
failure is kept, what comes after it goes to memory, and the failure is raised once HDF5 has closed its file: the file is then
thrown away. Look at `check` now and then: memory is to hold no more than what HDF5 has in hand.
"""

from __future__ import annotations

import io
from pathlib import Path
from types import TracebackType


class SteadyFile:
    """Reads and writes as a binary file does. Raises what went wrong at its end, or by `check`."""

    def __init__(self, path: Path) -> None:
        self.file = path.open("r+b", buffering=0)
        self.place, self.end = 0, 0
        self.problem: BaseException | None = None  # also an interruption that strikes here
        self.after: list[tuple[int, bytes]] = []  # written since the disk failed

    def __enter__(self) -> SteadyFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: BaseException | TracebackType | None) -> None:
        self.after.clear()
        self.file.close()
        if self.problem is not None and (kind is None or issubclass(kind, Exception)):
            raise self.problem from None

    def check(self) -> None:
        """Raises what went wrong since the file was opened."""
        if self.problem is not None:
            raise self.problem

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self.place = offset + (0, self.place, self.end)[whence]
        return self.place

    def tell(self) -> int:
        return self.place

    def write(self, data: memoryview) -> int:
        view = memoryview(data).cast("B")
        if self.problem is None:
            try:
                self.file.seek(self.place)
                done = 0
                while done < len(view):
                    done += self.file.write(view[done:]) or 0
            except BaseException as problem:
                self.problem = problem
        if self.problem is not None:
            self.after.append((self.place, bytes(view)))
        self.place += len(view)
        self.end = max(self.end, self.place)
        return len(view)

    def readinto(self, data: memoryview) -> int:
        view = memoryview(data).cast("B")
        view = view[: max(0, min(len(view), self.end - self.place))]
        view[:] = bytes(len(view))
        try:
            self.file.seek(self.place)
            self.file.readinto(view)
        except OSError as problem:
            self.problem = self.problem or problem
        for at, piece in self.after:
            first, last = max(at, self.place), min(at + len(piece), self.place + len(view))
            if first < last:
                view[first - self.place:last - self.place] = piece[first - at:last - at]
        self.place += len(view)
        return len(view)

    def read(self, size: int = -1) -> bytes:
        found = bytearray(max(0, self.end - self.place) if size < 0 else size)
        return bytes(found[: self.readinto(memoryview(found))])

    def truncate(self, size: int | None = None) -> int:
        self.end = self.place if size is None else size
        try:
            self.file.truncate(self.end)
        except OSError as problem:
            self.problem = self.problem or problem
        return self.end

    def flush(self) -> None:
        """Nothing waits to be written."""
