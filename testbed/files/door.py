"""The door: every file that a user names is looked at here before a byte of it is read, and read here where it may do harm.

What is no plain file is refused: a pipe may never end, a device never does, a name may lead in a circle. What a library makes
of a file that is none of its kind, be it an exception of any type, a crash or no end, becomes one line that names the file.
"""

from __future__ import annotations

import errno
import math
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from testbed.problem import InputProblem

_SAID = {errno.ELOOP: ("is a link that leads in a circle", "name the file itself"),
         errno.ENAMETOOLONG: ("is too long a name for a file", "check the path"),
         errno.ENOENT: ("there is no such file", "check the path"),
         errno.ENOTDIR: ("there is no such file", "check the path")}  # fmt: skip

_UNLOADED = ("failed to map segment", "cannot allocate memory", "Cannot allocate memory")  # the loader's words


def plain_file(path: str | Path, instead: str = "name the file in it") -> os.stat_result:
    """What the system says of a plain file. InputProblem where the path is anything else; instead: of a folder."""
    try:
        found = os.stat(path)
    except OSError as problem:
        what, do = _SAID.get(problem.errno or 0, (f"cannot be read ({problem.strerror})", "check the path and its permissions"))
        raise InputProblem(path, what, do) from None
    except ValueError:  # a NUL, or half a character
        raise InputProblem(repr(str(path)), "is no name of a file", "check the path") from None
    if stat.S_ISDIR(found.st_mode):
        raise InputProblem(path, "is a folder", instead)
    if not stat.S_ISREG(found.st_mode):
        raise InputProblem(path, "is a pipe or a device, no file", "name a file")
    return found


def typed(text: str) -> None:
    """InputProblem where a text typed as an input can be no file that is read: too long, a circle, a pipe or a device.

    A name that is no file at all may be that of a shipped scenario, a machine or an effect.
    """
    try:
        found = os.stat(text).st_mode
    except OSError as problem:
        if problem.errno in (errno.ELOOP, errno.ENAMETOOLONG):
            raise InputProblem(text, *_SAID[problem.errno]) from None
        return
    except ValueError:
        return
    if not (stat.S_ISREG(found) or stat.S_ISDIR(found)):
        plain_file(text)


def content(path: str | Path, most: int, do: str) -> bytes:
    """All bytes of a plain file of at most so many; do: what to do about one that is larger. InputProblem."""
    if plain_file(path).st_size > most:
        raise InputProblem(path, f"is larger than {most / 1e6:g} MB", do)
    with readable(path), open(path, "rb") as file:
        return file.read(most)


def room(path: str | Path, size: float) -> None:
    """InputProblem where the memory to read a file, `size` bytes, is more than is free."""
    free = free_memory()
    if size > free:
        raise InputProblem(path, f"needs {size / 1e9:.2g} GB of memory, {free / 1e9:.2g} GB are free",
                           "free some, or give a shorter record")


def free_memory() -> float:
    """Bytes that the system still gives to this process; infinite where it does not say."""
    free = math.inf
    with suppress(OSError, ValueError, LookupError, ImportError):
        import resource

        facts = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
        free = 1024.0 * int(facts["MemAvailable"].split()[0])
        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            free = max(0.0, min(free, limit - taken))
    return free


def is_shortage(problem: BaseException | None) -> bool:
    """Whether memory was short, whatever a library, or the loading of one, made of that."""
    while problem is not None:
        unloaded = isinstance(problem, (ImportError, OSError)) and any(said in str(problem) for said in _UNLOADED)
        if unloaded or isinstance(problem, MemoryError) or (isinstance(problem, OSError) and problem.errno == errno.ENOMEM):
            return True
        problem = problem.__cause__ or problem.__context__
    return False


@contextmanager
def readable(path: str | Path, kind: str = "", do: str = "save it again") -> Iterator[None]:
    """Within it, whatever goes wrong is the file's fault: InputProblem. kind: of file, such as `a WAV file`."""
    try:
        yield
    except (InputProblem, MemoryError):
        raise
    except PermissionError as problem:
        raise InputProblem(path, f"cannot be read ({problem.strerror})", "check its permissions") from None
    except Exception as problem:  # a library that is given a damaged file raises anything
        if is_shortage(problem):
            raise MemoryError from problem
        said = (str(problem).splitlines() or [""])[0][:80]
        raise InputProblem(path, f"not readable{' as ' if kind else ''}{kind} ({type(problem).__name__}: {said})", do) from None
