"""Compiled functions, kept on disk in one folder that is the user's own, so that the next start compiles nothing.

What is read from it runs as machine code. So the folder must belong to the user and be closed to others, or it is not read
at all; and every file begins with a hash of the rest, so that a damaged one is noticed and made again instead of run.
"""

from __future__ import annotations

import os
import pickle
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

_MARK = b"testbed1"  # changes with the form of the files
_HEAD_BYTES = len(_MARK) + sha256().digest_size
_said: set[str] = set()


def say_once(text: str) -> None:
    """A line on standard error, however often a process comes to it."""
    if text not in _said:
        _said.add(text)
        print(f"note: {text}", file=sys.stderr)


def _user() -> int:
    return os.geteuid() if hasattr(os, "geteuid") else 0  # Windows: a user's folders are private without asking


def _roots() -> Iterator[tuple[Path, bool]]:
    """(where the folder may lie, whether the user chose it), the best first."""
    if chosen := os.environ.get("TESTBED_CACHE"):
        yield Path(chosen).absolute(), True
    if general := os.environ.get("XDG_CACHE_HOME"):
        yield Path(general).absolute() / "testbed", False
    home = Path(os.path.expanduser("~"))  # Path.home raises for a user without one
    if home.is_absolute() and home.is_dir() and home != home.parent:  # an empty HOME is the root
        yield home / ".cache" / "testbed", False
    try:
        yield Path(tempfile.gettempdir()).absolute(), False
    except FileNotFoundError:  # no place to write to at all
        return


def fault_of(folder: Path) -> str:
    """Why a folder cannot hold code that is going to be run; empty where it can. It is made if it is not there."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
        if stat.S_ISLNK(found.st_mode):
            return "is a link"
        if os.name == "posix":
            above = folder.parent.stat().st_mode
            if found.st_uid != _user():
                return "belongs to another user"
            if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
                return "can be written by other users"
            if above & stat.S_IWOTH and not above & stat.S_ISVTX:
                return "lies where other users can put another in its place"
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as problem:
        return f"cannot be written ({problem.strerror})"


@lru_cache(maxsize=1)
def cache_folder() -> Path | None:
    """Where compiled functions are kept: below TESTBED_CACHE, the user's cache folder, or the one for temporary files.

    None where there is no place that other users cannot write to; then nothing is kept.
    """
    for root, chosen in _roots():
        folder = root / f"testbed-kernels-{_user()}"
        fault = fault_of(folder)
        if not fault:
            return folder
        if chosen or fault.startswith(("is", "belongs", "can be", "lies")):
            say_once(f"{folder}: {fault}: not used for compiled functions")
    return None


def kept_bytes(folder: Path) -> int:
    """How much lies in the folder."""
    return sum(path.stat().st_size for path in folder.glob("*") if path.is_file())


def lodge_matplotlib() -> None:
    """A place for the list of fonts that matplotlib makes, for a user without a home. Before it is imported: it would warn."""
    if "MPLCONFIGDIR" not in os.environ and (folder := cache_folder()):
        os.environ["MPLCONFIGDIR"] = str(folder / "matplotlib")


def _head(name: str, body: bytes) -> bytes:
    return _MARK + sha256(name.encode() + b"\0" + body).digest()


def read(name: str) -> bytes | None:
    """What was kept under a name; None where nothing was, or where it is damaged, which is said and removed."""
    folder = cache_folder()
    if folder is None:
        return None
    path = folder / name
    if not os.path.lexists(path):
        return None
    try:
        text = path.read_bytes() if path.is_file() else b""
    except OSError:  # it cannot be read: made anew below
        text = b""
    head, body = text[:_HEAD_BYTES], text[_HEAD_BYTES:]
    if head == _head(name, body):
        return body
    with suppress(OSError):
        path.unlink()  # of several processes one succeeds, and says it
        say_once(f"{folder}: a compiled function was damaged: it is made again")
    return None


def keep(name: str, body: bytes) -> None:
    """Keep bytes under a name, whole or not at all. A full or closed disk costs the next start its time, nothing else."""
    folder = cache_folder()
    if folder is None:
        return
    try:
        handle, temporary = tempfile.mkstemp(dir=folder, suffix=".part")
        try:
            with open(handle, "wb") as file:
                file.write(_head(name, body) + body)
            os.replace(temporary, folder / name)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as problem:
        say_once(f"{folder}: compiled functions cannot be kept ({problem.strerror}): the next start takes longer")


@cache
def _sources(folder: Path) -> bytes:
    """A hash of every source beside a function's own: what it calls, and the numbers it takes, are compiled into it."""
    digest = sha256()
    for path in sorted(folder.glob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.digest()


class _Kept:
    """What numba asks for compiled code and hands it to. One file for each function, its arguments' types and processor."""

    cache_path = None

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function

    def _name(self, signature: Any, codegen: Any) -> str:
        import numba
        import numpy

        code = self.function.__code__
        # a composed module bears a hash of its whole text and all that it was made with in its name
        made_of = b"" if code.co_filename.startswith("<") else _sources(Path(code.co_filename).parent)
        stamp = (made_of, code.co_filename, code.co_firstlineno, code.co_code, str(signature), codegen.magic_tuple(),
                 numba.__version__, numpy.__version__, sys.version)
        return f"{self.function.__name__}-{sha256(repr(stamp).encode()).hexdigest()[:32]}.kernel"

    def load_overload(self, signature: Any, context: Any) -> Any:
        """The compile result that was kept for these types; None where there is none."""
        from numba.core.compiler import CompileResult

        context.refresh()
        body = read(self._name(signature, context.codegen()))
        return None if body is None else CompileResult._rebuild(context, *pickle.loads(body))

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep what was compiled, unless it holds addresses of this process."""
        from numba.core.serialize import dumps

        if not result.library.has_dynamic_globals and all(one.can_cache for one in result.lifted):
            keep(self._name(signature, result.codegen), dumps(result._reduce()))

    def enable(self) -> None:
        """Part of what numba may call."""

    disable = flush = enable


def _apart(flags: Any) -> Any:
    flags.noalias = True
    return flags


def kept(function: Any = None, *, noalias: bool = False, **options: Any) -> Any:
    """As numba's njit(cache=True), into the one folder above. Every compiled function that Python calls is made by it.

    noalias: no array that is written overlaps another argument, which lets loops run in vector registers. Numba has the flag
    but no option for it: where a later one drops it, such loops are slower and give the same.
    """
    from numba import njit

    if function is None:
        return lambda function: kept(function, noalias=noalias, **options)
    dispatcher = njit(function, **options)
    if noalias:
        dispatcher._compiler._customize_flags = _apart
    dispatcher._cache = _Kept(function)
    return dispatcher
