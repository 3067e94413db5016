"""Ctrl-C that is not lost: the interpreter drops an exception raised where nothing can hand it on.

HDF5 calls back into Python while it writes, and finalisers run anywhere; a KeyboardInterrupt that strikes there is printed
at best, and the program goes on.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def remembered_interruptions() -> Iterator[Callable[[], None]]:
    """Within it a signal that raises KeyboardInterrupt is remembered, too; what it gives raises that if one has come.

    What the interpreter drops is not printed either: it is not lost, and the trace would alarm. Only the main thread is told of
    signals; in another one, and for signals handled otherwise, nothing is changed.
    """
    came: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        came.append(number)
        signal.default_int_handler(number, frame)

    def check() -> None:
        if came:
            raise KeyboardInterrupt

    before = sys.unraisablehook

    def dropped(unraisable: sys.UnraisableHookArgs) -> None:
        if not (came and unraisable.exc_type is KeyboardInterrupt):
            before(unraisable)

    main = threading.current_thread() is threading.main_thread()
    ours = [one for one in _SIGNALS if main and signal.getsignal(one) is signal.default_int_handler]
    for one in ours:
        signal.signal(one, handle)
    if ours:
        sys.unraisablehook = dropped
    try:
        yield check
    finally:
        if ours:
            sys.unraisablehook = before
        for one in ours:
            signal.signal(one, signal.default_int_handler)
