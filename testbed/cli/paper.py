"""`testbed paper`: every figure and table of Mann and Young (2006), with its numbers checked."""

from __future__ import annotations

import time
from typing import Any

import click

from testbed.cli._answer import Answer, progress
from testbed.cli._options import shared
from testbed.cli._places import output_folder
from testbed.problem import InputProblem

SEED = 2006


@click.command(short_help="Reproduce Mann and Young (2006), figure by figure, with its numbers checked.",
               epilog="Example: testbed paper -o paper --workers 2")
@click.option("-o", "--output", default="paper", show_default=True, metavar="DIR",
              help="Folder for paper.html, its pictures (PNG and SVG) and what each part found (parts/NAME.json).")
@click.option("--only", multiple=True, metavar="NAME", help="Only this part, such as fig1 or table2; may be repeated.")
@click.option("--quick", is_flag=True, help="Few repeats, coarse grids: a look, not the numbers.")
@click.option("--resume", is_flag=True, help="Keep the parts that an earlier run with the same program, seed and effort "
              "has finished.")
@click.option("--workers", type=click.IntRange(1, 64), default=2, show_default=True, help="Parts computed at a time.")
@shared
def command(output: str, only: tuple[str, ...], quick: bool, resume: bool, workers: int, json_file: str | None,
            seed: int | None, quiet: bool) -> None:
    """Simulate the paper's experiments, analyse them as it does, and put each published statement beside what was found.

    The page says which statements agree, which do not and why, and what of the paper is inferred or unknown here. Numbers
    depend on --seed alone, whatever the workers.
    """
    from testbed.analysis.paper import PARTS
    from testbed.analysis.paper.page import count, write_page
    from testbed.analysis.paper.part import as_dict, picture_files
    from testbed.cli._paper import Work, make_all

    unknown = [name for name in only if name not in PARTS]
    if unknown:
        raise InputProblem("--only", f"there is no part '{unknown[0]}'", f"known: {', '.join(PARTS)}")
    answer = Answer(json_file, quiet)
    folder = output_folder(output)
    began = time.perf_counter()
    names = [name for name in PARTS if not only or name in only]
    work = Work(str(folder.resolve()), SEED if seed is None else seed, quick)
    parts: dict[str, Any] = {}
    with progress("paper", quiet) as show:
        for part, seconds in make_all(work, names, workers, resume):
            parts[part.name] = part
            show(len(parts), len(names))
            answer.say(f"[{len(parts)}/{len(names)}] {part.title}" + (f" ({seconds:.0f} s)" if seconds else " (kept)"))
    ordered = [parts[name] for name in names]
    page = write_page(ordered, folder, quick, work.seed)
    _say(answer, ordered)
    agree, differ, still = count(ordered)
    answer.say(f"{agree} statements agree, {differ} do not, {still} cannot be decided; "
               f"done in {time.perf_counter() - began:.0f} s")
    answer.say(f"open: {page}")
    answer.finish({"page": page, "seed": work.seed, "quick": quick, "agree": agree, "differ": differ, "undecided": still,
                   "pictures": [path for part in ordered for one in part.pictures for path in picture_files(folder, one)],
                   "parts": [as_dict(part) for part in ordered], "seconds": time.perf_counter() - began})


def _say(answer: Answer, parts: list[Any]) -> None:
    """What does not agree, with its reason: the rest stands on the page."""
    for part in parts:
        for one in part.statements:
            if one.agrees is False:
                answer.say(f"differs, {one.place}: {one.claim}: {one.published}; found {one.found}"
                           + (f" ({one.why})" if one.why else ""))
