"""Workers for a sweep's batches: none, threads, or processes that may die without taking the sweep along."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from testbed.batch import Batch, Simulate, compute, write_crashed
from testbed.data_set import read_data_set
from testbed.store import write_data_set


def work(batches: list[Batch], simulate: Simulate, workers: int, processes: bool) -> Iterator[Batch]:
    """Compute batches, giving each as its shard is written, in any order. KeyboardInterrupt passes through at once."""
    if workers <= 1 and not processes:
        for batch in batches:
            compute(batch, simulate)
            yield batch
    elif processes:
        yield from _in_processes(batches, simulate, workers)
    else:
        yield from _in_threads(batches, simulate, workers)


def _in_threads(batches: list[Batch], simulate: Simulate, workers: int) -> Iterator[Batch]:
    stop = threading.Event()
    pool = ThreadPoolExecutor(workers)
    try:
        for batch, future in _submitted(pool, batches, simulate, workers, stop):
            future.result()
            yield batch
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def _submitted(pool: Executor, batches: list[Batch], simulate: Simulate, workers: int,
               *more: object) -> Iterator[tuple[Batch, Future]]:
    """Batches with their finished futures; only a few are handed out ahead of the workers."""
    running: dict[Future, Batch] = {}
    ahead = iter(batches)
    while True:
        while len(running) < 2 * workers and (batch := next(ahead, None)) is not None:
            running[pool.submit(compute, batch, simulate, *more)] = batch
        if not running:
            return
        finished, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in finished:
            yield running.pop(future), future


def _ignore_interrupts() -> None:
    """Ctrl-C reaches every process of a terminal; only the first is to answer it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _process_pool(workers: int) -> ProcessPoolExecutor:
    # spawn: a forked process would share the engines' compiled state and the HDF5 library's locks.
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_ignore_interrupts)


def _in_processes(batches: list[Batch], simulate: Simulate, workers: int) -> Iterator[Batch]:
    pool = _process_pool(workers)
    try:
        for batch, future in _submitted(pool, batches, simulate, workers):
            future.result()
            yield batch
    except BrokenProcessPool:
        _end(pool)
        # A worker died. Which batch killed it is unknown: the rest is done one at a time, each watched.
        for batch in batches:
            if not batch.shard.exists():
                _alone(batch, simulate)
                yield batch
    finally:
        _end(pool)


def _alone(batch: Batch, simulate: Simulate) -> None:
    """Compute a batch in a process of its own; where that dies, halve it until the runs that crash are found."""
    pool = _process_pool(1)
    try:
        pool.submit(compute, batch, simulate).result()
        return
    except BrokenProcessPool:
        pass
    finally:
        _end(pool)
    if len(batch) == 1:
        write_crashed(batch)
        return
    middle = (batch.first + batch.last) // 2
    halves = [batch.part(batch.first, middle), batch.part(middle, batch.last)]
    for half in halves:
        _alone(half, simulate)
    rows = ((batch.scenario.run(index), recording) for half in halves
            for index, recording in zip(range(half.first, half.last), read_data_set(half.shard), strict=True))
    write_data_set(batch.shard, batch.header, rows, len(batch), batch.scenario.longest())
    for half in halves:
        half.shard.unlink()


def _end(pool: ProcessPoolExecutor) -> None:
    """End a pool without waiting for what it still computes; a shard is whole or not there."""
    for process in list((pool._processes or {}).values()):
        process.terminate()
    pool.shutdown(cancel_futures=True)
