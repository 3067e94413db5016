"""`testbed plan`: the cut that is worth making next."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from testbed.api.plan import DEPTHS, MOST_CUTS, SPEEDS
from testbed.cli._answer import Answer
from testbed.cli._options import DEPTH, RISK, SPEED, effects_option, model_option, shared

if TYPE_CHECKING:
    from testbed.api.plan import Plan


class _Ends(click.ParamType):
    """FIRST:LAST, or FIRST:LAST:COUNT, in the unit of a range; becomes a list of SI floats."""

    def __init__(self, of: Any, count: int) -> None:
        self.of, self.count, self.name = of, count, of.name

    def convert(self, value: Any, parameter: click.Parameter | None, context: click.Context | None) -> list[float]:
        """SI values; click's error where the text is no range."""
        if isinstance(value, list):
            return value
        return self.of.convert(f"{value}:{self.count}" if value.count(":") == 1 else value, parameter, context)


@click.command(short_help="The cuts worth making next: what each is expected to tell.",
               epilog="Example: testbed plan campaign.yaml -m model.yaml --speed 2500:4500 --depth 0.5:4")
@click.argument("campaign", metavar="CAMPAIGN.yaml")
@model_option
@click.option("--speed", type=_Ends(SPEED, SPEEDS), required=True,
              help=f"Spindle speeds within reach, rpm: FIRST:LAST[:{SPEEDS}].")
@click.option("--depth", type=_Ends(DEPTH, DEPTHS), required=True,
              help=f"Axial depths within reach, mm: FIRST:LAST[:{DEPTHS}].")
@click.option("--risk", type=RISK, default="5%", show_default=True, help="Chance of chatter that a cut may have.")
@click.option("--draws", type=click.IntRange(20, 100_000), default=300, show_default=True,
              help="Machines drawn for the chance of stability.")
@click.option("--count", type=click.IntRange(1, 100), default=5, show_default=True, help="How many cuts to give.")
@effects_option
@shared
def command(campaign: str, model_file: str, speed: list[float], depth: list[float], risk: float, draws: int, count: int,
            folders: tuple[str, ...], json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Rank the cuts within reach that are stable at the stated risk by what they are expected to tell in a minute of cutting:
    about the machine's parameters, and about which effect is missing where the campaign leaves that open.

    Fits MODEL.yaml as `testbed compare` does; where that leaves more than noise, makes the diagnosis. After "unexplained" no
    cut is called safe, and none is planned.
    """
    from testbed.api.plan import plan

    answer = Answer(json_file, quiet)
    if len(speed) * len(depth) > MOST_CUTS:
        raise click.UsageError(f"{len(speed) * len(depth)} cuts: give at most {MOST_CUTS}")
    found = plan(campaign, model_file, speed, depth, risk=risk, draws=draws, count=count, seed=seed or 0, effects=folders,
                 progress=answer.watch)
    if found.no_plan is not None:
        answer.say(f"no cut is planned: {found.no_plan}")
    else:
        for note in found.notes:
            answer.say(f"note: {note}")
        _say(answer, found)
    answer.finish(found.to_dict())


def _say(answer: Answer, planned: Plan) -> None:
    found = planned.next
    if not found:
        answer.say(f"no cut within reach is stable at a risk of {planned.risk:.3g}: give other speeds, or smaller depths")
        return
    several = len(planned.explanations) > 1
    told = (("of which explanation", "tells apart"), ) if several else ((),)
    answer.table(("speed", "depth", "stable", "information", "a minute", *told[0]),
                 [(f"{one.spindle_speed * 30 / math.pi:.0f} rpm", f"{one.axial_depth_of_cut * 1e3:.3g} mm",
                   f"{one.stable_probability:.1%}", f"{one.information:.2f}", f"{one.information_per_minute:.0f}",
                   *((f"{one.of_explanations:.2f}", ", ".join(one.separates) or "none") if several else ()))
                  for one in found])
    answer.say("information in nats: 1 nat narrows one parameter 2.7 times")
    best = found[0]
    for name, channels in best.expects.items():
        seen = ", ".join(f"{size * 1e6:.4g} um" if channel.startswith("displacement") else f"{size:.4g} ({channel}, SI)"
                         for channel, size in channels.items())
        answer.say(f"at the first, if it is {name}: {seen} peak to peak while it cuts")
