"""`testbed add`: effects join the model, everything is refitted, and the error falls, or does not."""

from __future__ import annotations

from typing import Any

import click

from testbed.cli._answer import Answer, interval_shown
from testbed.cli._options import catalogue_of, effects_option, model_option, shared
from testbed.cli._places import check_place, output_folder
from testbed.problem import InputProblem


@click.command(short_help="Add an effect, refit, and print the error before and after.",
               epilog="Example: testbed add process_damping -m model.yaml -c campaign.yaml -o better.yaml")
@click.argument("names", metavar="EFFECT...", nargs=-1, required=True)
@model_option
@click.option("-c", "--campaign", required=True, metavar="CAMPAIGN.yaml", help="What was measured.")
@click.option("-o", "--output", required=True, metavar="NEW.yaml",
              help="Write the model with the effect, refitted; an older model there is replaced.")
@click.option("--report", metavar="DIR", help="Write the error before and after as report.html into this folder.")
@effects_option
@shared
def command(names: tuple[str, ...], model_file: str, campaign: str, output: str, report: str | None, folders: tuple[str, ...],
            json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Add EFFECT, or several of them, to MODEL.yaml, fit all parameters jointly to the campaign, and write NEW.yaml.

    The errors before and after are those on records whose operating condition the fit left out. Intervals are 95 %.
    Nothing here is random: --seed changes nothing.
    """
    from testbed.analysis.fit.plausible import unlike_a_machine
    from testbed.analysis.search.add_effect import add_effects, as_json
    from testbed.cli._fitting import channel_units, engine_of, notes_on, read_both, sign_of_life
    from testbed.files.model_file import write_model

    answer = Answer(json_file, quiet)
    check_place(output)
    folder = output_folder(report) if report else None
    catalogue = catalogue_of(folders)
    effects = _effects(names, catalogue)
    model, records, read = read_both(campaign, model_file, catalogue)
    for name in names:
        if name in model.effects:
            raise InputProblem(model_file, f"has {name} already",
                               "take it out first, or see testbed identify --method waveform")
    try:
        with sign_of_life(f"adding {' and '.join(names)}", quiet) as progress:
            found = add_effects(engine_of(catalogue), records, model, effects, catalogue, progress)
    except InputProblem:
        raise
    except ValueError as problem:
        raise InputProblem(campaign, str(problem), "add a record that shows it") from None
    write_model(found.model, output, catalogue, unlike_a_machine(found.model))
    notes = notes_on(read, model)
    _say(answer, found, notes)
    answer.say(f"written: {output}")
    if folder is not None:
        from testbed.analysis.report.story_page import addition_page

        page = addition_page(found, records, model, channel_units(read),
                             notes=[f"{campaign} against {model_file}", *notes])
        answer.say(f"open {page.write(folder / 'report.html')}")
    answer.finish(as_json(found) | {"notes": notes})


def _effects(names: tuple[str, ...], catalogue: Any) -> list[Any]:
    from testbed.catalogue import unknown_effect

    for place, name in enumerate(names):
        if name not in catalogue:
            raise InputProblem(name, "unknown effect", unknown_effect(name, catalogue, "testbed effects lists them"))
        if name in names[:place]:
            raise InputProblem(name, "named twice", "name every effect once")
    return [catalogue[name] for name in names]


def _say(answer: Answer, found: Any, notes: list[str]) -> None:
    for note in notes:
        answer.say(note)
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
