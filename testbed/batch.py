"""One batch of a sweep: simulate its runs, put them through their sensors, write one shard."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from testbed.recording import CHANNEL_UNITS, Outcome, Recording
from testbed.scenario import Run, Scenario
from testbed.store import Header, write_data_set

Simulate = Callable[..., Recording]


@dataclass(frozen=True)
class Batch:
    """Runs `first` up to, not including, `last` of a scenario, to be written to `shard`."""

    scenario: Scenario
    header: Header
    first: int
    last: int
    shard: Path
    folders: tuple[str, ...] = ()  # of the user's own effects; the catalogue itself does not travel between processes

    def __len__(self) -> int:
        return self.last - self.first

    def part(self, first: int, last: int) -> Batch:
        """The same, of fewer runs."""
        return replace(self, first=first, last=last, shard=shard_path(self.shard.parent, first, last))


def shard_path(folder: Path, first: int, last: int) -> Path:
    """The file of a batch's runs; its name says which they are."""
    return folder / f"runs-{first:08d}-{last:08d}.h5"


def compute(batch: Batch, simulate: Simulate, stop: Any = None) -> Path:
    """Simulate a batch and write its shard; returns the shard's path.

    stop: an event looked at between runs, so that an interrupted sweep ends soon; then KeyboardInterrupt is raised.
    """
    write_data_set(batch.shard, batch.header, _rows(batch, simulate, stop), len(batch), batch.scenario.longest())
    return batch.shard


def _rows(batch: Batch, simulate: Simulate, stop: Any) -> Iterator[tuple[Run, Recording]]:
    from testbed.effect import catalogue

    effects = catalogue(*batch.folders) if batch.folders else None
    for index in range(batch.first, batch.last):
        if stop is not None and stop.is_set():
            raise KeyboardInterrupt
        run = batch.scenario.run(index)
        yield run, simulate_run(run, simulate, effects)


def simulate_run(run: Run, simulate: Simulate, effects: Any = None) -> Recording:
    """One run as its sensors record it. A run whose numbers fail is a recording of nothing with its outcome by name."""
    try:
        predicted = simulate(run.model, run.cut, run.sampling, channels=tuple(run.sensors.channels), steps=run.steps,
                             catalogue=effects)
    except (FloatingPointError, OverflowError, ZeroDivisionError):
        return nothing(run, "diverged")
    return run.sensors.apply(predicted, run.sensed())


def nothing(run: Run, outcome: Outcome) -> Recording:
    """The recording of a run that left none: one sample, NaN."""
    channels = {name: np.full(1, np.nan) for name in run.sensors.channels}
    return Recording(channels, run.sampling.rate, {name: CHANNEL_UNITS[name] for name in channels}, "synthetic",
                     start=run.sampling.start, outcome=outcome, outcome_time=run.sampling.start)


def write_crashed(batch: Batch) -> Path:
    """The shard of a batch whose every run killed the process that tried it."""
    runs = (batch.scenario.run(index) for index in range(batch.first, batch.last))
    write_data_set(batch.shard, batch.header, ((run, nothing(run, "crashed")) for run in runs), len(batch),
                   batch.scenario.longest())
    return batch.shard
