"""Is a data set, to the last bit, what was written?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from testbed.api.believed import File
from testbed.api.result import Result, Table
from testbed.api.watch import Progress
from testbed.api.working import working


@dataclass(frozen=True, repr=False, eq=False)
class Verification(Result):
    """What was found of a data set. damage: a line for each thing found, empty where all is well. runs, files: looked at."""

    path: Path
    runs: int
    files: int
    content_hash: str
    damage: tuple[str, ...]
    damaged_runs: tuple[int, ...]
    notes: tuple[str, ...]

    @property
    def intact(self) -> bool:
        """Whether all is as it was written."""
        return not self.damage

    def _answer(self) -> Mapping[str, Any]:
        return {"path": self.path, "intact": self.intact, "runs": self.runs, "files": self.files,
                "content_hash": self.content_hash, "damage": self.damage, "damaged_runs": self.damaged_runs,
                "notes": self.notes}

    def _table(self) -> Table:
        return Table("", {"damage": self.damage}, {})

    def _headline(self) -> str:
        return f"{self.path}, {self.runs} runs: {'intact' if self.intact else '; '.join(self.damage[:2])}"


def verify(data: File, *, quick: bool = False, threads: int = 2, progress: Progress = None) -> Verification:
    """Find a flipped bit, a file cut short, a missing, moved or doubled shard.

    data: a data set, or the folder DATA.h5.parts of a sweep that is not finished. quick: the bytes alone, not also the values
    behind them. threads: blocks hashed at a time. progress: a function of (title, done, all), or False. InputProblem where it
    is neither; damage is an answer.
    """
    from testbed.store.verification import verify as verified

    with working(progress) as watch, watch.counted("verifying") as show:
        found = verified(Path(data), quick, threads, show)
    return Verification(found.path, found.runs, found.files, found.content_hash, tuple(found.damage),
                        tuple(sorted(set(found.damaged_runs))), tuple(found.notes))
