"""Ctrl-C that is not lost: the interpreter drops an exception raised where nothing can hand it on.

HDF5 calls back into Python while it writes, and finalisers run anywhere; a KeyboardInterrupt that strikes there is printed
at best, and the program goes on.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def remembered_interruptions() -> Iterator[Callable[[], None]]:
    """Within it a signal that raises KeyboardInterrupt is remembered, too; what it gives raises that if one has come.

    Only the main thread is told of signals; in another one, and for signals handled otherwise, nothing is changed.
    """
    came: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        came.append(number)
        signal.default_int_handler(number, frame)

    def check() -> None:
        if came:
            raise KeyboardInterrupt

    main = threading.current_thread() is threading.main_thread()
    ours = [one for one in _SIGNALS if main and signal.getsignal(one) is signal.default_int_handler]
    for one in ours:
        signal.signal(one, handle)
    try:
        yield check
    finally:
        for one in ours:
            signal.signal(one, signal.default_int_handler)
