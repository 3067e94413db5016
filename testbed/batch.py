"""One batch of a sweep: simulate its runs, put them through their sensors, write one shard."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from testbed.chunk_writer import Compression
from testbed.provenance import versions
from testbed.recording import CHANNEL_UNITS, Outcome, Recording
from testbed.scenario import Run, Scenario
from testbed.shards import shard_path
from testbed.store import Header, write_data_set

_TOGETHER = 32  # runs planned and simulated in a row: cheaper than one at a time, and threads wait less for each other
Simulate = Callable[..., Recording]
Tell = Callable[[int], None]


@dataclass(frozen=True)
class Job:
    """What all batches of a sweep share; a worker is given it once.

    simulate: an engine's function, at the top level of its module. parts: folder of the shards. chunk_rows: runs in a
    chunk. folders: of the user's own effects; the catalogue itself does not travel between processes.
    """

    scenario: Scenario
    header: Header
    simulate: Simulate
    parts: Path
    samples: int
    chunk_rows: int
    compression: Compression = "gzip"
    folders: tuple[str, ...] = ()


def compute(job: Job, first: int, last: int, tell: Tell | None = None, together: bool = True) -> None:
    """Simulate runs `first` up to `last` and write their shard.

    tell: called with a run's number before it is simulated; what it raises ends the batch. together: several runs in a row
    may be simulated after one such call; otherwise there is one for each.
    """
    _write(job, first, last, _rows(job, first, last, tell, together))


def write_failed(job: Job, index: int, outcome: Outcome) -> None:
    """The shard of one run that left nothing: it killed every process that tried it, or came to no end."""
    run = job.scenario.run(index)
    _write(job, index, index + 1, iter([(run, nothing(run, outcome))]))


def _write(job: Job, first: int, last: int, rows: Iterator[tuple[Run, Recording]]) -> None:
    # Not forced to the disk: a power cut may spoil a shard, its seal tells, and it is computed again.
    made_here = replace(job.header, versions=versions())  # which on a cluster need not be those of who asked
    write_data_set(shard_path(job.parts, first, last), made_here, rows, last - first, job.samples,
                   compression=job.compression, chunk_rows=job.chunk_rows, durable=False)


def _rows(job: Job, first: int, last: int, tell: Tell | None, together: bool) -> Iterator[tuple[Run, Recording]]:
    from testbed.catalogue import catalogue

    effects = catalogue(*job.folders) if job.folders else None
    group = _TOGETHER if together else 1
    for begin in range(first, last, group):
        runs = [job.scenario.run(index) for index in range(begin, min(begin + group, last))]
        if tell is not None:
            tell(begin)
        yield from zip(runs, simulate_runs(runs, job.simulate, effects), strict=True)
    if tell is not None:
        tell(last)


def simulate_runs(runs: list[Run], simulate: Simulate, effects: Any = None) -> Iterator[Recording]:
    """`simulate_run` of each, in one call where the engine's function has another beside it, `together`, for many runs."""
    many = getattr(simulate, "together", None)
    head = runs[0]
    if many is not None and len(runs) > 1 and all(run.steps == head.steps and run.sensors.sources == head.sensors.sources
                                              for run in runs):
        try:
            predicted = many([run.model for run in runs], [run.cut for run in runs], [run.sampling for run in runs],
                             channels=head.sensors.sources, steps=head.steps, catalogue=effects)
        except (FloatingPointError, OverflowError, ZeroDivisionError):
            pass  # one of them: which, is found one by one
        else:
            yield from (_sensed(run, recording) for run, recording in zip(runs, predicted, strict=True))
            return
    yield from (simulate_run(run, simulate, effects) for run in runs)


def simulate_run(run: Run, simulate: Simulate, effects: Any = None) -> Recording:
    """One run as its sensors record it. A run whose numbers fail is a recording of nothing with its outcome by name."""
    try:
        predicted = simulate(run.model, run.cut, run.sampling, channels=run.sensors.sources, steps=run.steps,
                             catalogue=effects)
    except (FloatingPointError, OverflowError, ZeroDivisionError):
        return nothing(run, "diverged")
    return _sensed(run, predicted)


def _sensed(run: Run, predicted: Recording) -> Recording:
    return run.sensors.apply(predicted, run.sensed() if run.sensors.chance else None)


def nothing(run: Run, outcome: Outcome) -> Recording:
    """The recording of a run that left none: one sample, NaN."""
    channels = {name: np.full(1, np.nan) for name in run.sensors.channels}
    return Recording(channels, run.sampling.rate, {name: CHANNEL_UNITS[name] for name in channels}, "synthetic",
                     start=run.sampling.start, outcome=outcome, outcome_time=run.sampling.start, on_tool=run.sensors.on_tool)
