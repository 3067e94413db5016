"""Files appear whole or not at all: written under a temporary name beside the target, flushed, then renamed."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from testbed.problem import InputProblem
from testbed.system.interruption import unfinished


@contextmanager
def replacing(path: str | Path, durable: bool = True) -> Iterator[Path]:
    """A temporary path to write to; it becomes `path` on success and is removed on any failure.

    durable: have it on the disk before it has its name; a file that can be told to be whole and be made again need not.
    Raises InputProblem where the folder cannot be written.
    """
    target = Path(path)
    if target.is_dir():
        raise InputProblem(path, "is a folder", "name a file")
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part")
        os.close(handle)
    except OSError as problem:
        raise InputProblem(path, f"cannot be written ({problem.strerror})", "choose another place") from None
    temporary = Path(name)
    unfinished.add(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())  # mkstemp makes the file private
        if durable:
            _synchronise(temporary)
        os.replace(temporary, target)
        if durable:
            settle_names(target.parent)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    finally:
        unfinished.discard(name)


def _umask() -> int:
    current = os.umask(0o022)
    os.umask(current)
    return current


def _synchronise(path: Path) -> None:
    """Make sure the bytes are on the disk before the name is: a rename may outlive a power cut that data did not."""
    handle = os.open(path, os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def settle_names(folder: Path) -> None:
    """Make sure the disk has a folder's names before what they replace is removed; OSError only where it is broken or full."""
    if os.name != "posix":
        return
    handle = -1
    try:
        handle = os.open(folder, os.O_RDONLY)
        os.fsync(handle)
    except OSError as problem:
        if problem.errno in (errno.EIO, errno.ENOSPC, errno.EDQUOT):  # others: a system that has no such thing
            raise
    finally:
        if handle >= 0:
            os.close(handle)


def write_text(path: str | Path, text: str) -> None:
    """Write a UTF-8 text file, whole or not at all. InputProblem where it cannot be written."""
    try:
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise InputProblem(path, f"cannot be written ({problem.strerror})", "make room, or choose another place") from None
