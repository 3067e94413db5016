"""How a command answers: text for people, JSON for programs, a progress bar where somebody watches."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from testbed.cli._places import check_outputs, check_place
from testbed.system.atomic import write_text

MOST_DIGITS = 12  # of a number, however narrow its interval
NOT_DETERMINED = "not determined"  # in place of an interval that spans decades
_NUMBER = re.compile(r"[+-]?\.?\d|[+-]?(inf|nan)\b|-?$|unknown$|not determined$")  # or what stands where there is none


def plain(value: Any) -> Any:
    """A value as JSON knows it: NaN and infinities are null, a complex number [re, im], arrays lists."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # numpy, without importing it
        return plain(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


class Answer:
    """One command's answer. Text goes to standard output, or to standard error where JSON takes its place.

    Made before the work: InputProblem where the command would write over what it reads.
    """

    def __init__(self, json_file: str | None, quiet: bool) -> None:
        self.json_file, self.quiet = json_file, quiet
        context = click.get_current_context(silent=True)
        if context is not None:
            check_outputs(context)
        if json_file not in (None, "-"):
            check_place(json_file)

    def say(self, text: str = "") -> None:
        """A line for people."""
        if not self.quiet:
            click.echo(text, err=self.json_file == "-")

    def table(self, titles: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """Columns set flush: numbers to the right; words, and the first column, to the left."""
        cells = [[str(cell) for cell in row] for row in (titles, *rows)]
        columns = list(zip(*cells, strict=True))
        widths = [max(map(len, column)) for column in columns]
        numbers = [place > 0 and all(map(_NUMBER.match, column[1:])) for place, column in enumerate(columns)]
        for row in cells:
            set_flush = (cell.rjust(width) if number else cell.ljust(width)
                         for cell, width, number in zip(row, widths, numbers, strict=True))
            self.say("  ".join(set_flush).rstrip())

    def finish(self, value: Any) -> None:
        """Write the JSON, where it was asked for."""
        if self.json_file is None:
            return
        text = json.dumps(plain(value), indent=2, allow_nan=False) + "\n"
        if self.json_file == "-":
            click.echo(text, nl=False)
        else:
            write_text(self.json_file, text)


@contextmanager
def progress(title: str, quiet: bool = False, counted: str = "") -> Iterator[Callable[[int, int], None]]:
    """A function of (done, all) that draws a bar with the time left: on a terminal only, never into a pipe.

    counted: what is counted, such as `runs`; the rate is then shown too.
    """
    if quiet or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    rate = (TextColumn(f"{{task.fields[rate]}} {counted}/s"),) if counted else ()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), *rate, TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None, rate="-")

        def show(done: int, total: int) -> None:
            speed = bar.tasks[task].speed
            bar.update(task, completed=done, total=total, rate=f"{speed:.3g}" if speed else "-")

        yield show


def shown(value: float, unit: str, digits: int = 5, path: str = "") -> str:
    """A quantity for people: an SI value in the unit that is usual for it, or for a parameter of that path."""
    from testbed.units import format_quantity

    usual = {"rad/s": "rpm", "N/m^2": "N/mm^2"}.get(unit, "deg" if path.endswith(".direction") else unit)
    return "-" if not math.isfinite(value) else format_quantity(value, usual, digits)


def interval_shown(one: Any, path: str = "") -> tuple[str, str, str]:
    """Value, low and high of an estimate for people, with as many digits as tell the ends apart. path: of the parameter."""
    width = one.high - one.low
    if not one.determined:
        return shown(one.value, one.unit, path=path), NOT_DETERMINED, NOT_DETERMINED
    digits = 5 if width <= 0.0 or one.value == 0.0 else math.ceil(math.log10(abs(one.value) / width)) + 2
    digits = min(max(digits, 5), MOST_DIGITS)
    value, low, high = (shown(number, one.unit, digits, path) for number in (one.value, one.low, one.high))
    return value, low, high
