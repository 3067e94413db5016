"""What a search leaves behind: its steps, all that it tried, and what ended it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

from testbed.analysis.search.candidate import Candidate, Tried
from testbed.analysis.search.diagnosis import OtherForm

Each = TypeVar("Each", bound=Tried)


@dataclass(frozen=True)
class SelectionTrace:
    """A search from its first step to its last. tied: effects that the data cannot tell apart, where that ended it.

    hum: in words, the line of the mains that is all it found last. form: a law of no catalogue, where finding it ended it.
    """

    steps: tuple[Candidate, ...]
    seen: tuple[Tried, ...]
    tied: tuple[str, ...]
    hum: str = ""
    form: OtherForm | None = None

    @property
    def end(self) -> Candidate:
        """The set of effects that the search ended with."""
        return self.steps[-1]


def without_slopes(one: Each) -> Each:
    """A candidate as it is told: without the slopes of its fit, which fill much memory and serve its round alone."""
    return one if not isinstance(one, Candidate) else replace(one, fit=replace(one.fit, parts=()))
