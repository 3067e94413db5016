"""The part of scenario.yaml that says where to cut: `tests`, `sweep`, `sample` or `refine`.

    tests:                                   # a list; other parameters may stand beside speed and depth
      - {spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm, damping_ratio: 0.004}
    sweep:                                   # a grid: every value of each with every value of the others
      spindle_speed: {from: 2500 rpm, to: 4500 rpm, count: 20}
      depth_of_cut: 1, 2, 3 mm
    sample:                                  # points that fill a space
      method: latin_hypercube                # or sobol, random
      runs: 1000
      over:
        spindle_speed: {from: 2500 rpm, to: 4500 rpm}
        depth_of_cut: {from: 0.1 mm, to: 4 mm}
        damping_ratio: {from: 0.002, to: 0.02, scale: log}
    refine:                                  # a grid, halved three times where the border of stability runs
      spindle_speed: {from: 2500 rpm, to: 4500 rpm, count: 9}
      depth_of_cut: {from: 0.2 mm, to: 4 mm, count: 5}
      levels: 3
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod
from typing import Any, Literal

from pydantic import Field

from testbed.effect import Effect
from testbed.files.yaml_text import Document, Path_, Strict, validate
from testbed.machine import Model
from testbed.scenario.axis import MAX_VALUES, axis, check_all
from testbed.scenario.design import DEPTH, SPEED, Grid, Method, OperatingPoint, Range, Sampled, point
from testbed.scenario.variables import Variable, named, value_at, variables

SECTIONS = ("tests", "sweep", "sample", "refine")
MAX_RUNS = MAX_VALUES
MOST_LEVELS = 8
MOST_TRIALS = 200_000  # points of a refined grid
_SOBOL_DIMENSIONS = 21_201


class _Sample(Strict):
    method: Method = "latin_hypercube"
    runs: int
    over: Any


class _Ends(Strict):
    low: Any = Field(alias="from")
    high: Any = Field(alias="to")
    scale: Literal["linear", "log"] = "linear"


class _Refine(Strict):
    spindle_speed: Any
    depth_of_cut: Any
    levels: int = 3


def read_design(document: Document, model: Model, catalogue: Mapping[str, Effect], seed: int,
                feed: float) -> Sequence[OperatingPoint]:
    """The operating points a scenario asks for. feed: per tooth, m, of the trial cuts that find the border."""
    given = [name for name in SECTIONS if document.data.get(name) is not None]
    if len(given) != 1:
        if not given:
            empty = next((name for name in SECTIONS if name in document.data), None)
            raise document.problem((empty,) if empty else (), "holds no test" if empty else "gives no tests and no sweep",
                                   f"give one of {', '.join(SECTIONS)}")
        raise document.problem((given[1],), f"gives both {given[0]} and {given[1]}", "give one of the two")
    known = variables(model, catalogue)
    if given[0] == "tests":
        return _listed(document, known, catalogue)
    if given[0] == "sweep":
        return _grid(document, known, catalogue)
    return _sampled(document, known, catalogue, seed) if given[0] == "sample" else _refined(document, model, catalogue, feed)


def _mapping(document: Document, path: Path_, needed: Sequence[str]) -> dict[str, Any]:
    """The mapping at a path, which has the needed keys."""
    given = document.at(path)
    if not isinstance(given, dict):
        raise document.problem(path, "is empty" if given is None else f"'{given}' is not a mapping",
                               f"give {', '.join(needed)}")
    return given


def _complete(document: Document, path: Path_, given: Mapping[str, Any], needed: Sequence[str]) -> None:
    for name in needed:
        if name not in given:
            raise document.problem((*path, name), "is missing", "add it")


def _listed(document: Document, known: Mapping[str, Variable], catalogue: Mapping[str, Effect]) -> Sequence[OperatingPoint]:
    listed = document.data["tests"]
    if not isinstance(listed, list) or not listed:
        raise document.problem(("tests",), "holds no test", "write `- {spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm}`")
    points = []
    for number in range(len(listed)):
        path: Path_ = ("tests", number)
        given = _mapping(document, path, (SPEED, DEPTH))
        values = {name: value_at(document, (*path, name), named(document, (*path, name), known, catalogue), value)
                  for name, value in given.items()}
        _complete(document, path, given, (SPEED, DEPTH))
        points.append(point(values))
    return tuple(points)


def _grid(document: Document, known: Mapping[str, Variable], catalogue: Mapping[str, Effect]) -> Grid:
    given = _mapping(document, ("sweep",), (SPEED, DEPTH))
    axes = []
    for name, value in given.items():
        path = ("sweep", name)
        variable = named(document, path, known, catalogue)
        values = axis(document, path, value, variable.unit)
        check_all(document, path, values, variable.check)
        axes.append((name, values))
    _complete(document, ("sweep",), given, (SPEED, DEPTH))
    count = prod(len(values) for _, values in axes)
    if count > MAX_RUNS:
        raise document.problem(("sweep",), f"has {count} points", f"at most {MAX_RUNS}")
    return Grid(tuple(axes))


def _sampled(document: Document, known: Mapping[str, Variable], catalogue: Mapping[str, Effect], seed: int) -> Sampled:
    sample = validate(document, _Sample, ("sample",))
    if not 1 <= sample.runs <= MAX_RUNS:
        raise document.problem(("sample", "runs"), f"'{sample.runs}' must be 1 to {MAX_RUNS}", "correct the value")
    place: Path_ = ("sample", "over")
    given = _mapping(document, place, (SPEED, DEPTH))
    ranges, fixed = [], []
    for name, value in given.items():
        path = (*place, name)
        variable = named(document, path, known, catalogue)
        if not isinstance(value, dict):
            fixed.append((name, value_at(document, path, variable, value)))
            continue
        ends = validate(document, _Ends, path)
        low, high = (value_at(document, (*path, key), variable, end) for key, end in (("from", ends.low), ("to", ends.high)))
        if not low < high:
            raise document.problem((*path, "to"), f"'{ends.high}' must lie above from", "swap the two")
        if ends.scale == "log" and low <= 0:
            raise document.problem((*path, "from"), f"'{ends.low}' must be above 0 on a scale of logarithms",
                                   "raise it, or leave out scale")
        ranges.append(Range(name, low, high, ends.scale == "log"))
    _complete(document, place, given, (SPEED, DEPTH))
    if not ranges:
        raise document.problem(place, "has no range", "write {from: 2500 rpm, to: 4500 rpm} for one parameter at least")
    if len(ranges) > _SOBOL_DIMENSIONS:
        raise document.problem(place, f"has {len(ranges)} ranges", f"at most {_SOBOL_DIMENSIONS}")
    return Sampled(sample.method, sample.runs, seed, tuple(ranges), tuple(fixed))


def _refined(document: Document, model: Model, catalogue: Mapping[str, Effect],
             feed: float) -> Sequence[OperatingPoint]:
    from testbed.scenario.refinement import refined, stable_cuts

    given = validate(document, _Refine, ("refine",))
    axes = []
    for name, value in ((SPEED, given.spindle_speed), (DEPTH, given.depth_of_cut)):
        variable = variables(model, catalogue)[name]
        values = axis(document, ("refine", name), value, variable.unit)
        check_all(document, ("refine", name), values, variable.check)
        if len(values) < 2 or any(high <= low for low, high in zip(values, values[1:], strict=False)):
            raise document.problem(("refine", name), "is no axis to refine", "give two or more values, rising")
        axes.append(values)
    if not 0 <= given.levels <= MOST_LEVELS:
        raise document.problem(("refine", "levels"), f"'{given.levels}' must be 0 to {MOST_LEVELS}", "correct the value")
    speeds, depths = axes
    if len(speeds) * len(depths) * 4**given.levels > MOST_TRIALS * 2**given.levels:
        raise document.problem(("refine",), "may come to too many points", "give fewer levels or a coarser grid")
    return refined(speeds, depths, given.levels, stable_cuts(model, feed, catalogue))
