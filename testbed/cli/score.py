"""`testbed score`: identify from synthetic transients again and again, and compare with the known truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import click

from testbed.cli._answer import Answer, progress, shown
from testbed.cli._options import NOISE, catalogue_of, effects_option, shared
from testbed.problem import InputProblem


@click.command(short_help="Identify from synthetic transients and score against the known truth.",
               epilog="Example: testbed score tests.h5 --noise 0.5um,1um,2um")
@click.argument("data", metavar="DATA.h5")
@click.option("--noise", type=NOISE, default=None, metavar="LEVELS",
              help="Noise rms to identify at, such as 0.5um,1um; by default the data set's own. 0 is the least.")
@click.option("--repeats", type=click.IntRange(1, 1000), default=5, show_default=True,
              help="Identifications at each of those levels, each with noise of its own.")
@click.option("--method", type=click.Choice(["multipliers", "waveform"]), default="multipliers", show_default=True)
@effects_option
@shared
def command(data: str, noise: list[float] | None, repeats: int, method: str, folders: tuple[str, ...],
            json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Bias, spread, rms error and the coverage of the intervals, for each parameter and noise level.

    DATA.h5 holds simulated tests and their truth. Identification starts away from the truth (frequency 1 % high,
    damping and cutting coefficients twice as large). With --noise, noise is added to what the tests already have.
    """
    from analysis.score import score
    from testbed.data_set import read_data_set

    answer = Answer(json_file, quiet)
    catalogue = catalogue_of(folders)
    source = read_data_set(data)
    truth = source.true_model(catalogue)
    start = _away(truth)
    groups = _groups(source)
    levels = sorted(groups) if noise is None else [max(level, min(groups)) if level == 0 else level for level in noise]
    seeds = _seeds(groups, levels, repeats if noise is not None else None, data)
    total = sum(len(each) for each in seeds.values())
    done = 0
    with progress("identifying", quiet) as show:
        def method_shown(records: Sequence[Any]) -> Any:
            nonlocal done
            done += 1
            show(done, total)
            return _identify(start, records, method, data, catalogue)

        scores = []
        for level in levels:
            scores += score(method_shown, truth, _records(groups, noise is not None, seed or 0), [level], seeds[level])
    answer.table(("parameter", "noise", "truth", "bias", "spread", "rms", "coverage", "failed"),
                 [_row(one) for one in scores])
    answer.finish({"method": method, "truth": {one.parameter: one.truth for one in scores}, "scores": scores})


def _away(truth: Any) -> Any:
    """The start of every identification: far enough away that its road is tested too."""
    factors = {"natural_frequency": 1.01, "damping_ratio": 2.0, "tangential_coefficient": 2.0,
               "normal_coefficient": 2.0}
    return truth.with_values({name: min(truth.value(name) * factor, 0.9) if name == "damping_ratio"
                              else truth.value(name) * factor for name, factor in factors.items()})


def _groups(source: Any) -> dict[float, list[list[Any]]]:
    """Noise level -> campaigns: each a record of every operating point, one campaign a repeat."""
    from testbed.cli._measured import records_of

    found: dict[float, dict[tuple[float, float], list[Any]]] = {}
    by_run = {f"run {run}": float(level) for run, level in zip(source.scenario_run, source.noise["displacement"],
                                                               strict=True)} if "displacement" in source.noise else {}
    for record in records_of(source):
        point = (record.conditions["spindle_speed"], record.conditions["axial_depth_of_cut"])
        found.setdefault(by_run.get(record.name, 0.0), {}).setdefault(point, []).append(record)
    groups = {}
    for level, points in found.items():
        count = min(len(records) for records in points.values())
        groups[level] = [[records[repeat] for records in points.values()] for repeat in range(count)]
    return groups


def _seeds(groups: dict[float, Any], levels: Sequence[float], repeats: int | None, data: object) -> dict[float, range]:
    """How often each level is identified; InputProblem for a level below the noise that is already there."""
    if repeats is None:
        return {level: range(len(groups[level])) for level in levels}
    quietest = min(groups)
    low = [level for level in levels if level < quietest]
    if low:
        raise InputProblem(data, f"already has {quietest * 1e6:g} um of noise; {low[0] * 1e6:g} um is less",
                           "run the scenario with less noise, or ask for more")
    # Where no noise is added there are only as many different campaigns as the data set holds.
    return {level: range(len(groups[quietest]) if level == quietest else repeats) for level in levels}


def _records(groups: dict[float, Any], add: bool, seed: int) -> Callable[[float, int], list[Any]]:
    """records(noise, number): one campaign at a noise level."""
    quietest = min(groups)

    def records(noise: float, number: int) -> list[Any]:
        if not add:
            return groups[noise][number]
        import numpy as np

        campaign = groups[quietest][number % len(groups[quietest])]
        more = math.sqrt(max(0.0, noise**2 - quietest**2))
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(round(noise * 1e12), number)))
        return [_noisier(record, more, rng) for record in campaign]

    return records


def _noisier(record: Any, noise: float, rng: Any) -> Any:
    recording = record.recording
    channels = dict(recording.channels)
    if "displacement" in channels:
        channels["displacement"] = channels["displacement"] + noise * rng.standard_normal(len(recording))
    return replace(record, recording=replace(recording, channels=channels))


def _identify(start: Any, records: Sequence[Any], method: str, data: object, catalogue: Any) -> Any:
    from testbed.cli._measured import identify_by_multipliers, identify_by_waveform

    if method == "multipliers":
        return identify_by_multipliers(start, records, data, 0).parameters
    return identify_by_waveform(start, records, data, catalogue, data).parameters


def _row(one: Any) -> tuple[str, ...]:
    unit = {"natural_frequency": "Hz", "damping_ratio": "1"}.get(one.parameter, "N/m^2")
    return (one.parameter, f"{one.noise * 1e6:g} um", *(shown(value, unit, 4) for value in
                                                      (one.truth, one.bias, one.spread, one.rms)),
            "-" if math.isnan(one.coverage) else f"{one.coverage:.0%}", f"{one.failures} of {one.count}")
