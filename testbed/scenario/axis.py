"""An axis as a user writes it: one value, values sharing a unit, a list, or equally spaced ones.

    3810 rpm        2850, 3050, 3810 rpm        [2850 rpm, 3050 rpm]        {from: 2500 rpm, to: 4500 rpm, count: 20}
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from pydantic import Field

from testbed.files.yaml_text import Document, Path_, Strict, validate
from testbed.units import UnitProblem, factor_to, parse_quantity

MAX_VALUES = 10_000_000


class _Spaced(Strict):
    first: Any = Field(alias="from")
    last: Any = Field(alias="to")
    count: int


def axis(document: Document, path: Path_, value: Any, si: str) -> tuple[float, ...]:
    """The values of an axis in SI; never empty."""
    try:
        if isinstance(value, dict):
            return _spaced(document, path, si)
        listed = isinstance(value, list)
        values = tuple(parse_quantity(item, si) for item in value) if listed else _sharing_a_unit(value, si)
    except UnitProblem as problem:
        raise document.problem(path, problem.what, problem.do) from None
    if not values:
        raise document.problem(path, "has no values", "give at least one")
    return values


def _sharing_a_unit(value: object, si: str) -> tuple[float, ...]:
    """`2850, 3050, 3810 rpm`, also in brackets; a single quantity is a list of one."""
    match = re.fullmatch(r"\s*\[?\s*([^,\]]+(?:,[^,\]]+)+?)\s*(?:\]\s*(.*))?", str(value))
    if isinstance(value, bool) or not isinstance(value, str) or match is None:
        return (parse_quantity(value, si),)
    numbers = [part.strip() for part in match[1].split(",")]
    unit = match[2]
    if not unit:
        number = re.match(r"[-+.\deE]+|\S+", numbers[-1])
        unit = numbers[-1][number.end():] if number else ""
        numbers[-1] = number.group() if number else ""
    if unit.strip():
        factor_to(unit, si)
    return tuple(parse_quantity(f"{number} {unit}", si) for number in numbers)


def _spaced(document: Document, path: Path_, si: str) -> tuple[float, ...]:
    """`{from: 2500 rpm, to: 4500 rpm, count: 20}`: equally spaced, both ends included."""
    spaced = validate(document, _Spaced, path)
    ends = []
    for name, end in (("from", spaced.first), ("to", spaced.last)):
        try:
            ends.append(parse_quantity(end, si))
        except UnitProblem as problem:
            raise document.problem((*path, name), problem.what, problem.do) from None
    if not 1 <= spaced.count <= MAX_VALUES:
        raise document.problem((*path, "count"), f"'{spaced.count}' must be 1 to {MAX_VALUES}", "correct the value")
    if spaced.count == 1 and ends[0] != ends[1]:
        raise document.problem((*path, "count"), "one point cannot be at both ends", "give one value or a higher count")
    width = (ends[1] - ends[0]) / max(1, spaced.count - 1)
    return tuple(ends[0] + index * width for index in range(spaced.count - 1)) + (ends[1],)


def check_all(document: Document, path: Path_, values: tuple[float, ...], check: Callable[[float], str | None]) -> None:
    """InputProblem if `check` finds something wrong with any value of an axis."""
    wrong = next((check(value) for value in values if check(value)), None)
    if wrong:
        raise document.problem(path, f"every value {wrong}", "correct the value")
