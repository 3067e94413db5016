"""Work that is independent, on threads: the engine and linear algebra let go of the interpreter."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

WORKERS = max(2, min(8, os.cpu_count() or 1))
Item = TypeVar("Item")
Result = TypeVar("Result")


def threaded(function: Callable[[Item], Result], items: Iterable[Item]) -> tuple[Result, ...]:
    """The function of every item, in their order. Each is computed alone, so that the number of threads changes no digit."""
    with ThreadPoolExecutor(WORKERS) as pool:
        return tuple(pool.map(function, items))
