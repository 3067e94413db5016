"""`testbed run`: simulate every test of a scenario into one data set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from testbed.cli._answer import Answer, plain, progress
from testbed.cli._options import catalogue_of, effects_option, shared
from testbed.cli._places import check_place

FAR_WORKERS = 32  # batches are cut for at least so many on a cluster, which may grow while it computes


@click.command(short_help="Simulate every test of a scenario into one data set.",
               epilog="Example: testbed run sweep_20x20 -o sweep.h5 --workers 2")
@click.argument("scenario_file", metavar="SCENARIO.yaml")
@click.option("-o", "--output", required=True, metavar="DATA.h5", help="The data set to write; it must not exist yet.")
@click.option("--workers", type=click.IntRange(1, 512), default=1, show_default=True, help="Runs at a time.")
@click.option("--engine", type=click.Choice(["mujoco", "fast"]), default=None,
              help="In place of the scenario's own: the reference, or the compiled one.")
@click.option("--resume", is_flag=True, help="Continue a sweep that was interrupted.")
@click.option("--processes", is_flag=True, help="Workers are processes: a run that kills its process is told by name.")
@click.option("--stall", type=click.FloatRange(min=0.1), default=600.0, show_default=True, metavar="SECONDS",
              help="With --processes: a run under way for longer is ended and stored as `limit`.")
@click.option("--compression", type=click.Choice(["gzip", "zstd", "none"]), default="gzip", show_default=True,
              help="How transients are packed; zstd is fast and needs hdf5plugin to be read.")
@click.option("--shards", "keep_shards", is_flag=True, help="DATA becomes a folder of files: for very large sweeps.")
@click.option("--dask", "address", metavar="ADDRESS", help="Compute on a dask.distributed scheduler, tcp://HOST:PORT.")
@click.option("--cluster", "cluster_file", metavar="CLUSTER.yaml", help="Compute on jobs of a queue such as SLURM.")
@effects_option
@shared
def command(scenario_file: str, output: str, workers: int, engine: str | None, resume: bool, processes: bool, stall: float,
            compression: Any, keep_shards: bool, address: str | None, cluster_file: str | None,
            folders: tuple[str, ...], json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Simulate every test of SCENARIO.yaml (a file, or the name of a shipped scenario) into one HDF5 data set.

    Results are the same for any number of workers, here or on a cluster. Interrupted with Ctrl-C, what is finished is
    kept in DATA.h5.parts and --resume continues. A run that diverges is kept, with its outcome.
    """
    from contextlib import ExitStack
    from dataclasses import replace

    from testbed.scenario.scenario_file import read_scenario
    from testbed.sweeps import sweep

    answer = Answer(json_file, quiet)
    if not (keep_shards and resume and Path(output).is_dir()):
        check_place(output)
    catalogue = catalogue_of(folders)
    scenario = read_scenario(scenario_file, catalogue)
    chosen: Any = engine or scenario.engine
    scenario = replace(scenario if seed is None else scenario.with_seed(seed), engine=chosen)
    if address and cluster_file:
        raise click.UsageError("--dask and --cluster exclude each other")
    notes = _too_slow(scenario)
    for note in notes:
        answer.say(f"warning: {note}")
    try:
        with ExitStack() as stack:
            far = None
            if address or cluster_file:
                from testbed.sweeps.cluster import on_cluster

                far = stack.enter_context(on_cluster(address, cluster_file))
            show = stack.enter_context(progress(scenario.name, quiet, "runs"))
            report = sweep.run(scenario, engine_named(scenario.engine), output, resume=resume, progress=show,
                               workers=max(workers, FAR_WORKERS) if far else workers, processes=processes,
                               folders=folders, model_xml=_xml(scenario, catalogue, folders), compression=compression,
                               stall=stall, cluster=far, keep_shards=keep_shards)
    except sweep.Interrupted as stop:
        raise KeyboardInterrupt(f"{stop}; continue with: {_again()}") from None
    outcomes = ", ".join(f"{count} {name}" for name, count in report.outcomes.items())
    answer.say(f"{report.output}: {report.runs} runs ({outcomes}), {report.computed} computed now, "
               f"content {report.content_hash[:16]}")
    answer.finish(plain(report) | {"scenario": scenario.name, "engine": scenario.engine, "seed": scenario.seed, "notes": notes})


def _too_slow(scenario: Any) -> list[str]:
    """That the sensors sample too slowly for the vibration, which their records will show at another frequency."""
    rate, frequency = scenario.sampling_rate, scenario.model.structure.natural_frequency
    if rate >= 2.0 * frequency:
        return []
    return [f"{scenario.file}: sensors.sampling_rate, {rate:.6g} Hz, is below twice the natural frequency, {frequency:.6g} Hz: "
            "the vibration will show at another frequency"]


def engine_named(name: str) -> Any:
    """An engine's `simulate`."""
    if name == "mujoco":
        from testbed.engines.mujoco_engine import simulate
    else:
        from testbed.engines.fast import simulate
    return simulate


def _xml(scenario: Any, catalogue: Any, folders: tuple[str, ...]) -> str:
    """The MuJoCo model of the scenario's first run; the bare machine's where it would compile effects in vain."""
    if folders and scenario.engine != "mujoco":
        from testbed import models

        return models.machine(scenario.model.machine).xml() if scenario.model.machine else ""
    cutter = scenario.model.cutter
    if scenario.engine == "fast" and cutter is not None and cutter.pitch_angles:
        return ""  # MuJoCo has no model of teeth of unequal pitch so far
    from testbed.engines.mujoco_engine import model_xml

    run = scenario.run(0)
    return model_xml(run.model, run.cut, steps=run.steps if scenario.engine == "mujoco" else None, catalogue=catalogue)


def _again() -> str:
    """The command that continues this one: as it was typed, with --resume."""
    import shlex

    context = click.get_current_context()
    parts = ["testbed", "run"]
    for parameter in context.command.params:
        given = context.params[parameter.name or ""]
        if context.get_parameter_source(parameter.name or "") is not click.core.ParameterSource.COMMANDLINE:
            continue
        if isinstance(parameter, click.Argument):
            parts.append(str(given))
        elif parameter.name != "resume":
            option = max(parameter.opts, key=len)
            for value in given if isinstance(given, tuple) else (given,):
                parts += [option] if value is True else [option, str(value)]
    return shlex.join([*parts, "--resume"])
