"""Bad input, said in one line: which file, what is wrong, what to do."""

from __future__ import annotations

from typing import Any

MOST_SHOWN = 300  # characters of a name, of what is wrong, and of what to do


class InputWarning(UserWarning):
    """What the user is to know of an input that can be used; the command line prints it as `warning: FILE: what`."""


class InputProblem(ValueError):
    """The user's input is bad; the command line prints it as `error: FILE: what is wrong: what to do` and exits with 2."""

    def __init__(self, place: object, what: str, do: str = "", line: int | None = None) -> None:
        self.place, self.what, self.do, self.line = str(place), what, do, line
        super().__init__(str(self))

    def __reduce__(self):
        return (type(self), (self.place, self.what, self.do, self.line))

    def __str__(self) -> str:
        where = f"{shortened(self.place)}:{self.line}" if self.line is not None else self.place
        return ": ".join(shortened(part) for part in (where, self.what, self.do) if part)


def shortened(text: str, most: int = MOST_SHOWN) -> str:
    """A text in one line that can be shown: of a very long one, its beginning and its end."""
    if len(text) > 2 * most:
        text = f"{text[:most]} {text[-most:]}"
    line = "".join(one if one.isprintable() else " " for one in " ".join(text.split()))
    return line if len(line) <= most else f"{line[: most // 2]} ... {line[-most // 3 :]}"


def optional(package: str) -> Any:
    """A package that testbed does not need by itself. InputProblem where it is not installed."""
    from importlib import import_module

    try:
        return import_module(package)
    except ImportError:
        raise InputProblem(package, "is not installed", f"pip install {package}") from None
