"""Work that is independent, on threads: the engine and linear algebra let go of the interpreter."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

WORKERS = max(2, min(8, os.cpu_count() or 1))
Item = TypeVar("Item")
Result = TypeVar("Result")
_here = threading.local()  # .stop: set once the outermost call that this thread works for is given up


class Stopped(BaseException):
    """The work that this was part of was given up, by Ctrl-C or since another part failed."""


def threaded(function: Callable[[Item], Result], items: Iterable[Item]) -> tuple[Result, ...]:
    """The function of every item, in their order. Each is computed alone, so that the number of threads changes no digit.

    Such work may hold more of the kind; where the outermost is interrupted or fails, what is inside ends at its next item.
    """
    outer = getattr(_here, "stop", None)
    stop = outer or threading.Event()

    def one(item: Item) -> Result:
        if stop.is_set():
            raise Stopped
        _here.stop = stop
        try:
            return function(item)
        finally:
            del _here.stop

    with ThreadPoolExecutor(WORKERS) as pool:
        try:
            return tuple(pool.map(one, items))
        except BaseException:
            if outer is None:
                stop.set()
            raise
