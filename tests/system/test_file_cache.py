"""Shards leave the file cache: their bytes are on the disk as they were, and nothing waits or fails for it."""

import os
import threading

import pytest

from testbed.store.seal import state, write_sealed
from testbed.system import file_cache

pytestmark = pytest.mark.skipif(not hasattr(os, "posix_fadvise"), reason="the system takes no advice on its file cache")


def _settled():
    """Wait until all that was handed over is done with."""
    if file_cache._begun:
        ours, theirs = os.pipe()
        file_cache._waiting.put(theirs)
        with os.fdopen(ours) as end:
            end.read()  # comes to its end when the other one is closed


def test_a_file_that_left_the_cache_is_whole(tmp_path, monkeypatch):
    left = []
    leave = file_cache.leave
    monkeypatch.setattr(file_cache, "leave", lambda descriptor: (left.append(os.fstat(descriptor).st_ino), leave(descriptor)))
    path = tmp_path / "a"
    write_sealed(path, os.urandom(3_000_001), keep=False)
    _settled()
    assert left == [path.stat().st_ino]
    assert state(path) == "whole"
    with path.open("r+b") as file:
        file.seek(2_000_000)
        was = file.read(1)
        file.seek(2_000_000)
        file.write(bytes([was[0] ^ 1]))
    assert state(path) == "broken"


def test_what_is_to_be_kept_is_not_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(file_cache, "_settle", lambda descriptor: pytest.fail("was handed over"))
    write_sealed(tmp_path / "a", b"x" * 100)
    assert state(tmp_path / "a") == "whole"


def test_a_disk_that_is_behind_keeps_no_worker_waiting(tmp_path, monkeypatch):
    go, synchronised = threading.Event(), []
    monkeypatch.setattr(os, "fdatasync", lambda descriptor: (go.wait(60), synchronised.append(descriptor)))
    for number in range(20):  # returns at once although nothing gets to the disk
        write_sealed(tmp_path / str(number), bytes([number]) * 100, keep=False)
    go.set()
    _settled()
    handed_over = len(synchronised) - 1  # one more is _settled's own; one may have been under way, beside those that wait
    assert handed_over in (file_cache._MOST_WAITING, file_cache._MOST_WAITING + 1)
    assert all(state(tmp_path / str(number)) == "whole" for number in range(20))
    write_sealed(tmp_path / "next", b"x" * 100, keep=False)
    _settled()
    assert len(synchronised) == handed_over + 3


def test_a_disk_that_fails_leaves_nothing_open(tmp_path, monkeypatch):
    def fail(descriptor):
        raise OSError(5, "input/output error")

    monkeypatch.setattr(os, "fdatasync", fail)
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0
    for number in range(3 * file_cache._MOST_WAITING):
        write_sealed(tmp_path / str(number), b"x" * 100, keep=False)
        _settled()
    assert (len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0) == before
    assert file_cache._waiting.empty()
