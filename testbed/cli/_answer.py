"""How a command answers: text for people, JSON for programs, a progress bar where somebody watches."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Any

import click

from testbed.api.places import check_place
from testbed.api.watch import Bars, Watch
from testbed.cli._places import check_outputs
from testbed.system.atomic import write_text

_NUMBER = re.compile(r"[+-]?\.?\d|[+-]?(inf|nan)\b|-?$|unknown$|not determined$")  # or what stands where there is none


class Answer:
    """One command's answer. Text goes to standard output, or to standard error where JSON takes its place.

    Made before the work: InputProblem where the command would write over what it reads.
    """

    def __init__(self, json_file: str | None, quiet: bool) -> None:
        self.json_file, self.quiet = json_file, quiet
        self._noted: set[str] = set()
        context = click.get_current_context(silent=True)
        if context is not None:
            check_outputs(context)
        if json_file not in (None, "-"):
            check_place(json_file)

    @property
    def watch(self) -> Watch:
        """Who watches the work: nobody where nothing is to be printed."""
        return Watch() if self.quiet else _Shown(self)

    def say(self, text: str = "") -> None:
        """A line for people."""
        if not self.quiet:
            click.echo(text, err=self.json_file == "-")

    def note(self, text: str) -> None:
        """A note for people, once: before the work or with the answer."""
        if text not in self._noted:
            self.say(text)
        self._noted.add(text)

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
        from testbed.api.result import json_text

        text = json_text(value)
        if self.json_file == "-":
            click.echo(text, nl=False)
        else:
            write_text(self.json_file, text)


class _Shown(Bars):
    """A command's watch: bars, and notes before the work where its text goes."""

    def __init__(self, answer: Answer) -> None:
        self.answer = answer

    def note(self, text: str) -> None:
        self.answer.note(text)

    def warn(self, text: str) -> None:
        click.echo(text, err=True)


def progress(title: str, quiet: bool = False, counted: str = "") -> AbstractContextManager[Callable[[int, int], None]]:
    """A function of (done, all) that draws a bar with the time left, or, in a pipe, writes a line now and then.

    counted: what is counted, such as `runs`; the rate is then shown too.
    """
    return (Watch() if quiet else Bars()).counted(title, counted)
