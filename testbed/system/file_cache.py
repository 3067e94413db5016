"""Files written once, that leave the system's file cache as soon as the disk has them.

A sweep writes far more than it reads again soon. Left alone, its files fill all free memory, put out what other programs
had there, and take a fresh page for every 4096 bytes, which the system (and, in a virtual machine, its host) must first
find: that took more of a sweep's time than the simulation. Pages that are let go of are taken again, warm.

Nobody waits for it: one thread sees to it, and where the disk is slower than the sweep, a file simply stays in the cache.
"""

from __future__ import annotations

import _thread
import os
from queue import SimpleQueue

_MOST_WAITING = 4  # files at a time; beyond it the disk is behind, and memory is what holds the files meanwhile
_waiting: SimpleQueue[int] = SimpleQueue()  # descriptors; no lock of Python's, which Ctrl-C might leave taken
_begun: list[int] = []


def leave_when_written(descriptor: int) -> None:
    """Have an open file's bytes put on the disk and dropped from memory, at some later time; it may be closed meanwhile."""
    if not hasattr(os, "posix_fadvise") or _waiting.qsize() >= _MOST_WAITING:
        return
    try:
        own = os.dup(descriptor)
    except OSError:  # too many open files: it stays in the cache
        return
    _waiting.put(own)
    if not _begun:
        _begun.append(_thread.start_new_thread(_settle_all, ()))


def leave(descriptor: int) -> None:
    """Drop what the disk has of an open file from memory."""
    if hasattr(os, "posix_fadvise"):
        os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)


def _settle_all() -> None:
    while True:
        _settle(_waiting.get())


def _settle(descriptor: int) -> None:
    try:
        os.fdatasync(descriptor)
        leave(descriptor)
    except OSError:  # what the disk did not take shows where the file's seal is checked, which reads it from the disk
        pass
    finally:
        os.close(descriptor)
