"""Work that is independent, in processes: each loads what it needs once, and keeps its own compiled state.

A thread of its own talks to each process, for the reason that `threads` gives: the thread that asks takes no lock of Python's.
"""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from multiprocessing.connection import Connection
from typing import Any

from testbed.system.interruption import deaf, deaf_from_birth
from testbed.system.threads import Stop, Stopped, as_done


class WorkerDied(RuntimeError):
    """A process ended in the midst of its work: out of memory, or killed."""


def as_done_in_processes(function: Callable[[Any], Any], items: Iterable[Any], workers: int,
                         begin: Callable[[], None] | None = None
                         ) -> Generator[tuple[int, Any, BaseException | None], None, None]:  # fmt: skip
    """(place, result, what was raised) of every item, as it is ready; WorkerDied is raised for an item whose process died.

    function, begin: what pickles; begin is called once in every process before its first item. Processes end with this.
    """
    alive: list[_Worker] = []
    own, stop = threading.local(), Stop()

    def answer(item: Any) -> Any:
        if not hasattr(own, "worker"):
            own.worker = _Worker(function, begin)
            alive.append(own.worker)
        if stop.now:
            own.worker.end()
            raise Stopped
        return own.worker.answer(item)

    with closing(as_done(answer, items, workers, workers + 1, stop)) as done:
        try:
            for one in done:  # noqa: UP028 - `yield from` would close it, and wait, before the processes are ended
                yield one
        finally:
            stop.now = True
            for worker in alive:  # threads that wait for an answer hear of it
                worker.end()


class _Worker:
    """A process and the line to it."""

    def __init__(self, function: Callable[[Any], Any], begin: Callable[[], None] | None) -> None:
        context = multiprocessing.get_context("spawn")  # a forked process would share the engines' compiled state
        self.line, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, function, begin), daemon=True)
        with deaf_from_birth():
            self.process.start()
        theirs.close()

    def answer(self, item: Any) -> Any:
        try:
            self.line.send(item)
            result, fault = self.line.recv()
        except (EOFError, OSError):
            raise WorkerDied("a worker process died") from None
        if fault is not None:
            raise fault
        return result

    def end(self) -> None:
        self.process.kill()
        self.process.join()


def _serve(line: Connection, function: Callable[[Any], Any], begin: Callable[[], None] | None) -> None:
    deaf()
    begun = begin is None
    try:
        while True:
            item = line.recv()
            try:
                if not begun and begin is not None:
                    begin()
                    begun = True
                answer: tuple[Any, Exception | None] = function(item), None
            except Exception as fault:  # whatever it is, the process that asks is to hear of it
                answer = None, fault
            line.send(answer)
    except (EOFError, OSError):  # the process that asks is gone
        return
