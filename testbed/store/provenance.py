"""Who made which runs of a data set: engine, program and what it needs, kept when shards of several versions become one."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version

import h5py

NAME = "provenance"
Maker = Mapping[str, str]
Made = tuple[int, int, Maker]  # runs `first` up to, not including, `last`, and versions by program
_PROGRAMS = ("machining-testbed", "numpy", "numba", "mujoco", "h5py")


@cache
def versions() -> Maker:
    """Versions of the programs that a data set made here depends on."""
    found = {"python": ".".join(map(str, sys.version_info[:3]))}
    for name in _PROGRAMS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def joined(made: Sequence[Made]) -> list[Made]:
    """Spans in order, neighbours of the same maker as one."""
    found: list[Made] = []
    for first, last, maker in sorted(made, key=lambda span: span[:2]):
        if found and found[-1][1] == first and found[-1][2] == maker:
            first = found.pop()[0]
        found.append((first, last, maker))
    return found


def write(file: h5py.File, made: Sequence[Made]) -> None:
    """Put the makers of all runs into an open data set."""
    spans = joined(made)
    makers: list[Maker] = []
    for _, _, maker in spans:
        if maker not in makers:
            makers.append(maker)
    text = json.dumps({"makers": makers, "spans": [(first, last, makers.index(maker)) for first, last, maker in spans]},
                      sort_keys=True)
    file.create_dataset(NAME, data=text, dtype=h5py.string_dtype())
    file[NAME].attrs["long_name"] = "makers (versions) and which runs (first, last + 1, maker) each of them made"


def read(file: h5py.File, first: int = 0) -> list[Made]:
    """The makers of all runs of an open data set, its first being number `first`; an old one has the last maker alone."""
    engine = str(file.attrs["engine"])
    if NAME not in file:
        return [(first, first + len(file["outcome"]), {"engine": engine, **json.loads(file.attrs["versions"])})]
    found = json.loads(file[NAME].asstr()[()])
    return [(first + begin, first + end, found["makers"][maker]) for begin, end, maker in found["spans"]]


def summary(made: Sequence[Made]) -> dict[str, str]:
    """Each program's versions, one behind another where runs were made by several."""
    found: dict[str, list[str]] = {}
    for _, _, maker in made:
        for name, given in maker.items():
            if given not in found.setdefault(name, []):
                found[name].append(given)
    return {name: ", ".join(given) for name, given in found.items() if name != "engine"}
