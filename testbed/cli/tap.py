"""`testbed tap`: from hammer blows and frequency responses to the modes of a machine."""

from __future__ import annotations

from typing import Any

import click

from testbed.api.places import check_place
from testbed.api.words import interval_shown
from testbed.cli._answer import Answer
from testbed.cli._options import effects_option, shared
from testbed.cli._places import output_folder


@click.command(short_help="From hammer blows or frequency responses to a model of the machine.",
               epilog="Example: testbed tap taps.yaml -m cutter.yaml -o machine.yaml --report pictures")
@click.argument("taps_file", metavar="TAPS.yaml")
@click.option("-m", "--model", "model_file", metavar="MODEL.yaml",
              help="A model whose cutter, cutting and effects the new one takes over.")
@click.option("-o", "--output", metavar="NEW.yaml", help="The model to write: the modes found.")
@click.option("--report", metavar="DIR", help="Folder for report.html: responses, fits, coherence, poles, blows.")
@click.option("--modes", "most_modes", type=click.IntRange(1, 12),
              help="So many modes for each set of responses that belong together, instead of as many as the data ask for.")
@effects_option
@shared
def command(taps_file: str, model_file: str | None, output: str | None, report: str | None, most_modes: int | None,
            folders: tuple[str, ...], json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Find the modes that TAPS.yaml shows: natural frequency, damping ratio, mass and direction, each with an interval.

    Blows are found and split, double hits and overloads left out, sensors that are turned round told. How many modes there are
    follows from the data. Needs the extra package sdypy-EMA.
    """
    from testbed.api.tap import tap

    answer = Answer(json_file, quiet)
    check_place(output)
    folder = output_folder(report) if report else None
    found = tap(taps_file, model=model_file, modes=most_modes, effects=folders)
    _say(answer, found.detail)
    if output is not None:
        found.save_model(output)
        guessed = any(path.endswith("mass") for path in found.guessed)
        why = "scales disagree" if found.detail.groups else "no force was measured"
        answer.say(f"written: {output}" + (f". Its masses are guesses, for {why}" if guessed else ""))
    if folder is not None:
        answer.say(f"written: {found.report(folder)}")
    answer.finish(found.to_dict())


def _say(answer: Answer, found: Any) -> None:
    used = sum(blow.used for blow in found.blows)
    if found.blows:
        answer.say(f"{used} of {len(found.blows)} blows used")
    for blow in found.blows:
        if not blow.used:
            answer.say(f"left out: blow of {abs(blow.force):.4g} N at {blow.time:.4g} s in {blow.tap}: {blow.why}")
    for note in found.notes:
        answer.say(f"note: {note}")
    rows = []
    for number, mode in enumerate(found.modes):
        for name in ("natural_frequency", "damping_ratio", "mass", "direction"):
            rows.append((f"modes[{number}].{name}", *interval_shown(getattr(mode, name)), mode.on))
    answer.table(("parameter", "value", "low", "high", "on"), rows)
    answer.say(f"residual {found.residual:.1%} of the measured {'responses' if found.groups else 'decays'}")
