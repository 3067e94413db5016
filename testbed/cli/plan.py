"""`testbed plan`: the cut that is worth making next."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import click

from testbed.cli._answer import Answer, progress
from testbed.cli._options import DEPTH, SPEED, catalogue_of, effects_option, model_option, shared
from testbed.cli._probable import RISK, Asked, Sure, linear_where_it_can, with_chances
from testbed.problem import InputProblem

SPEEDS, DEPTHS = 11, 6  # looked at where no number of them is given
MOST_CUTS = 2_000


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
    import numpy as np

    from testbed.analysis.probable.plan import plan
    from testbed.cli._fitting import engine_of, read_both

    answer = Answer(json_file, quiet)
    if len(speed) * len(depth) > MOST_CUTS:
        raise click.UsageError(f"{len(speed) * len(depth)} cuts: give at most {MOST_CUTS}")
    catalogue = catalogue_of(folders)
    model, records, _ = read_both(campaign, model_file, catalogue)
    cuts = [record for record in records if record.kind == "cut"]
    if not cuts:
        raise InputProblem(campaign, "holds no cut", "record one: what a cut shows is foretold from those there are")
    open_, why = _explanations(engine_of(catalogue), records, model, catalogue, quiet)
    said: dict[str, Any] = {"next": [], "explanations": [one.name for one in open_], "no_plan": why, "risk": risk,
                            "draws": draws, "candidates": len(speed) * len(depth), "notes": []}
    if why is not None:
        answer.say(f"no cut is planned: {why}")
        answer.finish(said)
        return
    asked = Asked(model, model_file, campaign, catalogue, np.array(speed), np.array(depth), draws, seed or 0, risk, quiet)
    stable, said["notes"] = _stable(open_, asked)
    within = [(at, b, float(stable[row, column])) for row, b in enumerate(depth) for column, at in enumerate(speed)
              if b > 0.0 and stable[row, column] * draws / (draws + 1.0) >= 1.0 - risk]
    with progress("cuts foretold", quiet) as show:
        found = plan(engine_of(catalogue), max(cuts, key=lambda one: one.samples), open_, within, show)
    said["next"] = [_as_json(one) for one in found[:count]]
    for note in said["notes"]:
        answer.say(f"note: {note}")
    _say(answer, found[:count], said)
    answer.finish(said)


def _explanations(engine: Any, records: Any, model: Any, catalogue: Any, quiet: bool) -> tuple[list[Any], str | None]:
    """What the records leave open, each with what it would make of the machine, or why nothing can be said."""
    from testbed.analysis.comparison.compare import compare
    from testbed.analysis.fit.estimates import estimates
    from testbed.analysis.probable.plan import Explanation
    from testbed.analysis.probable.posterior import posterior, why_no_chance
    from testbed.analysis.search.diagnose import diagnose, rivals_of
    from testbed.cli._fitting import sign_of_life

    with sign_of_life("fitting the believed model to all records", quiet) as progress:
        found = compare(engine, records, model, catalogue)
        why = why_no_chance(found)
        if not why:
            told = posterior(found.fitter, found.fit, found.parameters, model, catalogue)
            return [Explanation("the model as it is", told.known, told.wider)], None
        if found.says_nothing or found.adequate or found.against:
            return [], why
        diagnosis = diagnose(engine, records, model, catalogue, progress=progress)
        open_ = []
        for one in rivals_of(diagnosis):
            told = posterior(one.fitter, one.fit, estimates(one.fitter, one.fit, catalogue), model, catalogue)
            open_.append(Explanation(" + ".join(one.effects), told.known, told.wider))
    return open_, None if open_ else f"{diagnosis.verdict.replace('_', ' ')}: {diagnosis.sentence}"


def _stable(open_: list[Any], asked: Asked) -> tuple[Any, list[str]]:
    """The chance of every cell over the explanations, all as likely, and notes: NaN where none is known of one of them.

    Where a law leaves no periodic motion to linearise about, the machine without its effects counts.
    """
    import numpy as np

    total, notes = np.zeros((asked.depths.size, asked.speeds.size)), []
    for one in open_:
        known, _ = linear_where_it_can(one.known)
        sure = with_chances(Sure(asked.draws, asked.risk, known=known), replace(asked, model=known.model))
        if sure.chance is None:
            raise InputProblem(asked.campaign, f"of {one.name}, {sure.why_none}", "record more cuts")
        notes += [f"{one.name}: {note}" for note in sure.notes if "deepest" not in note]
        chance = sure.chance.probability
        if np.isnan(chance).any() and known.model.effects:
            linear = with_chances(Sure(asked.draws, asked.risk, known=known.without_effects()), asked).chance
            notes.append(f"{one.name}: where it leaves no periodic motion, the chance is that of the machine without it")
            chance = np.where(np.isnan(chance), linear.probability, chance)
        total += chance / len(open_)
    return np.nan_to_num(total), list(dict.fromkeys(notes))


def _as_json(one: Any) -> dict[str, Any]:
    return vars(one) | {"information_per_minute": one.information_per_minute}


def _say(answer: Answer, found: list[Any], said: dict[str, Any]) -> None:
    if not found:
        answer.say(f"no cut within reach is stable at a risk of {said['risk']:.3g}: give other speeds, or smaller depths")
        return
    several = len(said["explanations"]) > 1
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
