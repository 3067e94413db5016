"""A reading rehearsed in a child process, for libraries in C that a damaged file can bring down."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import time
from collections.abc import Callable
from pathlib import Path

from testbed.problem import InputProblem

_LONGEST = 120.0  # s; no measured file takes longer to read


def rehearse(path: Path, read: Callable[[], object]) -> None:
    """Run `read` in a forked child first. Raises InputProblem where the child is killed or does not come to an end.

    An exception in the child is no matter here: the real reading will raise it again. Where a system cannot fork
    (Windows) nothing is rehearsed.
    """
    if not hasattr(os, "fork"):
        return
    child = os.fork()
    if child == 0:
        faulthandler.disable()
        with contextlib.suppress(BaseException):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            read()
        os._exit(0)
    deadline, pause = time.monotonic() + _LONGEST, 0.0005
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() > deadline:
            os.kill(child, 9)
            os.waitpid(child, 0)
            raise InputProblem(
                path, f"reading it does not end within {_LONGEST:.0f} s", "the file is damaged: save it again"
            )
        time.sleep(pause)
        pause = min(0.05, 1.5 * pause)
    if os.WIFSIGNALED(status):
        raise InputProblem(path, "the file is damaged so badly that its library crashes on it", "save it again")
