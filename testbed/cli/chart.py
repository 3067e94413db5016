"""`testbed chart`: the stability chart of a machine, with recorded tests laid over it."""

from __future__ import annotations

from typing import Any

import click

from testbed.cli._answer import Answer, progress
from testbed.cli._options import (
    DEPTH,
    SPEED,
    catalogue_of,
    cutting_model,
    effects_option,
    guesses_note,
    in_the_work,
    refuse_planar_effects,
    shared,
)
from testbed.cli._places import output_folder
from testbed.cli._probable import RISK, Asked, chances, said_chances, unasked
from testbed.problem import InputProblem

MOST_CELLS = 4_000_000
PLANAR_PARTS = 4  # of a cell of a picture, along either axis: a cell of a machine in x and y costs up to a millisecond


@click.command(short_help="Stability chart over spindle speed and depth of cut.",
               epilog="Example: testbed chart model.yaml --speed 2500:4500:201 --depth 0.1:4:101 -o pictures")
@click.argument("model_file", metavar="MODEL.yaml")
@click.option("--speed", type=SPEED, required=True, help="Spindle speeds, rpm: FIRST:LAST:COUNT.")
@click.option("--depth", type=DEPTH, required=True, help="Axial depths of cut, mm: FIRST:LAST:COUNT.")
@click.option("--data", metavar="DATA", help="Tests to lay over it: an HDF5 data set or a campaign.yaml.")
@click.option("--campaign", metavar="CAMPAIGN.yaml",
              help="Fit the model to these records first, and draw machines from the fit.")
@click.option("--risk", type=RISK, default="5%", show_default=True, help="Chance of chatter that a recommended cut may have.")
@click.option("--draws", type=click.IntRange(20, 100_000), default=300, show_default=True,
              help="Machines drawn for the chance of stability.")
@click.option("-o", "--output", default=".", show_default=True, metavar="DIR",
              help="Folder for stability_chart.png and .svg, and probable_stability.png and .svg.")
@effects_option
@shared
def command(model_file: str, speed: list[float], depth: list[float], data: str | None, campaign: str | None,
            risk: float, draws: int, output: str, folders: tuple[str, ...], json_file: str | None, seed: int | None,
            quiet: bool) -> None:
    """Where MODEL.yaml cuts steadily and where it chatters, over spindle speed and depth of cut.

    Every cell has an estimate of its error; what cannot be trusted stays blank. A model with effects is linearised in every
    cell, effects and all, which takes about 20 ms a cell.

    Where the model has values with a deviation (`550 +- 50 N/mm^2`), or with --campaign, machines are drawn from what is known,
    and every cell gets its chance of being stable: the share of those machines that are. No chance is given where the model
    does not explain the campaign's records.
    """
    import numpy as np

    from testbed.analysis.linear.chart_plot import plot_chart, save
    from testbed.analysis.linear.stability import CLASSES, feed_note, sharpened_limit

    answer = Answer(json_file, quiet)
    if len(speed) * len(depth) > MOST_CELLS:
        raise click.UsageError(f"{len(speed) * len(depth)} cells: give at most {MOST_CELLS}")
    catalogue = catalogue_of(folders)
    model, left_out = in_the_work(cutting_model(model_file, catalogue))
    refuse_planar_effects(model, model_file)
    tests = _tests(model, data) if data else []
    folder = output_folder(output)
    speeds, depths = np.array(speed), np.array(depth)
    sure = unasked(draws, risk)
    if campaign or model.spreads:
        sure = chances(Asked(model, model_file, campaign, catalogue, speeds, depths, draws, seed or 0, risk, quiet))
    model = sure.model or model
    chart = with_effects(model, speeds, depths, catalogue, quiet) if model.effects else _linear(model, speeds, depths)
    known, notes = chart.classes >= 0, [*guesses_note(model), *left_out, *sure.notes, *filter(None, [feed_note(model)])]
    stable = f"{np.mean(chart.classes[known] == 0):.0%} stable" if known.any() else "none with multipliers to be trusted"
    answer.say(f"{len(speed)} x {len(depth)} cells, {stable}")
    if not known.all():
        still = "no periodic motion was found there, or " if model.effects else ""
        notes.append(f"{np.count_nonzero(~known)} cells are left blank: {still}their multipliers did not settle")
    for note in notes:
        answer.say(f"note: {note}")
    limit = chart.stability_limit() if model.effects else sharpened_limit(chart, model)
    guessed = f"guessed: {', '.join(model.not_determined)}" if model.not_determined else ""
    drawn = plot_chart(_drawn(chart, model), tests, guessed, title=feed_note(model))
    pictures = save(drawn, folder / "stability_chart")
    if sure.chance is not None:
        from testbed.analysis.probable.plot import plot_chance

        said_chances(answer, sure)
        pictures += save(plot_chance(sure.chance, limit, sure.recommended, risk), folder / "probable_stability")
    for path in pictures:
        answer.say(f"written: {path}")
    answer.finish({"spindle_speed": speeds, "axial_depth_of_cut": depths, "largest_multiplier": chart.largest,
                   "class": [[CLASSES[cell] if cell >= 0 else None for cell in row] for row in chart.classes.tolist()],
                   "error": chart.error, "stability_limit": limit, "stability_limit_lies": chart.limit_lies(),
                   "tests": tests, "notes": notes} | sure.as_json())


def _linear(model: Any, speeds: Any, depths: Any) -> Any:
    from testbed.analysis.linear.stability import stability_chart

    return stability_chart(model, speeds, depths)


def _drawn(chart: Any, model: Any) -> Any:
    """The chart for a picture, its borders finer than its cells; with effects, where a cell costs much, as it is."""
    from functools import partial

    from testbed.analysis.linear.chart_border import MOST_PARTS, refined

    most = PLANAR_PARTS if model.planar else MOST_PARTS
    return chart if model.effects else refined(chart, partial(_linear, model), most)


def with_effects(model: Any, speeds: Any, depths: Any, catalogue: Any, quiet: bool) -> Any:
    """The chart cell by cell. Over a period of several passes, the multiplier's modulus is given per tooth pass."""
    import numpy as np

    from testbed.analysis.linear.stability import CLASSES, StabilityChart
    from testbed.cli.multipliers import multipliers
    from testbed.cut import Cut

    largest = np.full((depths.size, speeds.size), np.nan + 0j)
    classes, error = np.full(largest.shape, -1, dtype=np.int8), np.full(largest.shape, np.nan)
    with progress("chart", quiet) as show:
        for place in range(largest.size):
            row, column = divmod(place, speeds.size)
            try:
                found = multipliers(model, Cut(speeds[column], depths[row]), catalogue, "chart")
            except InputProblem:  # no periodic motion here; the cell stays blank
                found = None
            if found is not None:
                value, wrong, share = complex(found["multipliers"][0]), float(found["error"][0]), 1.0 / found["period_passes"]
                if share < 1.0 and value:
                    wrong *= share * abs(value) ** (share - 1.0)
                    value *= abs(value) ** (share - 1.0)
                error[row, column] = wrong
                largest[row, column] = complex(value.real, abs(value.imag))
                classes[row, column] = CLASSES.index(found["class"])
            show(place + 1, largest.size)
    if np.isnan(largest).all():
        raise InputProblem("chart", "no cell has multipliers: an effect of the model leaves no periodic motion",
                           "leave out the effect")
    return StabilityChart(speeds, depths, largest, classes, error)


def _tests(model: Any, data: str) -> list[Any]:
    """The cuts of a data set or campaign with the class that their own multipliers show."""
    from testbed.analysis.linear.chart_plot import ChartTest
    from testbed.analysis.linear.stability import classify
    from testbed.analysis.multipliers.recorded_cut import measured_multipliers
    from testbed.cli._identification import cut_tests
    from testbed.cli._records import load_records

    flutes = model.cutter.flutes
    overlay = []
    for test in cut_tests(load_records(data), flutes, data):
        try:
            found = measured_multipliers(test.recording, test.cut, flutes, test.channel)
            outcome = str(classify(found.multipliers)) if found.believed else "undecided"
        except (ValueError, ArithmeticError):
            outcome = "undecided"
        overlay.append(ChartTest(test.cut.spindle_speed, test.cut.axial_depth_of_cut, outcome, test.name))
    return overlay
