"""`testbed score`: identify from synthetic transients again and again, and compare with the known truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import click

from testbed.cli._answer import Answer
from testbed.cli._options import NOISE, effects_option, shared
from testbed.cli._places import output_folder


class _Counts(click.ParamType):
    """Numbers of tests such as `3,5,8`."""

    name = "counts"

    def convert(self, value: Any, parameter: click.Parameter | None, context: click.Context | None) -> list[int]:
        """Whole numbers above 0, each once; click's error otherwise."""
        if isinstance(value, list):
            return value
        parts = str(value).split(",")
        if not all(part.strip().isdigit() and int(part) > 0 for part in parts):
            self.fail(f"'{value}' are no numbers of tests: give such as 3,5,8", parameter, context)
        return list(dict.fromkeys(int(part) for part in parts))


@click.command(short_help="Identify from synthetic transients and score against the known truth.",
               epilog="Example: testbed score tests.h5 --noise 0.5um,1um,2um --method multipliers --method mine.py -o scores")
@click.argument("data", metavar="DATA.h5")
@click.option("--noise", type=NOISE, default=None, metavar="LEVELS",
              help="Noise rms to identify at, such as 0.5um,1um; by default the data set's own. 0 is the least.")
@click.option("--repeats", type=click.IntRange(1, 1000), default=5, show_default=True,
              help="Identifications at each of those levels, each with noise of its own.")
@click.option("--tests", type=_Counts(), default=None, metavar="COUNTS",
              help="How many tests an identification has, such as 3,5,8, drawn anew for each; by default all.")
@click.option("--method", "methods", multiple=True, metavar="METHOD",
              help="multipliers (the default for one mode along the feed), published (as in the paper), waveform (the default "
              "in x and y), or your own FILE.py; may be repeated.")
@click.option("--workers", type=click.IntRange(1, 512), default=1, show_default=True,
              help="Identifications at a time; the scores do not depend on it.")
@click.option("-o", "--output", metavar="DIR", help="Write the table (score.md) and figures (PNG and SVG) into this folder.")
@effects_option
@shared
def command(data: str, noise: list[float] | None, repeats: int, tests: list[int] | None, methods: tuple[str, ...],
            workers: int, output: str | None, folders: tuple[str, ...], json_file: str | None, seed: int | None,
            quiet: bool) -> None:
    """Bias, spread, rms error, the coverage of the intervals and cost, for each method, noise level and number of tests.

    DATA.h5 holds simulated tests and their truth. Identification starts away from the truth, from a belief drawn for each
    repeat: frequencies within 1.5 %, damping within a factor of 2.5, cutting coefficients within one of 2; in x and y, the
    directions of modes within 10 deg. With --noise, noise is added to the displacements that the tests have.

    FILE.py defines identify(recordings, belief) -> {name: (value, low, high)}: recordings with `channels`, `sampling_rate`,
    `marks` and `conditions`; belief.value(name) of natural_frequency (Hz), damping_ratio and tangential_coefficient (N/m^2)
    to start from, and of what is known: mass, immersion. In x and y names are such as modes[0].natural_frequency. It raises
    ValueError where the recordings do not suffice.
    """
    from testbed.api.score import level, score, score_rows

    answer = Answer(json_file, quiet)
    folder = output_folder(output) if output else None
    found = score(data, noise=noise, repeats=repeats, tests=tests, method=methods, workers=workers, seed=seed or 0,
                  effects=folders, progress=answer.watch)
    answer.table(*score_rows(found.scores, len(found.methods) > 1, tests is not None))
    for reason, count in _failures(found.scores, level).items():
        answer.say(f"{count} failed: {reason}")
    for one in found.cost:
        answer.say(f"{one.method}, {one.tests} tests, {level(one.noise)}: {one.median:.2g} s of processor time each")
    for path in found.save(folder) if folder is not None else ():
        answer.say(f"written: {path}")
    answer.finish(found.to_dict())


def _failures(scores: Sequence[Any], level: Any) -> dict[str, int]:
    """Reasons of failures with how often each was met, whatever the repeat."""
    counted: Counter[str] = Counter()
    seen = set()
    for one in scores:
        if (one.method, one.tests, one.noise) not in seen:
            seen.add((one.method, one.tests, one.noise))
            counted.update(f"{one.method}, {level(one.noise)}: {reason.partition(': ')[2]}" for reason in one.reasons)
    return dict(counted.most_common(5))
