"""`testbed run`: simulate every test of a scenario into one data set."""

from __future__ import annotations

from typing import Any

import click

from testbed.cli._answer import Answer, check_place, plain, progress
from testbed.cli._options import catalogue_of, effects_option, shared


@click.command(short_help="Simulate every test of a scenario into one data set.",
               epilog="Example: testbed run sweep_20x20 -o sweep.h5 --workers 2")
@click.argument("scenario_file", metavar="SCENARIO.yaml")
@click.option("-o", "--output", required=True, metavar="DATA.h5", help="The data set to write; it must not exist yet.")
@click.option("--workers", type=click.IntRange(1, 512), default=1, show_default=True, help="Runs at a time.")
@click.option("--engine", type=click.Choice(["mujoco", "fast"]), default=None,
              help="In place of the scenario's own: the reference, or the compiled one.")
@click.option("--resume", is_flag=True, help="Continue a sweep that was interrupted.")
@click.option("--processes", is_flag=True, help="Workers are processes: a run that kills its process is told by name.")
@effects_option
@shared
def command(scenario_file: str, output: str, workers: int, engine: str | None, resume: bool, processes: bool,
            folders: tuple[str, ...], json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Simulate every test of SCENARIO.yaml (a file, or the name of a shipped scenario) into one HDF5 data set.

    Results are the same for any number of workers. Interrupted with Ctrl-C, what is finished is kept in DATA.h5.parts
    and --resume continues. A run that diverges is kept, with its outcome.
    """
    from dataclasses import replace

    from testbed import sweep
    from testbed.scenario_file import read_scenario

    answer = Answer(json_file, quiet)
    check_place(output)
    catalogue = catalogue_of(folders)
    scenario = read_scenario(scenario_file, catalogue)
    chosen: Any = engine or scenario.engine
    scenario = replace(scenario, engine=chosen, seed=scenario.seed if seed is None else seed)
    try:
        with progress(scenario.name, quiet) as show:
            report = sweep.run(scenario, engine_named(scenario.engine), output, workers=workers, resume=resume,
                               progress=show, processes=processes, folders=folders,
                               model_xml=_xml(scenario, catalogue, folders))
    except sweep.Interrupted as stop:
        again = _again(scenario_file, output, workers, engine, processes, folders, seed)
        raise KeyboardInterrupt(f"{stop}; continue with: {again}") from None
    outcomes = ", ".join(f"{count} {name}" for name, count in report.outcomes.items())
    answer.say(f"{report.output}: {report.runs} runs ({outcomes}), {report.computed} computed now, "
               f"content {report.content_hash[:16]}")
    answer.finish(plain(report) | {"scenario": scenario.name, "engine": scenario.engine, "seed": scenario.seed})


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
        import models

        return models.machine(scenario.model.machine).xml() if scenario.model.machine else ""
    from testbed.engines.mujoco_engine import model_xml

    run = scenario.run(0)
    return model_xml(run.model, run.cut, steps=run.steps if scenario.engine == "mujoco" else None, catalogue=catalogue)


def _again(scenario_file: str, output: str, workers: int, engine: str | None, processes: bool, folders: tuple[str, ...],
           seed: int | None) -> str:
    import shlex

    parts = ["testbed", "run", scenario_file, "-o", output, "--workers", str(workers), "--resume"]
    parts += ["--engine", engine] if engine else []
    parts += ["--seed", str(seed)] if seed is not None else []
    parts += ["--processes"] if processes else []
    for folder in folders:
        parts += ["--effects", folder]
    return shlex.join(parts)
