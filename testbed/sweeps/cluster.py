"""Batches of a sweep on many machines, by dask.distributed (an extra: `pip install "machining-testbed[cluster]"`).

Workers write shards into one folder that all machines see; what is done is what stands there, not what a scheduler
remembers. Tasks are handed out a few ahead of the workers, so that a million runs are no million tasks.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from testbed.files.yaml_text import Document, Strict, load, validate
from testbed.problem import InputProblem
from testbed.sweeps.batch import Job, compute, write_failed
from testbed.sweeps.pool import DEATHS_OF_A_RUN
from testbed.sweeps.shards import Span, Spans, shard_path

if TYPE_CHECKING:
    from distributed import Client

AHEAD = 3          # tasks a worker thread may have waiting
VISIBLE_AFTER = 60.0  # s; a network file system may show a file that much later
_INSTALL = 'pip install "machining-testbed[cluster]"'
_QUEUES = {"slurm": "SLURMCluster", "pbs": "PBSCluster", "lsf": "LSFCluster", "sge": "SGECluster", "oar": "OARCluster",
           "htcondor": "HTCondorCluster", "moab": "MoabCluster"}


class _ClusterFile(Strict):
    kind: Literal["slurm", "pbs", "lsf", "sge", "oar", "htcondor", "moab", "local"]
    workers: Annotated[int, Field(ge=1)]
    options: dict[str, Any] = {}


@contextmanager
def on_cluster(address: str | None, cluster_file: str | Path | None) -> Iterator[Callable[[Job, list[Span]], Spans]]:
    """A function that computes a sweep's batches on a running scheduler, or on the cluster that a file describes.

    InputProblem where distributed is not installed, nobody answers at the address, or the file is wrong.
    """
    description = _described(load(cluster_file)) if cluster_file is not None else None
    try:
        import dask
        from distributed import Client
    except ImportError:
        raise InputProblem(address or cluster_file or "dask", "needs dask.distributed, which is not installed", _INSTALL) \
            from None
    dask.config.set(SETTINGS)
    with ExitStack() as stack:
        try:
            if description is not None:
                cluster = stack.enter_context(_started(description, cluster_file))
                client = stack.enter_context(Client(cluster))
            else:
                client = stack.enter_context(Client(address, timeout="20s"))
        except (OSError, ValueError, TimeoutError) as problem:
            raise InputProblem(address or cluster_file or "dask", f"no scheduler answers ({_first_line(problem)})",
                               "start `dask scheduler`, and give the address it prints") from None
        yield lambda job, spans: compute_on(client, job, spans)


SETTINGS = {
    "distributed.deploy.lost-worker-timeout": "30 days",  # after 15 s, the default, killed workers are lost for good
    "distributed.scheduler.allowed-failures": 0,  # the sweep itself tries again, in smaller pieces
    "distributed.worker.daemon": False,
    "distributed.comm.retry.count": 3,
}


def _described(document: Document) -> _ClusterFile:
    return validate(document, _ClusterFile)


def _started(given: _ClusterFile, path: object) -> Any:
    """The cluster of a file, its jobs asked for."""
    if given.kind == "local":
        from distributed import LocalCluster

        return LocalCluster(n_workers=given.workers, **({"dashboard_address": ":0"} | given.options))
    try:
        import dask_jobqueue
    except ImportError:
        raise InputProblem(path, f"kind {given.kind} needs dask-jobqueue, which is not installed",  # type: ignore[arg-type]
                           _INSTALL) from None
    try:
        cluster = getattr(dask_jobqueue, _QUEUES[given.kind])(**given.options)
    except (TypeError, ValueError) as problem:
        raise InputProblem(path, f"options: {_first_line(problem)}",  # type: ignore[arg-type]
                           "see the options of dask-jobqueue's class") from None
    cluster.scale(jobs=given.workers)
    return cluster


def _first_line(problem: BaseException) -> str:
    return (str(problem).splitlines() or [type(problem).__name__])[0]


def task(job: Job, first: int, last: int) -> Span:
    """What a worker of the cluster does: a batch, unless its shard stands there already."""
    if not shard_path(job.parts, first, last).exists():
        compute(job, first, last)
    return first, last


def compute_on(client: Client, job: Job, spans: list[Span]) -> Spans:
    """Compute spans of runs on a cluster, giving each as its shard is there.

    A span that takes its workers with it time and again is halved until the one run is found, which is `crashed`.
    """
    from distributed import as_completed
    from distributed.client import FutureCancelledError
    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    waiting = list(reversed(spans))
    deaths: dict[Span, int] = {}
    running: dict[Any, Span] = {}
    tries = 0
    done = as_completed()

    def hand_out() -> None:
        nonlocal tries
        most = AHEAD * max(1, sum(client.nthreads().values())) if waiting else 0
        if any(span in deaths for span in running.values()):
            return
        while waiting and len(running) < most:
            if running and waiting[-1] in deaths:
                return  # a suspect runs alone: a death is laid at the door of all that its worker had before it
            span = waiting.pop()
            tries += 1
            # A key of its own each time: a task that failed is not to be answered from the scheduler's memory.
            future = client.submit(task, job, *span, key=f"runs-{span[0]}-{span[1]}-{tries}-{os.getpid()}", pure=False)
            running[future.key] = span
            done.add(future)
            if span in deaths:
                return

    try:
        hand_out()
        while running:
            future = next(done)
            span = running.pop(future.key)
            fault = future.exception() if future.status == "error" else None
            if future.status == "finished" or shard_path(job.parts, *span).exists():  # or it died after it wrote
                _seen(job, span)
                yield span
            elif isinstance(fault, (KilledWorker, FutureCancelledError)) or future.status in ("cancelled", "lost"):
                if span[1] - span[0] > 1:
                    middle = (span[0] + span[1]) // 2
                    waiting += [(middle, span[1]), (span[0], middle)]
                    hand_out()
                    continue
                deaths[span] = deaths.get(span, 0) + 1
                if deaths[span] >= DEATHS_OF_A_RUN:
                    del deaths[span]
                    write_failed(job, span[0], "crashed")
                    yield span
                else:
                    waiting.append(span)
            elif fault is not None:
                raise fault
            hand_out()
    except CommClosedError as problem:
        raise InputProblem(job.parts, f"the scheduler is gone ({_first_line(problem)})", "continue with --resume") from None
    finally:
        client.cancel([future for future in list(done.futures)] if running else [])


def _seen(job: Job, span: Span) -> None:
    """Wait until a shard written elsewhere is seen here. InputProblem where it never is."""
    shard, deadline = shard_path(job.parts, *span), time.monotonic() + VISIBLE_AFTER
    while not shard.exists():
        if time.monotonic() > deadline:
            raise InputProblem(shard, "was written by a worker and is not seen here",
                               "choose with -o a folder that all machines share")
        os.listdir(job.parts)  # has a network file system look again
        time.sleep(0.2)
