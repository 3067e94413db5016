"""Bad input, said in one line: which file, what is wrong, what to do."""

from __future__ import annotations


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
        where = f"{self.place}:{self.line}" if self.line is not None else self.place
        return ": ".join(" ".join(part.split()) for part in (where, self.what, self.do) if part)
