"""`testbed init`: files to start from, with the columns, units and rates that were found in your own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from testbed.cli._answer import Answer
from testbed.cli._places import output_folder
from testbed.problem import InputProblem

PUBLISHED = ("silverbox", "milling-force", "tap-test", "milling-chatter", "titanium-milling", "plate-hammer")


@click.command(short_help="Write a model, a campaign and a scenario to start from.",
               epilog="Example: testbed init cut_3810rpm_2.9mm.csv tap_1.csv -o my-rig")
@click.argument("files", metavar="[FILE...]", nargs=-1)
@click.option("-o", "--output", default=".", show_default=True, metavar="DIR", help="The folder to write them into.")
@click.option("--set", "published", type=click.Choice(PUBLISHED), metavar="NAME",
              help=f"The files are a published set's: {', '.join(PUBLISHED)}. Only campaign.yaml is written.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def command(files: tuple[str, ...], output: str, published: str | None, quiet: bool) -> None:
    """Write model.yaml, campaign.yaml and scenario.yaml to start from; none that is there already is touched.

    FILE: measured files. The campaign names them, with the columns, units and sampling rates found in them, and with speeds and
    depths that their names tell (cut_3810rpm_2.9mm.csv). What nobody can guess is FILL_IN, to be replaced. Hammer blows with
    their force (hammer_x.csv, tap_y.csv) are named in a taps.yaml, too.
    """
    from testbed.files.starter import MODEL, SCENARIO, campaign_text, channels_of, not_named, taps_text
    from testbed.system.atomic import write_text

    answer = Answer(None, quiet)
    folder = output_folder(output)
    if published:
        found: list[Any] = []
        left: dict[str, list[str]] = {}
        contents = {"campaign.yaml": _campaign_of(published, files, folder)}
    else:
        found = [_look(file) for file in files]
        texts = {"campaign.yaml": campaign_text(found, folder), "taps.yaml": taps_text(found, folder)}
        left = {name: unknown for name, (_, unknown) in texts.items()}
        contents = {"model.yaml": MODEL, **{name: text for name, (text, _) in texts.items() if text}, "scenario.yaml": SCENARIO}
    for name, content in contents.items():
        place = folder / name
        if place.exists():
            answer.say(f"{place} is there already and stays as it is")
            continue
        folder.mkdir(parents=True, exist_ok=True)
        write_text(place, content)
        answer.say(f"written: {place}")
    for one in found:
        seen = ", ".join(f"{channel} ({column}{f', {unit}' if unit else ''})"
                         for channel, (column, unit) in channels_of(one).items()) or "no channel that its names or units tell"
        answer.say(f"{one.path}: {seen}" + (f", {one.rate:.7g} Hz" if one.rate else ""))
        for note in one.notes:
            answer.say(f"  note: {note}")
    for line in not_named(found):
        answer.say(line)
    for name, unknown in left.items():
        if unknown:
            answer.say(f"to be filled in, in {folder / name}: {', '.join(unknown)}")


def _campaign_of(published: str, files: tuple[str, ...], folder: Path) -> str:
    from testbed.files.published_sets import published_campaign

    if not files:
        raise InputProblem(f"--set {published}", "names a set, but no file", "name the files that you downloaded")
    return published_campaign(published, files, folder)


def _look(file: str) -> Any:
    from testbed.analysis.records.inspection import inspect
    from testbed.files.starter import Found

    path = Path(file)
    if path.suffix.lower() in (".yaml", ".yml"):
        raise InputProblem(file, "is no measured file", "name files such as cut_1.csv")
    seen = inspect(path)
    return Found(path, seen.columns, seen.rate, seen.time, seen.notes)
