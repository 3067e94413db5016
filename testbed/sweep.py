"""A sweep: all runs of a scenario, in batches, on any number of workers, to be continued where it was interrupted.

Each batch becomes a shard in `OUTPUT.parts/`, written whole or not at all; a shard that is there is done. At the end
the shards become OUTPUT. A run depends on nothing but itself: neither workers nor interruptions change a value.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from testbed.atomic import write_text
from testbed.batch import Batch, Simulate, shard_path
from testbed.data_set import is_data_set, read_data_set
from testbed.effect import Effect
from testbed.effect import catalogue as known_effects
from testbed.model_file import model_text
from testbed.pool import work
from testbed.problem import InputProblem
from testbed.recording import Recording
from testbed.scenario import Run, Scenario
from testbed.store import Header, truth_units, write_data_set

LARGEST_BATCH = 64
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Report:
    """What a sweep did: runs in the data set, how many of them were computed now, outcomes by name, content hash."""

    output: Path
    runs: int
    computed: int
    outcomes: Mapping[str, int]
    content_hash: str


class Interrupted(KeyboardInterrupt):
    """The sweep was stopped; `done` of `runs` are kept."""

    def __init__(self, done: int, runs: int) -> None:
        self.done, self.runs = done, runs
        super().__init__(f"{done} of {runs} runs are kept")


def run(scenario: Scenario, simulate: Simulate, output: str | Path, *, workers: int = 1, resume: bool = False,
        progress: Progress | None = None, processes: bool = False, folders: tuple[str, ...] = (),
        model_xml: str = "") -> Report:
    """Compute every run of a scenario into one data set.

    simulate: an engine's function, at the top level of its module. workers: threads, or processes where `processes` is
    true (a run that kills its process is then stored as `crashed`). folders: of the user's own effects.
    progress(done, runs) is called as runs are finished. Raises InputProblem where the output exists (without `resume`),
    belongs to another scenario or cannot be written, and Interrupted on Ctrl-C, with what is finished kept.
    """
    target = Path(output)
    catalogue = known_effects(*folders)
    header = _header(scenario, model_xml, catalogue)
    if target.exists():
        return _already_there(target, header, len(scenario), resume)
    parts = target.with_name(target.name + ".parts")
    batches = _plan(scenario, header, parts, workers, resume, folders)
    waiting = [batch for batch in batches if not _done(batch)]
    done = kept = sum(len(batch) for batch in batches) - sum(len(batch) for batch in waiting)
    if progress:
        progress(done, len(scenario))
    try:
        for batch in work(waiting, simulate, workers, processes):
            done += len(batch)
            if progress:
                progress(done, len(scenario))
        digest = _consolidate(scenario, header, batches, target)
    except KeyboardInterrupt:
        raise Interrupted(sum(len(batch) for batch in batches if batch.shard.exists()), len(scenario)) from None
    except OSError as problem:
        raise InputProblem(output, f"cannot be written ({problem.strerror or problem})",
                           "free some space, then continue with --resume") from None
    shutil.rmtree(parts)
    return _report(target, len(scenario) - kept, digest)


def _report(target: Path, computed: int, digest: str) -> Report:
    outcome = read_data_set(target).outcome.tolist()
    counted = {name: outcome.count(name) for name in sorted(set(outcome))}
    return Report(target, len(outcome), computed, counted, digest)


def _already_there(target: Path, header: Header, runs: int, resume: bool) -> Report:
    if not resume:
        raise InputProblem(target, "exists already", "remove it, or choose another name with -o")
    if not is_data_set(target):
        raise InputProblem(target, "exists and is no data set of `testbed run`", "choose another name with -o")
    data = read_data_set(target)
    if data.fingerprint != header.fingerprint or len(data) != runs:
        raise InputProblem(target, "belongs to another scenario", "choose another name with -o")
    return _report(target, 0, data.content_hash)


def _header(scenario: Scenario, model_xml: str, catalogue: Mapping[str, Effect]) -> Header:
    assert scenario.model.cutter is not None  # the reader of scenarios refuses a model without one
    return Header(scenario.name, scenario.seed, scenario.engine, scenario.sampling_rate, scenario.model.cutter.flutes,
                  scenario.text, model_text(scenario.model, catalogue), model_xml, scenario.fingerprint(catalogue),
                  truth_units(scenario.model, catalogue), versions())


def versions() -> dict[str, str]:
    """Versions of the programs that a data set depends on."""
    from importlib.metadata import PackageNotFoundError, version

    found = {"python": ".".join(map(str, sys.version_info[:3]))}
    for name in ("machining-testbed", "numpy", "numba", "mujoco", "h5py"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def _plan(scenario: Scenario, header: Header, parts: Path, workers: int, resume: bool,
          folders: tuple[str, ...]) -> list[Batch]:
    """The batches of a sweep; a resumed one keeps the division it began with."""
    note = parts / "sweep.json"
    if parts.exists() and not resume:
        raise InputProblem(parts, "an unfinished sweep stands there",
                           "continue it with --resume, remove the folder, or choose another name with -o")
    size = max(1, min(LARGEST_BATCH, -(-len(scenario) // (4 * workers))))
    begun = {"fingerprint": header.fingerprint, "runs": len(scenario), "batch": size}
    if note.exists():
        try:
            found = json.loads(note.read_text(encoding="utf-8"))
            size = int(found["batch"])
            same = (found["fingerprint"], found["runs"]) == (begun["fingerprint"], begun["runs"])
        except (ValueError, KeyError, TypeError):
            raise InputProblem(note, "is damaged", f"remove the folder {parts.name} and start again") from None
        if not same:
            raise InputProblem(parts, "belongs to another scenario",
                               "choose another name with -o, or remove the folder and start again")
    else:
        try:
            parts.mkdir(exist_ok=True)
        except OSError as problem:
            raise InputProblem(parts, f"cannot be made ({problem.strerror})", "choose another place with -o") from None
        write_text(note, json.dumps(begun))
    for left in parts.glob(".*.part"):  # of a process that was killed while it wrote
        left.unlink()
    edges = [*range(0, len(scenario), size), len(scenario)]
    return [Batch(scenario, header, first, last, shard_path(parts, first, last), folders)
            for first, last in pairwise(edges)]


def _done(batch: Batch) -> bool:
    """True if the batch's shard is there and whole; one that is not is computed again."""
    if not batch.shard.exists():
        return False
    try:
        return len(read_data_set(batch.shard)) == len(batch)
    except InputProblem:
        batch.shard.unlink()
        return False


def _consolidate(scenario: Scenario, header: Header, batches: list[Batch], target: Path) -> str:
    def rows() -> Iterator[tuple[Run, Recording]]:
        for batch in batches:
            for index, recording in zip(range(batch.first, batch.last), read_data_set(batch.shard), strict=True):
                yield scenario.run(index), recording

    return write_data_set(target, header, rows(), len(scenario), scenario.longest())
