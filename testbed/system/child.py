"""Work tried in a child process first: what crashes, never ends or fills the memory does so there."""

from __future__ import annotations

import contextlib
import faulthandler
import math
import os
import signal
import time
from collections.abc import Callable
from typing import Literal, NamedTuple

MEMORY = 4 * 2**30  # bytes that a child may take beyond what it begins with
WAITED = 2.5
_LAST = b"\0"  # written when all was done


class Ended(NamedTuple):
    """How a child ended, the signal that killed it (0: none), and the lines that it said."""

    how: Literal["done", "failed", "killed", "too late", "not tried"]
    signal: int = 0
    said: tuple[str, ...] = ()


def tried(work: Callable[[Callable[[str], None]], object], seconds: float, memory: int = MEMORY) -> Ended:
    """Run `work` in a forked child; it is handed a function that says a line, of some 60 kB in all.

    seconds: of processor time, and WAITED times that on the clock, as others may want the processor, too. failed: an
    exception, or an end before its end. Where a system cannot fork (Windows) nothing is tried.
    """
    if not hasattr(os, "fork"):
        return Ended("not tried")
    inward, outward = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(inward)
        _in_the_child(work, outward, memory, seconds)
    os.close(outward)
    try:
        how, number = _awaited(child, WAITED * seconds)
        said = b"".join(iter(lambda: os.read(inward, 65536), b""))
    except BaseException:
        with contextlib.suppress(OSError):
            os.kill(child, 9)
            os.waitpid(child, 0)
        raise
    finally:
        os.close(inward)
    lines = tuple(said.removesuffix(_LAST).decode(errors="replace").splitlines())
    return Ended("failed" if how == "done" and not said.endswith(_LAST) else how, number, lines)


def _in_the_child(work: Callable[[Callable[[str], None]], object], outward: int, memory: int,
                  seconds: float) -> None:  # fmt: skip
    """Does not return."""
    faulthandler.disable()
    with contextlib.suppress(BaseException):
        null = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(null, stream)
        _limit(memory, seconds)
        work(lambda line: _say(outward, line))
        os.write(outward, _LAST)
    os._exit(0)


def _say(outward: int, line: str) -> None:
    os.write(outward, (" ".join(line.split())[:2000] + "\n").encode(errors="replace"))


def _limit(more: int, seconds: float) -> None:
    import resource

    own = address_space()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = min(one for one in (own + more, soft, hard) if one != resource.RLIM_INFINITY)
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds), resource.getrlimit(resource.RLIMIT_CPU)[1]))


def address_space() -> int:
    """Bytes of this process's address space; 0 where the system does not say."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return 2**36  # as good as no limit


def _awaited(child: int, seconds: float) -> tuple[Literal["done", "killed", "too late"], int]:
    deadline, pause = time.monotonic() + seconds, 0.0005
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
            return "too late" if number == signal.SIGXCPU else "killed" if number else "done", number
        if time.monotonic() > deadline:
            os.kill(child, 9)
            os.waitpid(child, 0)
            return "too late", 9
        time.sleep(pause)
        pause = min(0.05, 1.5 * pause)
