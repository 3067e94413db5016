"""`testbed add`: effects join the model, everything is refitted, and the error falls, or does not."""

from __future__ import annotations

from typing import Any

import click

from testbed.api.places import check_place
from testbed.api.words import interval_shown
from testbed.cli._answer import Answer
from testbed.cli._options import effects_option, model_option, shared
from testbed.cli._places import output_folder


@click.command(short_help="Add an effect, refit, and print the error before and after.",
               epilog="Example: testbed add process_damping -m model.yaml -c campaign.yaml -o better.yaml")
@click.argument("names", metavar="EFFECT...", nargs=-1, required=True)
@model_option
@click.option("-c", "--campaign", required=True, metavar="CAMPAIGN.yaml", help="What was measured.")
@click.option("-o", "--output", required=True, metavar="NEW.yaml",
              help="Write the model with the effect, refitted, unless it ends at nothing; an older model there is replaced.")
@click.option("--report", metavar="DIR", help="Write the error before and after as report.html into this folder.")
@effects_option
@shared
def command(names: tuple[str, ...], model_file: str, campaign: str, output: str, report: str | None, folders: tuple[str, ...],
            json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Add EFFECT, or several of them, to MODEL.yaml, fit all parameters jointly to the campaign, and write NEW.yaml.

    The errors before and after are those on records whose operating condition the fit left out. Intervals are 95 %.
    Nothing here is random: --seed changes nothing.
    """
    from testbed.api.add import add
    from testbed.catalogue import titled

    answer = Answer(json_file, quiet)
    check_place(output)
    folder = output_folder(report) if report else None
    found = add(names, campaign, model_file, effects=folders, progress=answer.watch)
    gone, catalogue = found.vanished, found.known.known
    if not gone:
        found.save_model(output)
    answer.say(f"added: {titled(names, catalogue)}")
    _say(answer, found.detail, [*found.notes])
    answer.say(f"not written: {titled(gone, catalogue)} ended where it does nothing, so these records do not show it" if gone
               else f"written: {output}")
    if folder is not None:
        answer.say(f"open {found.report(folder)}")
    answer.finish(found.to_dict())


def _say(answer: Answer, found: Any, notes: list[str]) -> None:
    for note in notes:
        answer.note(note)
    rows = [(one.name, f"{one.error:.4f}", f"{other.error:.4f}", f"{other.noise_floor:.4f}")
            for one, other in zip(found.records_before, found.records_after, strict=True)]
    rows.append(("all records", f"{found.before:.4f}", f"{found.after:.4f}", f"{found.noise_floor:.4f}"))
    answer.table(("held out" if found.held_out else "in the fit", "error before", "after", "noise floor"), rows)
    answer.say()
    answer.table(("parameter", "value", "low", "high"),
                 [(path, *interval_shown(one))
                  for path, one in found.parameters.items()])
    for warning in found.warnings:
        answer.say(f"warning: {warning}")
