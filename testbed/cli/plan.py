"""`testbed plan`: the cut that is worth making next."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import click

from testbed.cli._answer import Answer, progress, shown
from testbed.cli._options import DEPTH, SPEED, catalogue_of, effects_option, model_option, shared
from testbed.cli._probable import RISK, Asked, Length, Sure, linear_where_it_can, of_beliefs, with_chances
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
@click.option("--vibration", type=Length(), metavar="LENGTH",
              help="The most that a cut may be expected to vibrate, peak to peak, such as 0.2mm.")
@click.option("--draws", type=click.IntRange(20, 100_000), default=300, show_default=True,
              help="Machines drawn for the chance of stability.")
@click.option("--count", type=click.IntRange(1, 100), default=5, show_default=True, help="How many cuts to give.")
@effects_option
@shared
def command(campaign: str, model_file: str, speed: list[float], depth: list[float], risk: float, vibration: float | None,
            draws: int, count: int, folders: tuple[str, ...], json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Rank the cuts within reach that are stable at the stated risk by what they are expected to tell in a minute of cutting:
    about the machine's parameters, and about which effect is missing where the campaign leaves that open. --vibration leaves
    out those that may move the structure by more, two standard deviations of what is known counted.

    Fits MODEL.yaml as `testbed compare` does; where that leaves more than noise, makes the diagnosis. After "unexplained" no
    cut is called safe, and none is planned.
    """
    import numpy as np

    from testbed.analysis.probable.plan import plan
    from testbed.cli._fitting import plant_of, read_both

    answer = Answer(json_file, quiet)
    if len(speed) * len(depth) > MOST_CUTS:
        raise click.UsageError(f"{len(speed) * len(depth)} cuts: give at most {MOST_CUTS}")
    catalogue = catalogue_of(folders)
    model, records, _ = read_both(campaign, model_file, catalogue, planar=True)
    cuts = [record for record in records if record.kind == "cut"]
    if not cuts:
        raise InputProblem(campaign, "holds no cut", "record one: what a cut shows is foretold from those there are")
    open_, why, beliefs = _explanations(plant_of(catalogue), records, model, catalogue, quiet)
    said: dict[str, Any] = {"next": [], "explanations": [one.name for one in open_], "no_plan": why, "risk": risk,
                            "most_vibration": vibration, "draws": draws, "candidates": len(speed) * len(depth), "notes": []}
    if why is not None:
        answer.say(f"no cut is planned: {why}")
        answer.finish(said)
        return
    asked = Asked(model, model_file, campaign, catalogue, np.array(speed), np.array(depth), draws, seed or 0, risk, quiet)
    stable, notes = _stable(open_, asked)
    within = [(at, b, float(stable[row, column])) for row, b in enumerate(depth) for column, at in enumerate(speed)
              if b > 0.0 and stable[row, column] * draws / (draws + 1.0) >= 1.0 - risk]
    with progress("cuts foretold", quiet) as show:
        found = plan(plant_of(catalogue), max(cuts, key=lambda one: one.samples), open_, within, show)
    calm = [one for one in found if vibration is None or one.vibration <= vibration]
    if vibration is not None and len(calm) < len(found):
        notes.append(f"{len(found) - len(calm)} of the {len(found)} cuts that are stable at that risk may vibrate by more than "
                     f"{shown(vibration, 'm')}: left out")
    found = calm
    said |= {"next": [_as_json(one) for one in found[:count]], "notes": [*beliefs, *notes]}
    for note in said["notes"]:
        answer.say(f"note: {note}")
    _say(answer, found[:count], said)
    answer.finish(said)


def _explanations(plant: Any, records: Any, model: Any, catalogue: Any, quiet: bool
                  ) -> tuple[list[Any], str | None, list[str]]:  # fmt: skip
    """What the records leave open, each with what it would make of the machine; why nothing can be said; what was believed."""
    from testbed.analysis.comparison.compare import compare
    from testbed.analysis.fit.estimates import estimates
    from testbed.analysis.probable.plan import Explanation
    from testbed.analysis.probable.posterior import posterior, why_no_chance
    from testbed.analysis.search.diagnose import diagnose, rivals_of
    from testbed.cli._fitting import sign_of_life

    with sign_of_life("fitting the believed model to all records", quiet) as say:
        found = compare(plant, records, model, catalogue)
        why = why_no_chance(found)
        if not why:
            told = posterior(found.fitter, found.fit, found.parameters, model, catalogue)
            return [Explanation("the model as it is", told.known, told.wider)], None, of_beliefs(told, model, catalogue)
        if found.says_nothing or found.adequate or found.against or model.planar:
            return [], why, []
        diagnosis = diagnose(plant, records, model, catalogue, say=say)
        open_ = []
        for one in rivals_of(diagnosis):
            assert one.fitter is not None and one.fit is not None  # of a rival
            told = posterior(one.fitter, one.fit, estimates(one.fitter, one.fit, catalogue), model, catalogue)
            open_.append(Explanation(" + ".join(one.effects), told.known, told.wider))
    return open_, None if open_ else f"{diagnosis.verdict.replace('_', ' ')}: {diagnosis.sentence}", []


def _stable(open_: list[Any], asked: Asked) -> tuple[Any, list[str]]:
    """The chance of every cell over the explanations, all as likely, and notes: NaN where none is known of one of them.

    Where a law leaves no periodic motion to linearise about, and in x and y, the machine without its effects counts.
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
            notes.append(f"{one.name}: where its loop is not linearised, the chance is that of the machine without it")
            chance = np.where(np.isnan(chance), linear.probability, chance)
        total += chance / len(open_)
    return np.nan_to_num(total), list(dict.fromkeys(notes))


def _as_json(one: Any) -> dict[str, Any]:
    return vars(one) | {"information_per_minute": one.information_per_minute}


def _say(answer: Answer, found: list[Any], said: dict[str, Any]) -> None:
    if not found:
        calm = "" if said["most_vibration"] is None else " and calm enough"
        answer.say(f"no cut within reach is stable at a risk of {said['risk']:.3g}{calm}: give other speeds, or smaller depths")
        return
    several = len(said["explanations"]) > 1
    told = ("of which explanation", "tells apart") if several else ()
    answer.table(("speed", "depth", "stable", "vibrates by up to", "information", "a minute", *told),
                 [(f"{one.spindle_speed * 30 / math.pi:.0f} rpm", f"{one.axial_depth_of_cut * 1e3:.3g} mm",
                   f"{one.stable_probability:.1%}", f"{one.vibration * 1e6:.3g} um", f"{one.information:.2f}",
                   f"{one.information_per_minute:.0f}",
                   *((f"{one.of_explanations:.2f}", ", ".join(one.separates) or "none") if several else ()))
                  for one in found])
    answer.say("information in nats: 1 nat narrows one parameter 2.7 times; a minute of cutting. Vibration: peak to peak")
    best = found[0]
    for name, channels in best.expects.items():
        seen = ", ".join(_size(channel, size) for channel, size in channels.items())
        answer.say(f"at the first, if it is {name}: {seen} peak to peak while it cuts")


def _size(channel: str, size: float) -> str:
    if "displacement" not in channel:
        return f"{size:.4g} ({channel}, SI)"
    return f"{size * 1e6:.4g} um" + ("" if channel == "displacement" else f" ({channel})")
