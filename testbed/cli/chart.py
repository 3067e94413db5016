"""`testbed chart`: the stability chart of a machine, with recorded tests laid over it."""

from __future__ import annotations

import math
from typing import Any

import click

from testbed.api.words import shown
from testbed.cli._answer import Answer
from testbed.cli._options import DEPTH, RISK, SPEED, effects_option, shared
from testbed.cli._places import output_folder


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
@click.option("--page", is_flag=True, help="Also write chart.html: drag speed and depth, and hear simulated cuts.")
@effects_option
@shared
def command(model_file: str, speed: list[float], depth: list[float], data: str | None, campaign: str | None,
            risk: float, draws: int, output: str, page: bool, folders: tuple[str, ...], json_file: str | None, seed: int | None,
            quiet: bool) -> None:
    """Where MODEL.yaml cuts steadily and where it chatters, over spindle speed and depth of cut.

    Every cell has an estimate of its error; what cannot be trusted stays blank. A model with effects is linearised in every
    cell, effects and all, which takes about 20 ms a cell, in x and y 0.1 to 0.3 s.

    Where the model has values with a deviation (`550 +- 50 N/mm^2`), or with --campaign, machines are drawn from what is known,
    and every cell gets its chance of being stable: the share of those machines that are. No chance is given where the model
    does not explain the campaign's records.
    """
    from testbed.api.chart import MOST_CELLS, chart

    answer = Answer(json_file, quiet)
    if len(speed) * len(depth) > MOST_CELLS:
        raise click.UsageError(f"{len(speed) * len(depth)} cells: give at most {MOST_CELLS}")
    folder = output_folder(output)
    found = chart(model_file, speed, depth, data=data, campaign=campaign, risk=risk, draws=draws, seed=seed or 0,
                  effects=folders, progress=answer.watch)
    known = found.detail.classes >= 0
    stable = f"{(found.detail.classes[known] == 0).mean():.0%} stable" if known.any() else "none with multipliers to be trusted"
    answer.say(f"{len(speed)} x {len(depth)} cells, {stable}")
    for note in found.notes:
        answer.say(f"note: {note}")
    if found.sure.chance is not None:
        said_chances(answer, found.sure)
    for path in found.save_plots(folder):
        answer.say(f"written: {path}")
    if page:
        answer.say(f"open {found.report(folder / 'chart.html', effects=folders, progress=answer.watch)}")
    answer.finish(found.to_dict())


def said_chances(answer: Answer, sure: Any) -> None:
    """What was drawn, and the cut recommended, for people."""
    answer.table(("drawn", "value", "standard deviation"),
                 [(one["parameter"], shown(one["value"], one["unit"]), shown(one["standard_deviation"], one["unit"], 3))
                  for one in sure.drawn])
    best = sure.recommended
    if best is None:
        answer.say(f"no cut of the chart is stable at a risk of {sure.risk:.3g}, as far as {sure.draws} machines tell")
        return
    answer.say(f"most removal at a risk of at most {sure.risk:.3g}: {best.spindle_speed * 30 / math.pi:.0f} rpm, "
               f"{best.axial_depth_of_cut * 1e3:.4g} mm, stable in {best.stable_probability:.1%} of the machines")
