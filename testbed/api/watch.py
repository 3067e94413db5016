"""Whoever watches long work: nobody, a terminal, a notebook, or a function of the caller's."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

SHOWN_STEPS = 100  # how often at most a bar in a notebook is drawn anew
PIPED_EVERY_S = 30.0  # between two lines in a pipe, and before the first: short work, compiling too, says nothing there


class Watch:
    """Nobody watches: the base of those who do."""

    @contextmanager
    def counted(self, title: str, counted: str = "") -> Iterator[Callable[[int, int], None]]:
        """A function of (done, all). counted: what is counted, such as `runs`."""
        yield lambda done, total: None

    @contextmanager
    def busy(self, title: str) -> Iterator[Callable[[str], None]]:
        """A function of what is being done now."""
        yield lambda text: None

    def note(self, text: str) -> None:
        """A note that belongs before long work; it stands in the answer's notes, too."""

    def warn(self, text: str) -> None:
        """What is to be known before long work and is no part of the answer."""


Progress: TypeAlias = "Watch | Callable[[str, int, int | None], object] | bool | None"


class Bars(Watch):
    """Bars with the time left, on standard error where that is a terminal; in a pipe or a file a line now and then."""

    @contextmanager
    def counted(self, title: str, counted: str = "") -> Iterator[Callable[[int, int], None]]:
        """See Watch; with `counted` the rate is shown, too."""
        if not sys.stderr.isatty():
            say = _lines()
            yield lambda done, total: say(f"{title}: {done} of {total} {counted}".rstrip())
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

    @contextmanager
    def busy(self, title: str) -> Iterator[Callable[[str], None]]:
        """See Watch; with the time gone by."""
        if not sys.stderr.isatty():
            yield _lines()
            return
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(title, total=None)
            yield lambda text: bar.update(task, description=text)


def _lines() -> Callable[[str], None]:
    """A function that writes what is being done as a line on standard error, with the time gone by, unless it just did."""
    begun = written = time.monotonic()

    def say(text: str) -> None:
        nonlocal written
        now = time.monotonic()
        if now - written >= PIPED_EVERY_S:
            written = now
            print(f"{text} ({now - begun:.0f} s)", file=sys.stderr, flush=True)

    return say


class Called(Watch):
    """A function of (title, done, all) is called; all is None where nobody knows how much there is to do."""

    def __init__(self, function: Callable[[str, int, int | None], object]) -> None:
        self.function = function

    @contextmanager
    def counted(self, title: str, counted: str = "") -> Iterator[Callable[[int, int], None]]:
        """See Watch."""
        yield lambda done, total: self._tell(title, done, total)

    @contextmanager
    def busy(self, title: str) -> Iterator[Callable[[str], None]]:
        """See Watch; the title is then what is being done now."""
        done = 0
        self._tell(title, done, None)

        def say(text: str) -> None:
            nonlocal done
            done += 1
            self._tell(text, done, None)

        yield say

    def _tell(self, title: str, done: int, total: int | None) -> None:
        self.function(title, done, total)


class Notebook(Called):
    """A bar in the cell's output, gone when the work is done."""

    def __init__(self, display: Any) -> None:
        super().__init__(self._draw)
        self.handle, self.drawn = display({"text/html": ""}, raw=True, display_id=True), ""

    def _draw(self, title: str, done: int, total: int | None) -> None:
        bar = f" <progress value={done * SHOWN_STEPS // max(1, total)} max={SHOWN_STEPS}></progress>" if total else ""
        from html import escape

        text = "" if total and done >= total else f"{escape(title)}{bar}"
        if self.handle is not None and text != self.drawn:
            self.drawn = text
            self.handle.update({"text/html": text}, raw=True)

    @contextmanager
    def busy(self, title: str) -> Iterator[Callable[[str], None]]:
        """See Watch."""
        with super().busy(title) as say:
            try:
                yield say
            finally:
                self._draw("", 1, 1)


def watch_of(progress: Progress) -> Watch:
    """Who watches. None or True: a terminal, or a notebook; False: nobody; a function: it is called."""
    if isinstance(progress, Watch):
        return progress
    if progress is False:
        return Watch()
    if progress is None or progress is True:
        display = _notebook()
        return Bars() if display is None else Notebook(display)
    return Called(progress)


def _notebook() -> Any:
    """IPython's `display` where this runs in a notebook's kernel, else None."""
    if "IPython" not in sys.modules:
        return None
    from IPython.core.getipython import get_ipython
    from IPython.display import display

    shell = get_ipython()
    return display if shell is not None and hasattr(shell, "kernel") else None
