"""Machines as data: one folder a machine, with its MuJoCo model and where each value came from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from testbed.machine import Structure
from testbed.problem import InputProblem

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Machine:
    """A machine of this folder: its name; `path` of its MJCF, `parameters` of its table of values and sources."""

    name: str

    @property
    def path(self) -> Path:
        """The MJCF file."""
        return FOLDER / self.name / f"{self.name}.xml"

    @property
    def parameters(self) -> Path:
        """The YAML file with every value's unit, source and spread."""
        return FOLDER / self.name / "parameters.yaml"

    def xml(self) -> str:
        """The MJCF text."""
        return self.path.read_text(encoding="utf-8")

    def structure(self) -> Structure:
        """The mode along the feed, read from the compiled MuJoCo model."""
        return _structure(self.name)


def known() -> tuple[str, ...]:
    """Names of the machines there are, in alphabetical order."""
    return tuple(sorted(path.parent.name for path in FOLDER.glob("*/*.xml") if path.stem == path.parent.name))


def machine(name: str) -> Machine:
    """The machine of that name; InputProblem, listing the known ones, where there is none."""
    if name not in known():
        raise InputProblem("structure", f"no machine is named '{name}'", f"known: {', '.join(known())}")
    return Machine(name)


@lru_cache(maxsize=16)
def _structure(name: str) -> Structure:
    from testbed.models.linearise import feed_mode  # only here is MuJoCo needed

    return feed_mode(Machine(name).path)
