"""A sweep: all runs of a scenario, in batches, on any number of workers, to be continued where it was interrupted.

Each batch becomes a shard in `OUTPUT.parts/`, written whole or not at all; a shard that is there is done. At the end
the shards become OUTPUT. A run depends on nothing but itself: neither workers nor interruptions change a value.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from glob import escape
from hashlib import sha256
from pathlib import Path
from typing import Any

from testbed.catalogue import catalogue as known_effects
from testbed.effect import Effect
from testbed.files.model_file import model_text
from testbed.problem import InputProblem
from testbed.scenario.scenario import Scenario
from testbed.store.chunk_writer import Compression, check_packing, chunk_rows, kind_of
from testbed.store.data_set import is_data_set, read_data_set
from testbed.store.provenance import versions
from testbed.store.seal import state
from testbed.store.store import Header, truth_units
from testbed.sweeps.batch import Job, Simulate
from testbed.sweeps.consolidate import consolidate
from testbed.sweeps.pool import STALL, work
from testbed.sweeps.shards import (
    INDEX,
    NOTE,
    STRANGE,
    Span,
    Spans,
    fault,
    find,
    gaps,
    kept,
    note_text,
    overlaps,
    parts_folder,
    read_note,
)
from testbed.system.atomic import settle_names, write_text
from testbed.system.interruption import remembered_interruptions
from testbed.system.one_writer import one_writer

LARGEST_BATCH = {"fast": 2048, "mujoco": 64}
BATCH_BYTES = 128_000_000
Progress = Callable[[int, int], None]
Work = Callable[[Job, list[Span]], Spans]


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
        model_xml: str = "", compression: Compression = "gzip", stall: float = STALL,
        cluster: Work | None = None, keep_shards: bool = False) -> Report:
    """Compute every run of a scenario into one data set, a file or (`keep_shards`) a folder of shards with an index.

    simulate: an engine's function, at the top level of its module. workers: threads, or processes where `processes` is
    true (a run that kills its process is then stored as `crashed`, one that hangs for `stall` seconds as `limit`).
    folders: of the user's own effects. cluster: computes the batches in place of workers here (`testbed.sweeps.cluster`).
    progress(done, runs) is called as runs are finished. Raises InputProblem where the output exists (without `resume`),
    belongs to another scenario or cannot be written, and Interrupted on Ctrl-C, with what is finished kept.
    """
    target = Path(output)
    check_packing(compression)
    catalogue = known_effects(*folders)
    header = _header(scenario, model_xml, catalogue, folders)
    if target.exists() and not (resume and target.is_dir()):
        return _already_there(target, header, len(scenario), resume)
    try:
        with one_writer(target) as still_ours:
            if target.exists() and not _reopened(target, header, len(scenario)):
                return _already_there(target, header, len(scenario), resume)
            job, size = _plan(scenario, header, simulate, parts_folder(target), workers, resume)
            job = replace(job, compression=compression, folders=folders)
            _remove_left(target)
            computing = cluster or _local(workers, processes, stall)
            return _computed(target, job, size, computing, progress, keep_shards, workers, still_ours)
    except OSError as problem:
        raise InputProblem(target, f"cannot be written ({problem.strerror or _first_line(problem)})",
                           "make room or give the permission, then continue with --resume") from None
    except MemoryError:
        raise InputProblem(target, "memory is at an end", "give it fewer --workers, and continue with --resume") from None


def _computed(target: Path, job: Job, size: int, computing: Work, progress: Progress | None, keep_shards: bool,
              threads: int, still_ours: Callable[[], None]) -> Report:
    """The report of a sweep, its runs computed in batches of `size` and put together."""
    parts, count = job.parts, len(job.scenario)
    try:
        there = kept(parts, count, job.header.fingerprint)
        done = before = count - sum(last - first for first, last in gaps(there, count))
        spans = list(_batches(gaps(there, count), size))
        if progress:
            progress(done, count)
        with remembered_interruptions() as check, closing(computing(job, spans)) as computed:
            for first, last in computed:
                done += last - first
                if progress:
                    progress(done, count)
                check()
        still_ours()
        digest = _consolidate(target, job, threads, keep_shards)
    except KeyboardInterrupt:
        shards = find(parts) if parts.exists() else []
        raise Interrupted(sum(last - first for first, last, _ in shards), count) from None
    if not keep_shards:
        shutil.rmtree(parts, ignore_errors=True)
    return _report(target, count - before, digest)


def _remove_left(target: Path) -> None:
    """Remove what a process that was killed while it put the shards together has left beside the output."""
    for left in target.parent.glob(f".{escape(target.name)}.*.part"):
        if left.is_file():
            left.unlink(missing_ok=True)


def _local(workers: int, processes: bool, stall: float) -> Work:
    return lambda job, spans: work(job, spans, workers, processes, stall)


def _consolidate(target: Path, job: Job, threads: int, keep_shards: bool) -> str:
    shards = find(job.parts)
    for shard in overlaps(shards):  # of a worker that died after it wrote, when its runs were computed in pieces
        shard[2].unlink()
        shards.remove(shard)
    missing = gaps(shards, len(job.scenario))
    if missing:
        raise InputProblem(job.parts, f"lacks runs {missing[0][0]} to {missing[0][1] - 1}: a shard was removed meanwhile",
                           "continue with --resume")
    if not keep_shards:
        return consolidate(target, job.header, shards, job.samples, job.compression, threads)
    digest = consolidate(job.parts / INDEX, job.header, shards, job.samples, job.compression, threads, transients=False)
    os.replace(job.parts, target)
    settle_names(target.parent)
    return digest


def _first_line(problem: Exception) -> str:
    return (str(problem).splitlines() or [type(problem).__name__])[0]


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
    shutil.rmtree(parts_folder(target), ignore_errors=True)  # of a sweep that ended between its last two steps
    return _report(target, 0, data.content_hash)


def _reopened(folder: Path, header: Header, runs: int) -> bool:
    """Make a finished folder of shards that lacks something, or is damaged, an unfinished sweep again; whether it is one."""
    parts, index, shards = parts_folder(folder), folder / INDEX, find(folder)
    if not (folder / NOTE).exists() or parts.exists():
        return False
    try:
        ours: bool | None = read_note(folder)["fingerprint"] == header.fingerprint
    except ValueError:  # the note is damaged: the shards tell
        ours = None
    if ours is False:
        return False
    faults = [fault(path, header.fingerprint) for _, _, path in shards]
    if ours is None and (STRANGE in faults or not shards):
        return False
    whole = index.is_file() and state(index) == "whole" and not gaps(shards, runs) and not overlaps(shards)
    if ours and whole and not any(faults):
        return False
    os.replace(folder, parts)
    (parts / INDEX).unlink(missing_ok=True)
    return True


def _header(scenario: Scenario, model_xml: str, catalogue: Mapping[str, Effect], folders: tuple[str, ...]) -> Header:
    assert scenario.model.cutter is not None  # the reader of scenarios refuses a model without one
    return Header(scenario.name, scenario.seed, scenario.engine, scenario.sampling_rate, scenario.model.cutter.flutes,
                  scenario.text, model_text(scenario.model, catalogue), model_xml, _fingerprint(scenario, catalogue, folders),
                  truth_units(scenario.model, catalogue), versions())


def _fingerprint(scenario: Scenario, catalogue: Mapping[str, Effect], folders: tuple[str, ...]) -> str:
    """The scenario's own, with the laws of the user's effects in it: runs of two laws under one name are not mixed."""
    found, places = scenario.fingerprint(catalogue), {Path(folder).resolve() for folder in folders}
    laws = [path.read_bytes() for name in sorted(scenario.model.effects)
            if (path := catalogue[name].path) is not None and path.resolve().parent in places]
    return sha256(b"".join([found.encode(), *laws])).hexdigest() if laws else found


def _plan(scenario: Scenario, header: Header, simulate: Simulate, parts: Path, workers: int,
          resume: bool) -> tuple[Job, int]:
    """What the workers are given, and the runs in a batch; a resumed sweep keeps the division it began with."""
    if parts.exists() and not resume:
        raise InputProblem(parts, "an unfinished sweep stands there",
                           "continue it with --resume, remove the folder, or choose another name with -o")
    samples = scenario.longest()
    widest = max(kind_of(sensor).itemsize for sensor in scenario.sensors[0].channels.values())
    most = max(1, min(LARGEST_BATCH[scenario.engine], -(-len(scenario) // (4 * workers)), BATCH_BYTES // (samples * widest)))
    rows = chunk_rows(samples, widest, most)
    begun: dict[str, Any] = {"fingerprint": header.fingerprint, "runs": len(scenario), "batch": most // rows * rows,
                             "chunk": rows}
    try:
        parts.mkdir(exist_ok=True)
    except OSError as problem:
        raise InputProblem(parts, f"cannot be made ({problem.strerror})", "choose another place with -o") from None
    begun = _noted(parts, begun)
    return Job(scenario, header, simulate, parts.absolute(), samples, begun["chunk"]), begun["batch"]


def _noted(parts: Path, begun: dict[str, Any]) -> dict[str, Any]:
    """The note of a folder of shards: its own, or, where it has none that is whole, `begun`, written now."""
    try:
        found = read_note(parts)
        strange = (found["fingerprint"], found["runs"]) != (begun["fingerprint"], begun["runs"])
    except (FileNotFoundError, ValueError):
        found, strange = begun, any(fault(path, begun["fingerprint"]) == STRANGE for _, _, path in find(parts))
        if not strange:
            write_text(parts / NOTE, note_text(begun))
    if strange:
        raise InputProblem(parts, STRANGE, "choose another name with -o, or remove the folder and start again")
    return found


def _batches(missing: list[Span], size: int) -> Iterator[Span]:
    """Spans of at most `size` runs, divided at whole multiples of it, so that chunks fit one after another."""
    for first, last in missing:
        while first < last:
            edge = min(last, (first // size + 1) * size)
            yield first, edge
            first = edge
