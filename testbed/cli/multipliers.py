"""`testbed multipliers`: the largest characteristic multipliers of a cut, and what they mean."""

from __future__ import annotations

import click

from testbed.api.multipliers import FEED
from testbed.cli._answer import Answer
from testbed.cli._options import DEPTH, SPEED, effects_option, shared
from testbed.problem import InputProblem


@click.command(short_help="Largest characteristic multipliers of a cut, and their class.",
               epilog="Example: testbed multipliers model.yaml --speed 3810 --depth 2.9")
@click.argument("model_file", metavar="MODEL.yaml")
@click.option("--speed", type=SPEED, required=True, help="Spindle speed, rpm.")
@click.option("--depth", type=DEPTH, required=True, help="Axial depth of cut, mm.")
@click.option("--feed", "feed_text", default=FEED, show_default=True,
              help="Feed; it matters only with effects that are not linear.")
@click.option("--count", type=click.IntRange(1, 50), default=6, show_default=True, help="How many to give.")
@effects_option
@shared
def command(model_file: str, speed: list[float], depth: list[float], feed_text: str, count: int,
            folders: tuple[str, ...], json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Largest characteristic multipliers of MODEL.yaml at one cut, largest modulus first: over a tooth passing period, or
    over a revolution where the teeth have different pitches.

    With effects, the whole loop is linearised about its periodic motion, over its principal period.
    """
    from testbed.api.multipliers import MEANING, multipliers
    from testbed.units import UnitProblem, parse_quantity

    answer = Answer(json_file, quiet)
    if len(speed) > 1 or len(depth) > 1:
        raise click.UsageError("give one speed and one depth; `testbed chart` takes ranges")
    try:
        feed = parse_quantity(feed_text, "m/tooth")
    except UnitProblem as problem:
        raise InputProblem("--feed", problem.what, problem.do) from None
    if feed <= 0:
        raise InputProblem("--feed", f"'{feed_text}' must be above 0", "correct the value")
    found = multipliers(model_file, speed[0], depth[0], feed=feed, count=count, effects=folders)
    for note in found.notes:
        answer.say(note)
    period = found.period_passes
    answer.say(f"{MEANING[found.stability]}, over {period} tooth passing period{'s' if period > 1 else ''}")
    answer.table(("multiplier", "modulus", "error below"),
                 [(f"{value:+.6f}", f"{abs(value):.6f}", f"{error:.0e}")
                  for value, error in zip(found.multipliers, found.error, strict=True)])
    answer.finish(found.to_dict())
