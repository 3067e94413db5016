"""One batch of a sweep: simulate its runs, put them through their sensors, write one shard."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from testbed.recording import CHANNEL_UNITS, Outcome, Recording, Records
from testbed.scenario.scenario import Run, Runs, Scenario
from testbed.sensors.chain import SensorChain
from testbed.store.chunk_writer import Compression
from testbed.store.provenance import versions
from testbed.store.store import Block, Header, block, block_of, write_data_set
from testbed.sweeps.shards import shard_path

_BYTES = 2**22  # of records simulated at once: what the processor still has at hand when they are written
_SIGNALS = 6  # about how many an engine keeps of a run whose effects may ask for them
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
    _write(job, first, last, _blocks(job, first, last, tell, together))


def write_failed(job: Job, index: int, outcome: Outcome) -> None:
    """The shard of one run that left nothing: it killed every process that tried it, or came to no end."""
    run = job.scenario.run(index)
    _write(job, index, index + 1, iter([block_of(run, nothing(run, outcome))]))


def _write(job: Job, first: int, last: int, blocks: Iterator[Block]) -> None:
    # Not forced to the disk: a power cut may spoil a shard, its seal tells, and it is computed again.
    made_here = replace(job.header, versions=versions())  # which on a cluster need not be those of who asked
    write_data_set(shard_path(job.parts, first, last), made_here, blocks, last - first, job.samples,
                   compression=job.compression, chunk_rows=job.chunk_rows, durable=False)


def _blocks(job: Job, first: int, last: int, tell: Tell | None, together: bool) -> Iterator[Block]:
    from testbed.catalogue import catalogue

    effects = catalogue(*job.folders) if job.folders else None
    many = getattr(job.simulate, "side_by_side", None) if together else None  # arrays in, arrays out, and no object a run
    if many is None:
        for index in range(first, last):
            if tell is not None:
                tell(index)
            yield _alone(job, index, effects)
    else:
        signals = _SIGNALS if job.scenario.model.effects else 1
        group = max(1, min(last - first, _BYTES // (8 * signals * job.samples)))
        runs = job.scenario.between(first, last)
        for begin in range(first, last, group):
            if tell is not None:
                tell(begin)
            yield from _together(job, many, runs[begin - first:begin - first + group], effects)
    if tell is not None:
        tell(last)


def _alone(job: Job, index: int, effects: Any) -> Block:
    run = job.scenario.run(index)
    return block_of(run, simulate_run(run, job.simulate, effects))


def _together(job: Job, many: Callable[..., Records], runs: Runs, effects: Any) -> Iterator[Block]:
    """Runs by the engine's function for many, which takes and gives arrays; one by one where that fails for any of them."""
    try:
        if len({sensors.sources for sensors in _unlike(runs.sensors)}) > 1:
            raise ArithmeticError("not of one kind")
        records = many(runs.models, runs.cuts, runs.counts, runs.rate, channels=runs.sensors[0].sources, steps=runs.steps,
                       catalogue=effects)
    except ArithmeticError:
        yield from (_alone(job, index, effects) for index in range(runs.first, runs.first + len(runs)))
    else:
        yield sensed(runs, records)


def _unlike(sensors: Sequence[SensorChain]) -> list[SensorChain]:
    """The chains, each once; those of a sweep are a few."""
    return list({id(one): one for one in sensors}.values())


def sensed(runs: Runs, records: Records) -> Block:
    """What the runs' sensors make of predicted records."""
    chains = _unlike(runs.sensors)
    quiet = chains[0] if len(chains) == 1 and not chains[0].timed and not chains[0].chance else None
    if quiet is not None:
        channels, marks = quiet.measured(records.channels, 0.0, runs.rate, records.marks, None)
        return block(runs, channels, marks, records)
    channels = {name: np.empty(next(iter(records.channels.values())).shape) for name in runs.sensors[0].channels}
    marks = np.empty(records.marks.shape)
    for place, (chain, count, rng) in enumerate(zip(runs.sensors, runs.counts.tolist(), runs.sensed(), strict=True)):
        own = {source: values[place, :count] for source, values in records.channels.items()}
        measured, marks[place] = chain.measured(own, 0.0, runs.rate, records.marks[place], rng)
        for name, values in measured.items():
            channels[name][place, :count], channels[name][place, count:] = values, 0.0
    return block(runs, channels, marks, records)


def simulate_run(run: Run, simulate: Simulate, effects: Any = None) -> Recording:
    """One run as its sensors record it. A run whose numbers fail is a recording of nothing with its outcome by name."""
    try:
        predicted = simulate(run.model, run.cut, run.sampling, channels=run.sensors.sources, steps=run.steps,
                             catalogue=effects)
    except (FloatingPointError, OverflowError, ZeroDivisionError):
        return nothing(run, "diverged")
    return run.sensors.apply(predicted, run.sensed() if run.sensors.chance else None)


def nothing(run: Run, outcome: Outcome) -> Recording:
    """The recording of a run that left none: one sample, NaN."""
    channels = {name: np.full(1, np.nan) for name in run.sensors.channels}
    return Recording(channels, run.sampling.rate, {name: CHANNEL_UNITS[name] for name in channels}, "synthetic",
                     start=run.sampling.start, outcome=outcome, outcome_time=run.sampling.start, on_tool=run.sensors.on_tool)
