"""`testbed benchmark`: sealed campaigns to be judged on, baselines, and the scores of answers beside them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from testbed.api.result import plain
from testbed.cli._answer import Answer, progress
from testbed.cli._options import shared
from testbed.problem import InputProblem

METHODS = ("naive", "spectral", "testbed")
CAMPAIGNS = 12


@click.command(short_help="Sealed campaigns, baselines, and the scores of your answers beside them.",
               epilog="Example: testbed benchmark bench mine.json")
@click.argument("folder", metavar="FOLDER")
@click.argument("files", metavar="[ANSWERS.json...]", nargs=-1)
@click.option("--campaigns", type=click.IntRange(1, 1000), default=None, metavar="N",
              help=f"How many to make, of a new benchmark; by default {CAMPAIGNS}.")
@click.option("--method", "methods", multiple=True, type=click.Choice(METHODS), default=("naive", "spectral"),
              show_default=True,
              help="Baselines to score beside the answers; testbed, this program itself, takes minutes. May be repeated.")
@click.option("--truth", metavar="FILE", help="Where the sealed truth is; by default FOLDER-truth.json, beside FOLDER.")
@shared
def command(folder: str, files: tuple[str, ...], campaigns: int | None, methods: tuple[str, ...], truth: str | None,
            json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Make a benchmark in a new FOLDER, or score answers to one that is there: identification, naming, chatter.

    FOLDER holds measured cuts and believed models, and a README.md that says what is asked and how to answer. The truth is
    written beside it, and sealed by its SHA-256: give away FOLDER alone. A new benchmark is drawn from --seed; without it, from
    a seed that nobody can guess. Answers of the baselines are kept in FOLDER/answers and not asked for again.
    """
    from testbed.benchmark.answers import read_answers
    from testbed.benchmark.scores import score
    from testbed.catalogue import catalogue
    from testbed.cli._benchmark import make, open_truth, read, truth_place

    answer, place = Answer(json_file, quiet), Path(folder)
    if not place.exists():
        if files:
            raise InputProblem(folder, "does not exist", "make the benchmark first, without answers")
        with progress("cutting campaigns", quiet) as show:
            make(place, campaigns or CAMPAIGNS, _seed(seed), show)
        answer.say(f"written: {place}, to give away, and {truth_place(place)}, to keep")
    elif campaigns is not None or seed is not None:
        raise InputProblem(folder, "exists already", "--campaigns and --seed are for a new benchmark: name another folder")
    note = read(place)
    effects = catalogue()
    answers = {Path(file).name: read_answers(Path(file), note["campaigns"], effects) for file in files}
    if len(answers) < len(files):
        raise InputProblem(files[-1], "has the name of another file of answers", "give them different names")
    secret = Path(truth) if truth else truth_place(place)
    if truth is None and not secret.exists():
        raise InputProblem(secret, "is not there: the truth is sealed",
                           "send your answers to whoever holds it, or say where it is with --truth")
    known = open_truth(secret, note)
    baselines = {method: _asked(place, method, note, effects, quiet) for method in dict.fromkeys(methods)}
    scores = {name: score(known, one) for name, one in (*baselines.items(), *answers.items())}
    answer.table(*_table(scores))
    answer.finish(plain({"campaigns": len(known), "sealed": note["sealed"], "scores": {
        name: {**vars(one), "parameters": {each.parameter: {key: value for key, value in vars(each).items()
                                                            if key != "parameter"} for each in one.parameters}}
        for name, one in scores.items()}}))


def _seed(seed: int | None) -> int:
    import secrets

    return secrets.randbits(62) if seed is None else seed


def _asked(place: Path, method: str, note: Mapping[str, Any], effects: Any, quiet: bool) -> Mapping[str, Any]:
    """The answers of a baseline: those in its file, and what is not answered yet."""
    from testbed.benchmark.answers import read_answers
    from testbed.cli._baselines import METHODS
    from testbed.cli._places import output_folder
    from testbed.system.atomic import write_text

    file, asked = place / "answers" / f"{method}.json", note["campaigns"]
    said = dict(read_answers(file, asked, effects)) if file.is_file() else {}
    output_folder(file.parent)
    with progress(f"{method} answers", quiet) as show:
        for number, (name, cuts) in enumerate(asked.items()):
            if name not in said:  # after an interruption it goes on where it was
                said[name] = METHODS[method](place / "campaigns" / name, cuts)
                write_text(file, json.dumps({"campaigns": {key: one.as_json() for key, one in said.items()}}, indent=1) + "\n")
            show(number + 1, len(asked))
    return said


def _table(scores: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[object, ...]]]:
    titles = ("method", "frequency", "damping", "force", "in interval", "named right", "wrong", "none", "chatter")
    rows = []
    for name, one in scores.items():
        intervals = sum(each.intervals for each in one.parameters)
        held = sum(each.coverage * each.intervals for each in one.parameters if each.intervals)
        rows.append((name, *(_percent(each.error) for each in one.parameters),
                     f"{round(held)} of {intervals}" if intervals else "-", f"{one.right} of {one.campaigns}", one.wrong,
                     one.none, "-" if math.isnan(one.balanced_accuracy) else f"{one.balanced_accuracy:.2f}"))
    return titles, rows


def _percent(error: float) -> str:
    return "-" if math.isnan(error) else f"{100 * error:.2g} %"
