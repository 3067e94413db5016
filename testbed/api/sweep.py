"""Every test of a scenario simulated into one data set."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from testbed.api.believed import Effects, EffectsLike, File, effects_of
from testbed.api.places import check_place
from testbed.api.result import Result, Table, plain
from testbed.api.watch import Progress
from testbed.api.working import working
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from testbed.scenario.scenario import Scenario
    from testbed.store.data_set import DataSet
    from testbed.sweeps.sweep import Report

FAR_WORKERS = 32  # batches are cut for at least so many on a cluster, which may grow while it computes
STALL_S = 600.0
Engine: TypeAlias = Literal["mujoco", "fast"]
ScenarioLike: TypeAlias = "File | Scenario"


@dataclass(frozen=True)
class Workers:
    """Who computes a sweep; results are the same whoever does.

    count: runs at a time. processes: each in a process, so that a run that kills its own is told by name; one under way for
    `stall` seconds is then ended and stored as `limit`. dask: the address of a dask.distributed scheduler. cluster: a file that
    describes jobs of a queue such as SLURM.
    """

    count: int = 1
    processes: bool = False
    stall: float = STALL_S
    dask: str | None = None
    cluster: File | None = None


@dataclass(frozen=True, repr=False, eq=False)
class Sweep(Result):
    """A sweep that is done. detail: runs, how many were computed now, outcomes by name, content hash."""

    detail: Report
    scenario: Scenario
    notes: tuple[str, ...]

    @property
    def data(self) -> DataSet:
        """The data set that was written."""
        from testbed.store.data_set import read_data_set

        return read_data_set(self.detail.output)

    def _answer(self) -> Mapping[str, Any]:
        own = self.scenario
        return plain(self.detail) | {"scenario": own.name, "engine": own.engine, "seed": own.seed,  # type: ignore[no-any-return]
                                     "notes": self.notes}

    def _table(self) -> Table:
        return Table("outcome", {"outcome": list(self.detail.outcomes), "runs": list(self.detail.outcomes.values())}, {})

    def _headline(self) -> str:
        outcomes = ", ".join(f"{count} {name}" for name, count in self.detail.outcomes.items())
        return f"{self.detail.output}, {self.detail.runs} runs ({outcomes}), {self.detail.computed} computed now"


def sweep(scenario: ScenarioLike, output: File, *, workers: int | Workers = 1, engine: Engine | None = None,
          seed: int | None = None, resume: bool = False, compression: Literal["gzip", "zstd", "none"] = "gzip",
          shards: bool = False, effects: EffectsLike = (), progress: Progress = None) -> Sweep:
    """Simulate every test of a scenario into one HDF5 data set: `testbed run`.

    scenario: a file, the name of a shipped scenario, or testbed.load of one. output: the data set to write; it must not exist
    yet. workers: runs at a time, or Workers. engine: in place of the scenario's own. seed: in place of the scenario's own.
    resume: continue a sweep that was interrupted. compression: how transients are packed. shards: output becomes a folder of
    files. effects: folders of one's own effects. progress: a function of (title, done, all), or False.
    Raises InputProblem; KeyboardInterrupt on Ctrl-C, with what is finished kept for `resume`.
    """
    from testbed.sweeps import sweep as sweeps

    who = workers if isinstance(workers, Workers) else Workers(workers)
    target = Path(output)
    if not (shards and resume and target.is_dir()):
        check_place(target)
    with working(progress) as watch, ExitStack() as stack:
        own = effects_of(effects)
        chosen = _chosen(scenario, own, engine, seed)
        notes = _too_slow(chosen)
        for note in notes:
            watch.note(f"warning: {note}")
        far = None
        if who.dask or who.cluster is not None:
            if who.dask and who.cluster is not None:
                raise InputProblem("workers", "--dask and --cluster exclude each other", "give one of them")
            from testbed.sweeps.cluster import on_cluster

            far = stack.enter_context(on_cluster(who.dask, None if who.cluster is None else os.fspath(who.cluster)))
        show = stack.enter_context(watch.counted(chosen.name, "runs"))
        report = sweeps.run(chosen, engine_named(chosen.engine), target, resume=resume, progress=show,
                            workers=max(who.count, FAR_WORKERS) if far else who.count, processes=who.processes,
                            folders=own.folders, model_xml=_xml(chosen, own), compression=compression, stall=who.stall,
                            cluster=far, keep_shards=shards)
        return Sweep(report, chosen, tuple(notes))


def _chosen(scenario: ScenarioLike, effects: Effects, engine: Engine | None, seed: int | None) -> Scenario:
    from testbed.scenario.scenario_file import read_scenario

    given = read_scenario(os.fspath(scenario), effects.known) if isinstance(scenario, (str, os.PathLike)) else scenario
    return replace(given if seed is None else given.with_seed(seed), engine=engine or given.engine)


def _too_slow(scenario: Scenario) -> list[str]:
    """That the sensors sample too slowly for the vibration, which their records will show at another frequency."""
    rate, frequency = scenario.sampling_rate, scenario.model.structure.natural_frequency
    if rate >= 2.0 * frequency:
        return []
    return [f"{scenario.file}: sensors.sampling_rate, {rate:.6g} Hz, is below twice the natural frequency, {frequency:.6g} Hz: "
            "the vibration will show at another frequency"]


def engine_named(name: str) -> Any:
    """An engine's `simulate`. InputProblem where there is none of that name."""
    if name == "mujoco":
        from testbed.engines.mujoco_engine import simulate
    elif name == "fast":
        from testbed.engines.fast import simulate
    else:
        raise InputProblem("engine", f"there is no '{name}'", "give fast or mujoco")
    return simulate


def _xml(scenario: Scenario, effects: Effects) -> str:
    """The MuJoCo model of the scenario's first run; the bare machine's where it would compile effects in vain."""
    if effects.folders and scenario.engine != "mujoco":
        from testbed import models

        return models.machine(scenario.model.machine).xml() if scenario.model.machine else ""
    cutter = scenario.model.cutter
    if scenario.engine == "fast" and cutter is not None and cutter.pitch_angles:
        return ""  # MuJoCo has no model of teeth of unequal pitch so far
    from testbed.engines.mujoco_engine import model_xml

    run = scenario.run(0)
    return model_xml(run.model, run.cut, steps=run.steps if scenario.engine == "mujoco" else None, catalogue=effects.known)
