"""A value with its uncertainty in a model file, `550 +- 50 N/mm^2`: one standard deviation, taken out before the rest is read.

The deviation may have a unit of its own, or be a share: `550 N/mm^2 +- 10 %`. All else reads the value alone.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from testbed.effect import Effect
from testbed.files.yaml_text import Document, Path_
from testbed.machine import BASE_UNITS, CUTTING, STRUCTURE, Model
from testbed.units import SPREAD_SIGN, UnitProblem, format_quantity, parse_quantity

_ONE_MODE = {name: BASE_UNITS[name] for name in STRUCTURE}  # along the feed
_MODE = _ONE_MODE | {"stiffness": "N/m", "direction": BASE_UNITS["direction"]}
_CUTTING = {name: BASE_UNITS[name] for name in CUTTING}
_BRACKETS = re.compile(r"\s*\((.*)\)(.*)", re.DOTALL)
_BARE = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_EXAMPLE = "write for example 550 +- 50 N/mm^2"


def nominal(document: Document, path: Path_, catalogue: Mapping[str, Effect]) -> tuple[Document, dict[str, float]]:
    """The document with every value of the model at `path` alone, and the standard deviations (SI) by parameters' paths.

    InputProblem, with the line, for a deviation that is none.
    """
    data, found = copy.deepcopy(document.data), {}
    model = replace(document, data=data).at(path)
    for name, keys, values, key, unit in _places(model if isinstance(model, dict) else {}, catalogue):
        given = values[key]
        if not isinstance(given, str) or not SPREAD_SIGN.search(given):
            continue
        try:
            values[key], found[name] = _split(given, unit)
        except UnitProblem as problem:
            raise document.problem((*path, *keys), problem.what, problem.do) from None
    return replace(document, data=data), found


def _places(model: dict[str, Any], catalogue: Mapping[str, Effect]) -> Iterator[tuple[str, Path_, dict[str, Any], str, str]]:
    """(parameter's path, keys, the mapping that holds it, key in that, SI unit) of every value that may have a spread."""

    def of(part: object, keys: Path_, before: str, units: Mapping[str, str]) -> Iterator[Any]:
        for name in part if isinstance(part, dict) else ():
            if name in units:
                yield before + name, (*keys, name), part, name, units[name]

    structure, effects = model.get("structure"), model.get("effects")
    modes = structure.get("modes") if isinstance(structure, dict) else None
    for place, mode in enumerate(modes if isinstance(modes, list) else ()):
        yield from of(mode, ("structure", "modes", place), f"modes[{place}].", _MODE)
    yield from of(structure, ("structure",), "", _ONE_MODE)
    yield from of(model.get("cutting"), ("cutting",), "", _CUTTING)
    for effect, given in effects.items() if isinstance(effects, dict) else ():
        if effect in catalogue:
            units = {one.name: one.unit for one in catalogue[effect].every_parameter}
            yield from of(given, ("effects", effect), f"{effect}.", units)


def _split(text: str, unit: str) -> tuple[str, float]:
    """The value's own text and the standard deviation in the SI unit of `value +- deviation`."""
    brackets = _BRACKETS.fullmatch(text)
    left, right, *more = (part.strip() for part in SPREAD_SIGN.split("".join(brackets.groups()) if brackets else text))
    if more or not left or not right:
        raise UnitProblem(f"'{text}' is no value with one standard deviation", _EXAMPLE)
    own = _BARE.sub("", right, count=1).strip()
    bare = _BARE.fullmatch(left) is not None
    if bare and unit == "1" and own:
        raise UnitProblem(f"'{text}' may mean two things", "give both in one unit, such as 3 % +- 0.3 %")
    if bare and own and own != "%":
        left = f"{left} {own}"
    share = own == "%" and unit != "1"
    size = parse_quantity(right, "1" if share else unit) * (abs(parse_quantity(left, unit)) if share else 1.0)
    if not size > 0.0:
        raise UnitProblem(f"'{text}' has a standard deviation that is not above 0", "correct it, or give the value alone")
    return left, size


def said(model: Model, path: str, value: float, unit: str) -> str:
    """A value in a unit, with its standard deviation where the model has one, as text that reads back exactly."""
    size = dict(model.spreads).get(path)
    text = format_quantity(value, unit, digits=None)
    return text if size is None else f"{text} +- {format_quantity(size, unit, digits=None)}"
