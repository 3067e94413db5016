"""`testbed verify`: is a data set, to the last bit, what was written?"""

from __future__ import annotations

import click

from testbed.cli._answer import Answer
from testbed.cli._options import shared
from testbed.problem import InputProblem

_SHOWN = 4  # findings in the error's one line; the others stand above it


@click.command(short_help="Check that a data set is whole: every bit, every run, every shard.",
               epilog="Example: testbed verify tests.h5")
@click.argument("data", metavar="DATA")
@click.option("--quick", is_flag=True, help="The bytes alone, not also the values behind them.")
@click.option("--threads", type=click.IntRange(1, 64), default=2, show_default=True, help="Blocks hashed at a time.")
@shared
def command(data: str, quick: bool, threads: int, json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Find a flipped bit, a file cut short, a missing, moved or doubled shard.

    DATA is a data set, or the folder DATA.h5.parts of a sweep that is not finished. Exit code 0: all is as it was
    written; 2: it is not, and what is touched is said. Nothing here is random: --seed changes nothing.
    """
    from testbed.api.verify import verify

    answer = Answer(json_file, quiet)
    found = verify(data, quick=quick, threads=threads, progress=answer.watch)
    for note in found.notes:
        answer.say(f"note: {note}")
    answer.finish(found.to_dict())
    if found.damage:
        for line in found.damage[_SHOWN:]:
            answer.say(f"damage: {line}")
        more = len(found.damage) - _SHOWN
        hint = "copy it again from where it came from, or simulate it again"
        if found.path.is_dir():
            hint = "continue the sweep with --resume: what is damaged or missing is computed again"
        raise InputProblem(data, "; ".join(found.damage[:_SHOWN]) + (f"; {more} more" if more > 0 else ""), hint)
    whole = f", content {found.content_hash[:16]}" if found.content_hash else f" in {found.files} shards"
    answer.say(f"{data}: intact, {found.runs} runs{whole}")
