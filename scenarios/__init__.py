"""The shipped scenarios: what to cut and how, one YAML file each, never a result."""

from __future__ import annotations

from pathlib import Path

from testbed.problem import InputProblem
from testbed.units import nearest

FOLDER = Path(__file__).parent


def names() -> tuple[str, ...]:
    """Names of the shipped scenarios."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))


def find(name: str | Path) -> Path:
    """The file of a path that exists, or of a shipped scenario's name; a path wins. InputProblem where neither is."""
    path = Path(name)
    if path.exists():
        return path
    stem = path.stem if path.suffix in (".yaml", ".yml") else str(name)
    if path.parent == Path() and stem in names():
        return FOLDER / f"{stem}.yaml"
    close = nearest(stem, names())
    raise InputProblem(name, "there is no such file, nor a shipped scenario of that name",
                       (f"did you mean {close}? " if close else "") + f"shipped: {', '.join(names())}")
