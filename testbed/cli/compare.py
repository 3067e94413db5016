"""`testbed compare`: the model refitted and every record predicted, and where it fails."""

from __future__ import annotations

import math
from typing import Any

import click

from testbed.api.words import interval_shown, shown
from testbed.cli._answer import Answer
from testbed.cli._options import effects_option, model_option, shared
from testbed.cli._places import output_folder


@click.command(short_help="Predict each record and show where the model fails.",
               epilog="Example: testbed compare campaign.yaml -m model.yaml -o pictures")
@click.argument("campaign", metavar="CAMPAIGN.yaml")
@model_option
@click.option("-o", "--output", metavar="DIR",
              help="Write report.html, and pictures of what is left unexplained as PNG and SVG, into this folder.")
@effects_option
@shared
def command(campaign: str, model_file: str, output: str | None, folders: tuple[str, ...], json_file: str | None,
            seed: int | None, quiet: bool) -> None:
    """Fit MODEL.yaml to the whole campaign, predict each record from a fit that left out its operating condition, and
    set the error against the noise: by record, by segment, by tooth angle, by frequency.

    error = rms(measured - predicted) / rms(measured about its mean). Nothing here is random: --seed changes nothing.
    """
    from testbed.api.compare import compare

    answer = Answer(json_file, quiet)
    pictures = output_folder(output) if output else None
    found = compare(campaign, model_file, effects=folders, progress=answer.watch)
    _say(answer, found.detail, [*found.remarks], found.believed, found.silence)
    if pictures is not None:
        paths = found.save_plots(pictures, answer.watch)
        report = found.report(pictures, answer.watch)
        answer.say(f"{len(paths)} pictures are in {pictures}; open {report}")
    answer.finish(found.to_dict())


def _say(answer: Answer, found: Any, notes: list[str], before: Any, silence: tuple[str, ...] = ()) -> None:
    from testbed.analysis.comparison.adequacy import LEFT_EXPLAINED, said_left
    from testbed.analysis.comparison.compare import used_part
    from testbed.analysis.fit.estimates import said_at_bound

    for note in notes:
        answer.say(note)
    answer.table(("record", "used", "error", "noise floor", "residual / noise", "what is left is"),
                 [(one.name, _used(used_part(own)), f"{one.error:.4f}", f"{one.noise_floor:.4f}", f"{one.chi_square**0.5:.2f}",
                   said_left(found.tests, one.name))
                  for one, own in zip(found.records, found.fitter.records, strict=True)])
    if not found.adequate:
        answer.say(LEFT_EXPLAINED)
    answer.say(f"all records: error {found.error:.4f}, noise floor {found.noise_floor:.4f}"
               + ("" if found.records[0].held_out else "; nothing was held out, for there is only one operating condition"))
    _segments(answer, found)
    answer.say()
    answer.table(("parameter", "believed", "found", "low", "high"),
                 [(path, shown(before.value(path), one.unit, path=path), *interval_shown(one, path))
                  for path, one in found.parameters.items()])
    if found.at_bound:
        answer.say(said_at_bound(found.at_bound))
    _nuisances(answer, found)
    if not found.fit.converged:
        answer.say("the fit did not converge: these are the numbers of its last step")
    for line in silence:
        answer.say(line)
    if not found.says_nothing:
        answer.say(_in_words(found))


def _used(part: dict[str, float]) -> str:
    share = "all" if part["share"] > 0.9995 else f"{100 * part['share']:.3g} %"
    return f"{share}: {part['start']:.5g} to {part['stop']:.5g} s"


def _in_words(found: Any) -> str:
    """What the error says of the model."""
    from testbed.analysis.search.diagnosis import FAINT_REST

    if found.against and found.error <= FAINT_REST * found.noise_floor:
        return f"little is left, but that does not speak for the model: {'; '.join(found.against)}"
    if found.adequate:
        return "the model explains every record down to its noise"
    if found.slight:
        return (f"the error is {found.error / found.noise_floor:.3f} times the noise floor: little more than noise is "
                "left; testbed diagnose says whether a known effect lowers it")
    return ("the model leaves more than noise. What it lacks may bend its parameters beyond their intervals: testbed diagnose "
            "says whether an effect is missing")


def _segments(answer: Answer, found: Any) -> None:
    kinds = [kind for kind in ("idle", "entry", "steady", "exit", "ring-down")
             if any(part.kind == kind for one in found.records for part in one.segments)]
    if not kinds:
        return
    rows = []
    for one in found.records:
        worst = {kind: max((part.chi_square for part in one.segments if part.kind == kind), default=None)
                 for kind in kinds}
        rows.append((one.name, *("-" if value is None else f"{value**0.5:.2f}" for value in worst.values())))
    answer.say()
    answer.table(("residual / noise in", *kinds), rows)


def _nuisances(answer: Answer, found: Any) -> None:
    cuts = [one for one in found.records if one.kind == "cut"]
    if not cuts:
        return
    answer.say()
    if "mark_angle" in found.nuisances:
        answer.say(f"the tachometer's mark comes {math.degrees(found.nuisances['mark_angle']):.2f} deg "
                   "after a tooth's entry")
    answer.table(("record", "true speed", "against stated", "entry", "exit"), [
        (one.name, shown(one.nuisances["spindle_speed"], "rad/s", 6), f"{100 * one.nuisances['speed_error']:+.3f} %",
         *(("-" if one.nuisances[key] is None else f"{one.nuisances[key]:.4f} s") for key in ("entry_time", "exit_time")))
        for one in cuts])
