"""`testbed diagnose`: which physical effect the believed model lacks, or none, or none of those known."""

from __future__ import annotations

from typing import Any

import click

from testbed.cli._answer import Answer, shown
from testbed.cli._options import catalogue_of, effects_option, model_option, shared


@click.command(short_help="Say which physical effect is missing, or none, or none of those known.",
               epilog="Example: testbed diagnose campaign.yaml -m model.yaml --json diagnosis.json")
@click.argument("campaign", metavar="CAMPAIGN.yaml")
@model_option
@effects_option
@shared
def command(campaign: str, model_file: str, folders: tuple[str, ...], json_file: str | None, seed: int | None,
            quiet: bool) -> None:
    """Fit MODEL.yaml to the campaign, then with each effect of the catalogue, and compare on records held out of the fit.

    An honest "these records cannot tell" is an answer too. Nothing here is random: --seed changes nothing.
    """
    from analysis.diagnose import as_json, diagnose
    from testbed.cli._fitting import plant_of, read_both, sign_of_life, uncalibrated

    answer = Answer(json_file, quiet)
    catalogue = catalogue_of(folders)
    model, records, read = read_both(campaign, model_file, catalogue)
    with sign_of_life("fitting the believed model to all records", quiet) as say:
        found = diagnose(plant_of(catalogue), records, model, catalogue, say=say)
    for note in uncalibrated(read):
        answer.say(note)
    _say(answer, found, as_json(found, model), campaign, model_file)
    answer.finish({"next_test": None} | as_json(found, model))


def _say(answer: Answer, found: Any, said: Any, campaign: str, model_file: str) -> None:
    answer.say(f"{found.verdict.replace('_', ' ')}: {', '.join(found.effects)}" if found.effects
               else found.verdict.replace("_", " "))
    answer.say(found.sentence)
    rows = [(" + ".join(one.effects), f"{one.error_fit:.4f}", f"{one.error_held_out:.4f}", f"{one.delta_bic:.1f}",
             "yes" if one.converged else "no") for one in found.candidates if one.fit is not None]
    if rows:
        answer.say()
        answer.table(("tried", "error in the fit", "held out", "gain in BIC", "converged"), rows)
        others = [one.effects[-1] for one in found.candidates if one.fit is None]
        if others:
            answer.say(f"ruled out by a first step: {', '.join(others)}")
    answer.say()
    answer.table(("error, held out", "value"), [(name.replace("_", " "), f"{value:.4f}")
                                                for name, value in said["error"].items()])
    answer.say()
    answer.table(("parameter", "believed", "refitted"),
                 [(name, shown(one["before"], one["unit"]), shown(one["after"], one["unit"]))
                  for name, one in said["base_parameters"].items()])
    if found.verdict == "missing_effect":
        answer.say(f"next: testbed add {found.effects[0]} -m {model_file} -c {campaign} -o NEW.yaml")
