"""Quantities as they are given: `3810 rpm`, a number in SI units, or many of either; and ranges such as `2500:4500:201`."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from testbed.problem import InputProblem

if TYPE_CHECKING:
    from numpy.typing import NDArray

Quantity: TypeAlias = "float | str"
Quantities: TypeAlias = "float | str | Sequence[float] | Sequence[str] | NDArray[Any]"

MOST_POINTS = 5_000
_NUMBER = re.compile(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*[a-zA-Z/]*\s*")


@dataclass(frozen=True)
class Range:
    """A number, or FIRST:LAST:COUNT, in a usual unit, or another that is written; becomes a list of SI floats.

    most: in that unit, beyond which there is no such cut.
    """

    unit: str
    si: str
    zero: bool
    most: float

    def _factor(self, unit: str) -> float:
        from testbed.units import factor_to

        return factor_to(unit, self.si)

    @property
    def factor(self) -> float:
        """SI units in one of the usual unit."""
        return self._factor(self.unit)

    def _number(self, text: str) -> float:
        """A number in the usual unit. ValueError for what is none, and for a unit of something else."""
        match = _NUMBER.fullmatch(text)
        if match is None:
            raise ValueError(text)
        unit = text[match.end(1) :].strip()
        return float(match[1]) * (self._factor(unit) / self._factor(self.unit) if unit else 1.0)

    def parsed(self, value: str, bare: bool = True) -> list[float]:
        """SI values of a text. ValueError, with what to say, where it is no range. bare: a number needs no unit."""
        example = f"give a number in {self.unit}, or FIRST:LAST:COUNT"
        parts = str(value).split(":")
        if len(parts) == 2:
            raise ValueError(f"'{value}' does not say how many: give FIRST:LAST:COUNT, such as {value}:101")
        try:
            ends = [self._number(part) for part in parts[:2]]
            count = int(parts[2]) if len(parts) == 3 else 1
        except ValueError:
            ends, count = [], 0
        if len(parts) not in (1, 3) or not ends:
            raise ValueError(f"'{value}' is not a range: {example}")
        if not bare and not all(part.strip()[-1:].isalpha() for part in parts[:2]):
            known = ":".join(f"{part.strip()} {self.unit}" for part in parts[:2])
            raise ValueError(f"'{value}' has no unit: write '{known}{':' + parts[2] if len(parts) == 3 else ''}'")
        if not 1 <= count <= MOST_POINTS:
            raise ValueError(f"'{value}' asks for {count} points: give 1 to {MOST_POINTS}")
        if not all(math.isfinite(end) for end in ends):
            raise ValueError(f"'{value}' is not finite: {example}")
        if min(ends) < 0 or (min(ends) == 0 and not self.zero):
            raise ValueError(f"'{value}' must be {self._least}: {example}")
        if count == 1 and len(set(ends)) > 1:
            raise ValueError(f"'{value}' asks for one point at two places: {example}")
        if count > 1 and ends[1] <= ends[0]:
            raise ValueError(f"'{value}' does not rise: give FIRST below LAST")
        factor = self.factor
        if ends[-1] > self.most:
            raise ValueError(f"{ends[-1]:g} {self.unit} is beyond any cut ({self.most:g} {self.unit}): --speed is in rpm, "
                             "--depth in mm; were they exchanged?")
        if count == 1:
            return [ends[0] * factor]
        return [(ends[0] + (ends[1] - ends[0]) * index / (count - 1)) * factor for index in range(count)]

    @property
    def _least(self) -> str:
        return "at least 0" if self.zero else "above 0"

    def values(self, given: Quantities, name: str, count: int | None = None) -> list[float]:
        """SI values of what a caller gave: a text with its unit, a number in SI, or many of either, which must rise.

        count: of points where a text gives two ends alone. InputProblem names the argument.
        """
        if isinstance(given, str):
            text = f"{given}:{count}" if count is not None and given.count(":") == 1 else given
            try:
                return self.parsed(text, bare=False)
            except ValueError as problem:
                raise _problem(name, problem) from None
        many: list[Any] = list(given) if hasattr(given, "__iter__") else [given]
        if not 1 <= len(many) <= MOST_POINTS:
            raise InputProblem(name, f"holds {len(many)} values", f"give 1 to {MOST_POINTS}")
        found = [self.one(value, name) for value in many]
        if any(after <= before for before, after in zip(found, found[1:], strict=False)):
            raise InputProblem(name, "does not rise", "give the smallest first, and none twice")
        return found

    def one(self, given: Quantity, name: str) -> float:
        """One SI value. InputProblem names the argument."""
        if isinstance(given, str):
            found = self.values(given, name)
            if len(found) > 1:
                raise InputProblem(name, f"'{given}' is a range", "give one value; testbed.chart takes ranges")
            return found[0]
        number = si_number(given, name, self.unit)
        if number < 0 or (number == 0 and not self.zero):
            raise InputProblem(name, f"{number:g} {self.si} must be {self._least}", "correct the value")
        if number > self.most * self.factor * (1.0 + 1e-12):  # rounding between the units
            raise InputProblem(name, f"{number:g} {self.si} is beyond any cut ({self.most:g} {self.unit})",
                               f"a plain number is in {self.si}: write for example '{number:g} {self.unit}'")
        return number


def _problem(name: str, problem: ValueError) -> InputProblem:
    what, _, do = str(problem).partition(": ")
    return InputProblem(name, what, do.replace("--", ""))


def si_number(given: Any, name: str, unit: str) -> float:
    """A finite number in SI units as a float. InputProblem for what is none; unit: the usual one, for the example."""
    if isinstance(given, bool) or not (isinstance(given, (int, float)) or hasattr(given, "__float__")):
        raise InputProblem(name, f"{given!r} is no quantity", f"give a number in SI units, or a text such as '1 {unit}'")
    number = float(given)
    if not math.isfinite(number):
        raise InputProblem(name, f"{number} is not finite", "correct the value")
    return number


def quantity(given: Quantity, si: str, name: str) -> float:
    """A quantity in SI: a text with its unit, or a number that is in SI already. InputProblem names the argument."""
    from testbed.units import UnitProblem, parse_quantity

    if not isinstance(given, str):
        return si_number(given, name, si)
    try:
        return parse_quantity(given, si)
    except UnitProblem as problem:
        raise InputProblem(name, problem.what, problem.do) from None


def positive(given: Quantity, si: str, name: str) -> float:
    """A quantity above 0, in SI. InputProblem names the argument."""
    number = quantity(given, si, name)
    if number <= 0:
        raise InputProblem(name, f"'{given}' must be above 0", "correct the value")
    return number


SPEED = Range("rpm", "rad/s", zero=False, most=1e6)
DEPTH = Range("mm", "m", zero=True, most=1e3)
