"""Workers for a sweep's batches: none, threads, or processes that may die or hang without taking the sweep along.

After its first batch a worker has loaded all it needs. That is set aside (`gc.freeze`): to look it through for garbage again
and again took a tenth of a sweep's time. What runs leave is freed at once, being in no circle, so that rings of it are looked
for more seldom than Python does.
"""

from __future__ import annotations

import gc
import multiprocessing
import time
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import closing
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for
from typing import Any

from testbed.sweeps.batch import Job, compute, write_failed
from testbed.sweeps.shards import Span, Spans, shard_path
from testbed.system.interruption import deaf, deaf_from_birth
from testbed.system.memory_file import release
from testbed.system.threads import Stop, as_done

STALL = 600.0       # s without a run begun or ended, after which a worker is taken for hung
DEATHS_OF_A_RUN = 3  # a run that was under way alone so often when its process died is `crashed`
_SELDOM = 20_000    # objects more than were freed, after which rings are looked for; Python: 700
_STILLBORN = 10     # workers in a row that die before they are ready: nothing will come of it


def work(job: Job, spans: Sequence[Span], workers: int, processes: bool, stall: float = STALL) -> Spans:
    """Compute spans of runs, giving each as its shard is written, in any order and perhaps in smaller pieces.

    stall: seconds after which a process that shows no progress is ended. KeyboardInterrupt passes through at once.
    """
    if processes:
        yield from _Processes(job, spans, stall).run(max(1, workers))
        return
    settled, usual = False, gc.get_threshold()
    gc.set_threshold(_SELDOM, *usual[1:])
    try:
        with closing(_in_turn(job, spans) if workers <= 1 else _in_threads(job, spans, workers)) as done:
            for span in done:
                if not settled:
                    gc.freeze()
                    settled = True
                yield span
    finally:
        gc.unfreeze()
        gc.set_threshold(*usual)
        release()


def _in_turn(job: Job, spans: Sequence[Span]) -> Spans:
    for span in spans:
        compute(job, span[0], span[1])
        yield span


def _in_threads(job: Job, spans: Sequence[Span], workers: int) -> Spans:
    stop = Stop()

    def tell(_: int) -> None:
        if stop.now:
            raise KeyboardInterrupt

    with closing(as_done(lambda span: compute(job, span[0], span[1], tell), spans, workers, workers + 1, stop)) as done:
        for place, _, fault in done:
            if fault is not None:
                raise fault
            yield spans[place]


def _serve(connection: Connection, job: Job, place: Any) -> None:
    """A worker process: spans come in, `None` goes back for each that is done, an exception for one that is not."""
    deaf()

    def tell(index: int) -> None:
        place[0] = index

    try:
        gc.set_threshold(_SELDOM, *gc.get_threshold()[1:])
        connection.send("ready")
        settled = False
        while (span := connection.recv()) is not None:
            try:
                compute(job, span[0], span[1], tell, together=False)  # a run that kills or hangs is to be known
                if not settled:
                    gc.freeze()
                    settled = True
            except Exception as fault:  # whatever it is, the sweep's own process is to hear of it
                connection.send(fault)
            else:
                connection.send(None)
    except (EOFError, BrokenPipeError, ConnectionResetError):  # the sweep's own process is gone
        return


class _Worker:
    """A process, the span it is at, and the run it has begun, which it writes where both can see it."""

    def __init__(self, job: Job) -> None:
        # spawn: a forked process would share the engines' compiled state and the HDF5 library's locks.
        context = multiprocessing.get_context("spawn")
        self.place = context.RawArray("q", [-1])
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, job, self.place), daemon=True)
        with deaf_from_birth():
            self.process.start()
        theirs.close()
        self.ready = False
        self.span: Span | None = None
        self.seen, self.since = -1, time.monotonic()

    def begin(self, span: Span) -> None:
        self.span, self.place[0] = span, span[0]
        self.seen, self.since = span[0], time.monotonic()
        self.connection.send(span)

    def hangs(self, stall: float) -> bool:
        """True where a run has been under way for longer than `stall` seconds."""
        if self.span is None or self.place[0] != self.seen:
            self.seen, self.since = self.place[0], time.monotonic()
            return False
        return time.monotonic() - self.since > stall

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.connection.close()


class _Processes:
    """Worker processes. A span whose worker dies is tried once more, then divided about the run that was under way."""

    def __init__(self, job: Job, spans: Sequence[Span], stall: float) -> None:
        self.job, self.stall = job, stall
        self.waiting = deque(spans)
        self.deaths: Counter[Span] = Counter()
        self.stalls: Counter[Span] = Counter()
        self.stillborn = 0

    def run(self, count: int) -> Spans:
        workers: list[_Worker] = []
        try:
            while self.waiting or any(worker.span for worker in workers):
                while len(workers) < min(count, len(self.waiting) + sum(worker.span is not None for worker in workers)):
                    workers.append(_Worker(self.job))
                for worker in workers:
                    if worker.ready and worker.span is None and self.waiting:
                        self._begin(worker)
                wait_for([item for worker in workers for item in (worker.connection, worker.process.sentinel)],
                         min(1.0, self.stall / 4))
                for worker in list(workers):
                    finished, alive = self._heard(worker)
                    if not alive:
                        worker.end()
                        workers.remove(worker)
                    if finished is not None:
                        yield finished
        finally:
            for worker in workers:
                worker.end()
            for path in self.job.parts.glob(".*.part"):  # what a killed worker was writing
                path.unlink(missing_ok=True)

    def _begin(self, worker: _Worker) -> None:
        span = self.waiting.popleft()
        try:
            worker.begin(span)
        except OSError:  # it died just now; its end is dealt with when it is heard of
            worker.span = None
            self.waiting.appendleft(span)

    def _heard(self, worker: _Worker) -> tuple[Span | None, bool]:
        """(span that is done, whether the worker goes on) after whatever it has said, or that it died or hangs."""
        try:
            if worker.connection.poll():
                said = worker.connection.recv()
                if isinstance(said, BaseException):
                    raise said
                if said == "ready":
                    worker.ready, self.stillborn = True, 0
                    return None, True
                done, worker.span = worker.span, None
                return done, True
        except (EOFError, ConnectionResetError):
            return self._died(worker), False
        if not worker.process.is_alive() and not worker.connection.poll():
            return self._died(worker), False
        if worker.hangs(self.stall):
            return self._hung(worker), False
        return None, True

    def _died(self, worker: _Worker) -> Span | None:
        if not worker.ready:
            self.stillborn += 1
            if self.stillborn > _STILLBORN:
                raise RuntimeError("worker processes die before they begin; try without --processes")
        span = worker.span
        if span is None:
            return None
        if shard_path(self.job.parts, *span).exists():  # it died after it wrote
            return span
        self.deaths[span] += 1
        if span[1] - span[0] == 1:
            if self.deaths[span] >= DEATHS_OF_A_RUN:
                write_failed(self.job, span[0], "crashed")
                return span
            self.waiting.appendleft(span)
        elif self.deaths[span] == 1:  # most deaths have nothing to do with the runs: a full memory, an operator
            self.waiting.appendleft(span)
        else:
            self.waiting.extendleft(reversed(divided(span, int(worker.place[0]))))
        return None

    def _hung(self, worker: _Worker) -> Span | None:
        span = worker.span
        assert span is not None
        at = int(worker.place[0])
        if span == (at, at + 1):
            self.stalls[span] += 1
            if self.stalls[span] >= 2:
                write_failed(self.job, at, "limit")
                return span
            self.waiting.appendleft(span)
        else:
            self.waiting.extendleft(reversed(divided(span, at)))
        return None


def divided(span: Span, at: int) -> list[Span]:
    """A span in pieces: before the run `at` that was under way, that run, and after it; halves where none was."""
    first, last = span
    if not first <= at < last:
        middle = (first + last) // 2
        return [(first, middle), (middle, last)]
    return [(low, high) for low, high in ((first, at), (at, at + 1), (at + 1, last)) if low < high]
