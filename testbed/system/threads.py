"""Work that is independent, on threads: engines, linear algebra and files let go of the interpreter.

Ctrl-C may strike the thread that asks at any line. `concurrent.futures` and `threading` take locks in Python; struck between
taking one and knowing of it, they leave it taken, and who waits for it waits for ever. So the thread that asks touches nothing
but `SimpleQueue` and plain attributes, each of which is one step of the interpreter, and starts threads without `threading`,
whose own start waits on such a lock.
"""

from __future__ import annotations

import _thread
import os
import threading
from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from queue import SimpleQueue
from typing import Any, Generic, TypeVar

WORKERS = max(2, min(8, os.cpu_count() or 1))
Item = TypeVar("Item")
Result = TypeVar("Result")
_here = threading.local()  # .stop: of the outermost call that this thread works for


class Stopped(BaseException):
    """The work that this was part of was given up, by Ctrl-C or since another part failed."""


class Stop:
    """Tells work on other threads that it is given up."""

    now = False


class _Crew(Generic[Item, Result]):
    """Threads, at most `workers`, that take items and give back (place, result, fault)."""

    def __init__(self, function: Callable[[Item], Result], workers: int, stop: Stop) -> None:
        self.function, self.workers, self.stop = function, workers, stop
        self.items: SimpleQueue[tuple[int, Item] | None] = SimpleQueue()
        self.done: SimpleQueue[tuple[int, Result | None, BaseException | None]] = SimpleQueue()
        self.ended: SimpleQueue[None] = SimpleQueue()
        self.started = 0

    def give(self, place: int, item: Item) -> None:
        self.items.put((place, item))
        if self.started < self.workers:
            _thread.start_new_thread(self._serve, ())
            self.started += 1

    def end(self) -> None:
        """Have the threads end after what each is at, and wait for that."""
        self.stop.now = True
        for _ in range(self.workers):  # one may have been started, and not counted
            self.items.put(None)
        for _ in range(self.started):
            self.ended.get()

    def _serve(self) -> None:
        while not self.stop.now and (given := self.items.get()) is not None:
            place, item = given
            try:
                self.done.put((place, self.function(item), None))
            except BaseException as fault:  # whatever it is, the thread that asks is to hear of it
                self.done.put((place, None, fault))
        self.ended.put(None)


def as_done(function: Callable[[Item], Result], items: Iterable[Item], workers: int, ahead: int,
            stop: Stop) -> Generator[tuple[int, Result | None, BaseException | None], None, None]:
    """(place, result, what was raised) of every item, as it is ready.

    ahead: items taken before they are needed, of which `workers` are under way. stop: set once this is given up.
    """
    crew = _Crew(function, workers, stop)
    coming = enumerate(items)
    under_way = 0
    try:
        while True:
            while under_way < ahead and (given := next(coming, None)) is not None:
                crew.give(*given)
                under_way += 1
            if not under_way:
                return
            found = crew.done.get()
            under_way -= 1
            yield found
    finally:
        crew.end()


def in_order(function: Callable[[Item], Result], items: Iterable[Item], workers: int, ahead: int,
             stop: Stop | None = None) -> Generator[Result, None, None]:
    """The results in the order of the items. What an item raises is raised in its turn; what comes after it is given up."""
    yield from ordered(as_done(function, items, workers, ahead, stop or Stop()))


def ordered(done: Generator[tuple[int, Result | None, BaseException | None], None, None]) -> Generator[Result, None, None]:
    """The results of `as_done` in the order of the items; what an item raised is raised in its turn."""
    early: dict[int, tuple[Any, BaseException | None]] = {}
    wanted = 0
    with closing(done):
        for place, found, problem in done:
            early[place] = found, problem
            while wanted in early:
                result, fault = early.pop(wanted)
                if fault is not None:
                    raise fault
                wanted += 1
                yield result


def threaded(function: Callable[[Item], Result], items: Iterable[Item]) -> tuple[Result, ...]:
    """The function of every item, in their order. Each is computed alone, so that the number of threads changes no digit.

    Such work may hold more of the kind; where the outermost is interrupted or fails, what is inside ends at its next item.
    """
    outer: Stop | None = getattr(_here, "stop", None)
    top = outer or Stop()

    def one(item: Item) -> Result:
        if top.now:
            raise Stopped
        _here.stop = top
        try:
            return function(item)
        finally:
            del _here.stop

    all_of_them = tuple(items)
    with closing(in_order(one, all_of_them, WORKERS, len(all_of_them), None if outer else top)) as results:
        return tuple(results)
