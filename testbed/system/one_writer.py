"""One writer an output: a lock file beside it, `OUTPUT.lock`, that says who writes.

The lock itself is the system's (`flock`), which a dead process does not keep. A file that names another machine is believed:
on a network file system the system's word may not reach so far, and nobody can tell from here whether that process lives. One
thing tells: the queue, which starts a job again only when its former run is over.
"""

from __future__ import annotations

import errno
import json
import os
import socket
import stat
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from testbed.problem import InputProblem

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_TRIES, _PAUSE = 20, 0.05  # s; a lock file without a name is about to get one, or its machine went down
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
_NOFOLLOW = getattr(os, "O_NOFOLLOW", 0)
_NONBLOCK = getattr(os, "O_NONBLOCK", 0)
_KEYS = ("host", "pid", "begun", "since", "job", "restart")
Owner = Mapping[str, Any]


def lock_path(target: Path) -> Path:
    """The lock file of an output."""
    return target.with_name(target.name + ".lock")


@contextmanager
def one_writer(target: Path) -> Iterator[Callable[[], None]]:
    """Be the only process that writes `target`. InputProblem where another one does, or where no lock can be made.

    What it gives raises InputProblem where the lock was taken away meanwhile: call it before what cannot be undone.
    """
    path, me = lock_path(target), _myself()
    handle = _take(path, target, me)

    def check() -> None:
        if not (_same_file(handle, path) and _owner(handle) == me):
            raise InputProblem(target, f"the lock {path.name} was taken away: another sweep may write to it",
                               "see what else runs, then continue with --resume")

    try:
        yield check
    finally:
        if fcntl is None:  # Windows does not remove an open file
            os.close(handle)
        with suppress(OSError):
            if fcntl is None or _same_file(handle, path):
                path.unlink()
        if fcntl is not None:
            os.close(handle)


def _take(path: Path, target: Path, me: Owner) -> int:
    """The open lock file with our name in it."""
    try:
        for _ in range(_TRIES):
            handle = _try(path, target, me)
            if handle is not None:
                return handle
            time.sleep(_PAUSE)
    except OSError as problem:
        raise InputProblem(target, f"cannot be written ({path.name}: {problem.strerror})", "choose another place with -o") \
            from None
    raise InputProblem(path, "is a lock that does not say who holds it", "remove it if no sweep writes there")


def _try(path: Path, target: Path, me: Owner) -> int | None:
    """As `_take`, once; None where the file is on its way in or out. OSError, InputProblem."""
    fresh = True
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    except FileExistsError:
        fresh = False
        try:
            handle = os.open(path, os.O_RDWR | _NOFOLLOW | _NONBLOCK)
        except FileNotFoundError:
            return None
    try:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise InputProblem(path, "is no lock of a sweep", "move it elsewhere, or choose another name with -o")
        free = _locked(handle)
        if free is not False and not _same_file(handle, path):  # its holder ended between our two steps
            os.close(handle)
            return None
        if not fresh:
            owner = _owner(handle, path)
            if owner is None and free is not False:
                os.close(handle)
                return None
            _refuse_while_held(path, target, owner or {}, free, me)
        text = json.dumps(me).encode()
        os.ftruncate(handle, 0)
        os.pwrite(handle, text, 0) if hasattr(os, "pwrite") else os.write(handle, text)
        os.fsync(handle)
        return handle
    except BaseException:
        os.close(handle)
        if fresh:
            path.unlink(missing_ok=True)
        raise


def _refuse_while_held(path: Path, target: Path, owner: Owner, free: bool | None, me: Owner) -> None:
    """InputProblem unless the holder is known to be dead. free: whether the system gave us its lock, None where it has none."""
    who = f"process {owner.get('pid', 'unknown')} on {owner.get('host', 'unknown')}, since {owner.get('since', 'unknown')}"
    if free is False:
        raise InputProblem(target, f"another sweep writes to it ({who})", "wait for it, or choose another name with -o")
    if owner["job"] and owner["job"] == me["job"] and int(owner["restart"]) < int(me["restart"]):
        return
    if owner["host"] == me["host"] and (free or not _alive(owner)):
        return
    raise InputProblem(target, f"another sweep writes to it ({who}), or did when that machine went down: from here "
                       "nobody can tell", f"wait for it; if it has ended, remove {path.name}")


def _myself() -> Owner:
    return {"host": socket.gethostname(), "pid": os.getpid(), "begun": _begun(os.getpid()),
            "since": datetime.now(UTC).isoformat(timespec="microseconds"), "job": os.environ.get("SLURM_JOB_ID", ""),
            "restart": os.environ.get("SLURM_RESTART_COUNT", "0")}


def _begun(pid: int) -> str:
    """When a process of this machine was started (Linux), so that another one of its number is not taken for it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        return ""


def _alive(owner: Owner) -> bool:
    if fcntl is None:  # on Windows to ask a process is to interrupt it
        return True
    try:
        os.kill(int(owner["pid"]), 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return _begun(int(owner["pid"])) == owner["begun"]


def _locked(handle: int) -> bool | None:
    """Whether the system's lock is ours now; None where there are none."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as problem:
        if problem.errno in _NO_LOCKS:
            return None
        raise
    return True


def _same_file(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.lstat())
    except FileNotFoundError:
        return False


def _owner(handle: int, path: Path | None = None) -> Owner | None:
    """Who the file says holds it, None where it says nothing yet. InputProblem where it is somebody's own file."""
    os.lseek(handle, 0, os.SEEK_SET)
    text = os.read(handle, 4096)
    try:
        found = json.loads(text) if text.strip(b"\0") else None
        if found is not None and (set(found) != set(_KEYS) or int(found["pid"]) < 1 or int(found["restart"]) < 0):
            raise ValueError
    except (ValueError, TypeError, RecursionError):
        if path is None:
            return None
        raise InputProblem(path, "is no lock of a sweep", "move it elsewhere, or choose another name with -o") from None
    return found
