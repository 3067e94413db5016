"""`testbed diagnose`: which physical effect the believed model lacks, or none, or none of those known."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from testbed.analysis.fit.budget import BUDGET
from testbed.api.defaults import MANY
from testbed.api.words import shown
from testbed.cli._answer import Answer
from testbed.cli._options import effects_option, model_option, shared
from testbed.cli._places import output_folder

if TYPE_CHECKING:
    from testbed.api.diagnose import Diagnosis


@click.command(short_help="Say which physical effect is missing, or none, or none of those known.",
               epilog="Example: testbed diagnose campaign.yaml -m model.yaml --json diagnosis.json")
@click.argument("campaign", metavar="CAMPAIGN.yaml")
@model_option
@click.option("-o", "--output", metavar="DIR", help="Write the story as report.html into this folder.")
@click.option("--until-adequate", is_flag=True, help=f"Go on adding, up to {MANY} effects, until only noise is left.")
@click.option("--propose", metavar="DIR", help="Where the catalogue does not explain the records, estimate the missing force "
              "and write it into DIR as an effect file of your own.")
@click.option("--false-alarms", "alarms", type=click.IntRange(min=1), metavar="N",
              help="Repeat the diagnosis on N campaigns simulated without a hidden effect: how often is one named?")
@click.option("--decoys", is_flag=True, help="Offer laws that no machine has beside the real ones: none should be named.")
@click.option("--budget", type=click.FloatRange(min=1.0), default=BUDGET, show_default=True, metavar="N",
              help="End with what is known after N simulations of every record (counted, not timed: the same answer anywhere).")
@effects_option
@shared
def command(campaign: str, model_file: str, output: str | None, until_adequate: bool, propose: str | None,
            alarms: int | None, decoys: bool, budget: float, folders: tuple[str, ...], json_file: str | None,
            seed: int | None, quiet: bool) -> None:
    """Fit MODEL.yaml to the campaign, then with each effect of the catalogue, and compare on records held out of the fit.

    With one operating condition nothing can be held out: the errors are then those in the fit, and the answer says so.

    An honest "these records cannot tell" is an answer too. Only --false-alarms draws random numbers, from --seed.
    """
    from testbed.api.diagnose import diagnose
    from testbed.api.next_command import next_command
    from testbed.files.model_file import effect_text

    answer = Answer(json_file, quiet)
    folder = output_folder(output) if output else None
    if propose:
        output_folder(propose)
    found = diagnose(campaign, model_file, until_adequate=until_adequate, decoys=decoys, budget=budget, effects=folders,
                     progress=answer.watch)
    for note in found.notes:
        answer.note(note)
    catalogue, detail, said = found.known.known, found.detail, dict(found.said)
    next_step = next_command(detail, campaign, model_file, bool(propose), folders)
    _say(answer, detail, said, found.first, catalogue)
    if detail.form is not None:
        answer.say(f"with that law, model.yaml has: {effect_text(catalogue[detail.form.effect], detail.form.parameters)}")
    if next_step:
        answer.say(f"next: {next_step}")
    if decoys:
        _decoys(answer, said["decoys"])
    explanation = _propose(answer, found, propose) if propose else None
    if explanation is not None:
        said["proposal"] = explanation
    if alarms:
        said["false_alarms"] = _false_alarms(answer, found, alarms, seed or 0)
    if folder is not None:
        answer.say(f"open {found.report(folder, said=said, next_step=next_step)}")
    answer.finish(said)


def _propose(answer: Answer, found: Diagnosis, folder: str) -> Any:
    """What force is missing, what it depends on, and where it was written as an effect; None where nothing is left."""
    proposal = found.propose(folder, progress=answer.watch)
    if proposal is None:
        answer.say("only noise is left: there is nothing to propose an effect for")
        return None
    answer.say()
    answer.say(proposal.sentence)
    if proposal.next_step:
        answer.say(f"next: {proposal.next_step}")
    return proposal.to_dict()


def _decoys(answer: Answer, told: Any) -> None:
    named = told["named"]
    count = len(told["offered"])
    answer.say(f"{', '.join(named)} is a law that no machine has: do not trust what this campaign seems to show"
               if named else f"{count} laws that no machine has were offered beside the real ones; none was named")


def _false_alarms(answer: Answer, found: Diagnosis, count: int, seed: int) -> Any:
    told = found.false_alarms(count, seed, progress=answer.watch)
    low, high = told.interval
    answer.say(f"{count} campaigns were simulated at these conditions and noise with nothing hidden; in {told.alarms} an "
               f"effect was named: a false-alarm rate of {low:.1%} to {high:.1%} (95 %)")
    return told.to_dict()


def _without(before: Any, step: Any) -> str:
    """In words, which effects of the step before a later one made needless."""
    dropped = [name for name in before.effects if name not in step.effects]
    return f" (no longer {', '.join(dropped)})" if dropped else ""


def _say(answer: Answer, found: Any, said: Any, first: str, catalogue: Any) -> None:
    """first: what the step before anything is added is called."""
    from testbed.catalogue import titled

    answer.say(found.verdict.replace("_", " ") + (f": {titled(found.effects, catalogue)}" if found.effects else ""))
    answer.say(found.sentence)
    held = ("held out",) if found.held_out else ()
    rows = [(" + ".join(one.effects), f"{one.error_fit:.4f}", *(f"{one.error_held_out:.4f}" for _ in held),
             f"{one.delta_bic:.1f}", "yes" if one.converged else "no", catalogue[one.effects[-1]].title)
            for one in found.fitted]
    if rows:
        answer.say()
        answer.table(("tried", "error in the fit", *held, "gain in BIC", "converged", "what it is"), rows)
        if found.ruled_out:
            answer.say(f"ruled out by a first step: {titled(found.ruled_out, catalogue)}")
    answer.say()
    error = "error, held out" if found.held_out else "error, in the fit"
    answer.table((error, "value"), [(name.replace("_", " "), f"{value:.4f}") for name, value in said["error"].items()])
    if not found.held_out:
        answer.say("nothing was held out, for there is only one operating condition")
    answer.say()
    answer.table(("parameter", "believed", "refitted"),
                 [(name, shown(one["before"], one["unit"]), shown(one["after"], one["unit"]))
                  for name, one in said["base_parameters"].items()])
    if len(found.steps) > 1:
        answer.say()
        answer.table(("step", "effects", error, "noise floor"),
                     [(str(number), " + ".join(step.effects) + _without(before, step) or first,
                       f"{step.error_held_out:.4f}", f"{found.noise_floor:.4f}")
                      for number, (before, step) in enumerate(zip((found.steps[0], *found.steps), found.steps, strict=False))])
    if found.next_test is not None:
        test = found.next_test
        answer.say(f"a cut at {test.spindle_speed * 30 / math.pi:.0f} rpm, {test.depth_of_cut * 1e3:.2f} mm would tell "
                   f"{' from '.join(found.separates)} best: there they differ by {test.difference:.1f} times the noise")
