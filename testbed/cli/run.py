"""`testbed run`: simulate every test of a scenario into one data set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from testbed.api.places import check_place
from testbed.cli._answer import Answer
from testbed.cli._options import effects_option, shared


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
def command(scenario_file: str, output: str, workers: int, engine: Any, resume: bool, processes: bool, stall: float,
            compression: Any, keep_shards: bool, address: str | None, cluster_file: str | None,
            folders: tuple[str, ...], json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Simulate every test of SCENARIO.yaml (a file, or the name of a shipped scenario) into one HDF5 data set.

    Results are the same for any number of workers, here or on a cluster. Interrupted with Ctrl-C, what is finished is
    kept in DATA.h5.parts and --resume continues. A run that diverges is kept, with its outcome.
    """
    from testbed.api.sweep import Workers, sweep
    from testbed.sweeps.sweep import Interrupted

    answer = Answer(json_file, quiet)
    if not (keep_shards and resume and Path(output).is_dir()):
        check_place(output)
    if address and cluster_file:
        raise click.UsageError("--dask and --cluster exclude each other")
    try:
        found = sweep(scenario_file, output, workers=Workers(workers, processes, stall, address, cluster_file), engine=engine,
                      seed=seed, resume=resume, compression=compression, shards=keep_shards, effects=folders,
                      progress=answer.watch)
    except Interrupted as stop:
        raise KeyboardInterrupt(f"{stop}; continue with: {_again()}") from None
    report = found.detail
    outcomes = ", ".join(f"{count} {name}" for name, count in report.outcomes.items())
    answer.say(f"{report.output}: {report.runs} runs ({outcomes}), {report.computed} computed now, "
               f"content {report.content_hash[:16]}")
    answer.finish(found.to_dict())


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
