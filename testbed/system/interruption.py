"""Signals, in one place. Ctrl-C, SIGTERM (a queue's time is up) and SIGHUP (the terminal is gone) end a command the same way.

The first raises KeyboardInterrupt, so that what is finished is kept, and ends in one line and exit code 130. One more, later
than a moment, ends at once: the interpreter is not taken down step by step, which threads in compiled code do not survive.

The interpreter drops an exception raised where nothing can hand it on: HDF5 calls back into Python while it writes, numba
while it compiles, and finalisers run anywhere. A KeyboardInterrupt that strikes there is raised once more.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn

INTERRUPTED = 130
SAME_PRESS_S = 1.0  # a parent (make, uv) may pass on the Ctrl-C that the terminal sent to all: that is one
RETRY_S = 0.02
_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

unfinished: set[str] = set()  # files under a temporary name, which an end at once removes


class _State:
    """What has come so far. `code`: of a command that is done, whose end a signal can only hasten."""

    def __init__(self) -> None:
        self.since: float | None = None
        self.dropped = self.here = self.said = False  # here: where a drop is dealt with, and one more would be lost
        self.code: int | None = None


_state = _State()


def interrupted() -> bool:
    """Whether a signal has come that ends this command."""
    return _state.since is not None


def _strike(number: int, frame: FrameType | None) -> None:
    if _state.code is not None:
        os._exit(_state.code)
    if _state.since is None:
        _state.since = time.monotonic()
    elif _state.dropped:
        if _state.here:
            return
        _state.dropped, _state.since = False, time.monotonic()
    elif time.monotonic() - _state.since > SAME_PRESS_S:
        _end_at_once()
    else:
        return
    raise KeyboardInterrupt


def _again() -> None:
    """Raise it once more, until it could be."""
    time.sleep(RETRY_S)
    while _state.dropped:
        _thread.interrupt_main()
        time.sleep(RETRY_S)


def listen() -> Callable[[], None]:
    """Have the signals answered as above; what it gives puts everything back. What is ignored (nohup) stays so.

    Only the main thread is told of signals; in another one nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread():
        return lambda: None
    before = {one: signal.getsignal(one) for one in _SIGNALS}
    ours = [one for one, handler in before.items() if handler in (signal.SIG_DFL, signal.default_int_handler)]
    hook = sys.unraisablehook

    def dropped(unraisable: Any) -> None:
        if _state.since is None or unraisable.exc_type is not KeyboardInterrupt:
            hook(unraisable)
            return
        _state.here = True
        _state.dropped = True
        _thread.start_new_thread(_again, ())  # threading's own would wait here until it has begun
        _state.here = False

    def restore() -> None:
        sys.unraisablehook = hook
        for one in ours:
            signal.signal(one, before[one])
        _state.__init__()  # type: ignore[misc]

    if ours:
        sys.unraisablehook = dropped
    for one in ours:
        signal.signal(one, _strike)
    return restore if ours else lambda: None


def say_interrupted(text: str) -> None:
    """The one line, on standard error, which may be gone with its terminal."""
    _state.said = True
    with suppress(OSError, ValueError):
        print(f"interrupted: {text}" if text else "interrupted", file=sys.stderr, flush=True)


def _end_at_once() -> NoReturn:
    for name in list(unfinished):
        with suppress(OSError):
            os.unlink(name)
    if not _state.said:
        with suppress(OSError):  # not by sys.stderr, which may be in the middle of a line
            os.write(2, b"\x1b[?25h\ninterrupted\n" if os.isatty(2) else b"interrupted\n")  # a bar has hidden the cursor
    _exit(INTERRUPTED)


def _exit(code: int) -> NoReturn:
    """Without the interpreter's own end, which waits for threads."""
    if "multiprocessing" in sys.modules:
        import multiprocessing

        for worker in multiprocessing.active_children():
            worker.kill()
    os._exit(code)


def leave(code: int) -> NoReturn:
    """The end of a process whose command is done: a signal that comes now changes nothing."""
    _state.code = code
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):  # the reader, such as `head`, has seen enough
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    if code == INTERRUPTED:
        _exit(code)
    sys.exit(code)


def deaf() -> None:
    """For a worker process: Ctrl-C reaches every process of a terminal; only the first is to answer it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def deaf_from_birth() -> Iterator[None]:
    """Worker processes started within it do not hear Ctrl-C even while they start, before they could say so themselves."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # its start would let the signal through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def remembered_interruptions() -> Iterator[Callable[[], None]]:
    """Within it a signal that raises KeyboardInterrupt is remembered, too; what it gives raises that if one has come.

    What the interpreter drops is not printed either: it is not lost, and the trace would alarm. Only the main thread is told of
    signals; in another one, and for signals handled otherwise, nothing is changed.
    """
    came: list[int] = []
    before = sys.unraisablehook
    main = threading.current_thread() is threading.main_thread()
    raising = (signal.default_int_handler, _strike)
    ours = {one: handler for one in _SIGNALS if main and (handler := signal.getsignal(one)) in raising}

    def handle(number: int, frame: FrameType | None) -> None:
        came.append(number)
        ours[signal.Signals(number)](number, frame)  # type: ignore[operator, misc]

    def check() -> None:
        if came:
            raise KeyboardInterrupt

    def dropped(unraisable: Any) -> None:
        if not (came and unraisable.exc_type is KeyboardInterrupt):
            before(unraisable)

    for one in ours:
        signal.signal(one, handle)
    if ours:
        sys.unraisablehook = dropped
    try:
        yield check
    finally:
        if ours:
            sys.unraisablehook = before
        for one, handler in ours.items():
            signal.signal(one, handler)
