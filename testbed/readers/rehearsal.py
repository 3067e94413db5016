"""A reading rehearsed in a child process, for libraries that a damaged file can bring down, or keep for ever."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from testbed.problem import InputProblem
from testbed.system.child import tried

_AT_LEAST, _SLOWEST = 6.0, 10e6  # s that a reading may take, and bytes a second beyond


def rehearse(path: Path, read: Callable[[], object]) -> None:
    """Run `read` in a forked child first. Raises InputProblem where the child is killed or does not come to an end.

    An exception in the child is no matter here: the real reading will raise it again.
    """
    seconds = _AT_LEAST + path.stat().st_size / _SLOWEST
    ended = tried(lambda say: read(), seconds)
    if ended.how == "too late":
        raise InputProblem(path, f"reading it does not end within {seconds:.0f} s", "the file is damaged: save it again")
    if ended.how == "killed":
        raise InputProblem(path, "the file is damaged so badly that its library crashes on it", "save it again")
