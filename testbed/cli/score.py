"""`testbed score`: identify from synthetic transients again and again, and compare with the known truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import click

from testbed.api.words import shown
from testbed.cli._answer import Answer, progress
from testbed.cli._options import NOISE, effects_option, shared
from testbed.cli._places import output_folder
from testbed.machine import BASE_UNITS
from testbed.problem import InputProblem


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
@click.option("--method", "methods", multiple=True, default=("multipliers",), show_default=True, metavar="METHOD",
              help="multipliers, published (as in the paper), waveform, or your own FILE.py; may be repeated.")
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
    repeat: frequency within 1.5 %, damping within a factor of 2.5, cutting coefficients within one of 2. With --noise,
    noise is added to what the tests already have.

    FILE.py defines identify(recordings, belief) -> {name: (value, low, high)}: recordings with `channels`, `sampling_rate`,
    `marks` and `conditions`; belief.value(name) of natural_frequency (Hz), damping_ratio and tangential_coefficient (N/m^2)
    to start from, and of what is known: mass, immersion. It raises ValueError where the recordings do not suffice.
    """
    from testbed.analysis.multipliers.score import cases, costs, study_scores
    from testbed.cli._scoring import Order, Sealed, study

    answer = Answer(json_file, quiet)
    methods = _known(methods)
    sealed = Sealed(Order(data, noise is not None, seed or 0, folders))
    groups = sealed.groups
    levels = sorted(groups) if noise is None else \
        list(dict.fromkeys(max(level, min(groups)) if level == 0 else level for level in noise))
    how_often = _repeats(groups, levels, repeats if noise is not None else None, data)
    planned = cases(methods, _counts(sealed, tests, data), how_often)
    folder = output_folder(output) if output else None
    outcomes = {}
    with progress("identifying", quiet) as show:
        for case, outcome in zip(planned, study(sealed, planned, workers), strict=True):
            outcomes[case] = outcome
            show(len(outcomes), len(planned))
    scores, spent = study_scores(outcomes, sealed.truth), costs(outcomes)
    titles, rows = _table(scores, len(methods) > 1, tests is not None)
    answer.table(titles, rows)
    for reason, count in _failures(scores).items():
        answer.say(f"{count} failed: {reason}")
    for one in spent:
        answer.say(f"{one.method}, {one.tests} tests, {_level(one.noise)}: {one.median:.2g} s of processor time each")
    if folder is not None:
        _write(folder, sealed, scores, spent, answer)
    answer.finish({"method": methods[0], "methods": methods, "truth": {one.parameter: one.truth for one in scores},
                   "scores": [vars(one) | {"unit": BASE_UNITS[one.parameter]} for one in scores], "cost": spent,
                   "units": {"noise": "m", "median": "s", "high": "s"}})


def _known(methods: Sequence[str]) -> tuple[str, ...]:
    """The methods asked for, each once; InputProblem or click's error for one that is not to be had."""
    from pathlib import Path

    from testbed.cli._scoring import METHODS, load_method
    from testbed.units import nearest

    for name in methods:
        if name.endswith(".py"):
            load_method(Path(name))
        elif name not in METHODS:
            close = nearest(name, METHODS)
            raise click.UsageError(f"--method '{name}' is not known: " + (f"did you mean {close}?" if close else
                                                                           f"give {', '.join(METHODS)} or a FILE.py"))
    return tuple(dict.fromkeys(methods))


def _counts(sealed: Any, tests: list[int] | None, data: object) -> list[int]:
    if tests is None:
        return [sealed.tests]
    if max(tests) > sealed.tests:
        raise InputProblem(data, f"holds {sealed.tests} tests, not {max(tests)}", "ask for fewer with --tests")
    return tests


def _repeats(groups: Mapping[float, Any], levels: Sequence[float], repeats: int | None, data: object) -> dict[float, int]:
    """How often each level is identified; InputProblem for a level below the noise that is already there."""
    if repeats is None:
        return {level: len(groups[level]) for level in levels}
    quietest = min(groups)
    low = [level for level in levels if level < quietest]
    if low:
        raise InputProblem(data, f"already has {quietest * 1e6:g} um of noise; {low[0] * 1e6:g} um is less",
                           "run the scenario with less noise, or ask for more")
    # Where no noise is added there are only as many different campaigns as the data set holds.
    return {level: len(groups[quietest]) if level == quietest else repeats for level in levels}


def _table(scores: Sequence[Any], by_method: bool, by_tests: bool) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Titles and rows; method and number of tests stand in it where there are several."""
    titles = ("parameter", *("method",) * by_method, *("tests",) * by_tests, "noise", "truth", "bias", "spread", "rms",
              "coverage", "failed")
    rows = []
    for one in scores:
        unit = BASE_UNITS[one.parameter]
        rows.append((one.parameter, *(one.method,) * by_method, *(str(one.tests),) * by_tests, _level(one.noise),
                     *(shown(value, unit, 4) for value in (one.truth, one.bias, one.spread, one.rms)),
                     "-" if math.isnan(one.coverage) else f"{one.coverage:.0%}", f"{one.failures} of {one.count}"))
    return titles, rows


def _level(noise: float) -> str:
    return f"{noise * 1e6:g} um"


def _failures(scores: Sequence[Any]) -> dict[str, int]:
    """Reasons of failures with how often each was met, whatever the repeat."""
    from collections import Counter

    counted: Counter[str] = Counter()
    seen = set()
    for one in scores:
        if (one.method, one.tests, one.noise) not in seen:
            seen.add((one.method, one.tests, one.noise))
            counted.update(f"{one.method}, {_level(one.noise)}: {reason.partition(': ')[2]}" for reason in one.reasons)
    return dict(counted.most_common(5))


def _write(folder: Any, sealed: Any, scores: Sequence[Any], spent: Sequence[Any], answer: Answer) -> None:
    """The table as Markdown, and the figures."""
    from testbed.analysis.linear.chart_plot import save
    from testbed.analysis.multipliers.score_plots import figures
    from testbed.export.card import table
    from testbed.system.atomic import write_text

    titles, rows = _table(scores, True, True)
    prices = [(one.method, one.tests, _level(one.noise), f"{one.median:.3g} s", f"{one.high:.3g} s") for one in spent]
    write_text(folder / "score.md", "\n\n".join([
        "# Identification under noise", f"Of {sealed.order.data}, seed {sealed.order.seed}. Coverage: share of 95 % intervals "
        "that hold the truth; a method without intervals has none. Failures are left out of bias, spread and rms.",
        table(titles, rows), "Processor time of one identification; it differs from run to run.",
        table(("method", "tests", "noise", "median", "90 %"), prices)]) + "\n")
    answer.say(f"written: {folder / 'score.md'}")
    for name, figure in figures(scores, spent).items():
        for path in save(figure, folder / name):
            answer.say(f"written: {path}")
