"""Options that commands share, and the reading of what is typed for them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import click

from testbed.api import quantity
from testbed.api.quantity import Range


class _Range(click.ParamType):
    """A number, or FIRST:LAST:COUNT, in a usual unit, or another that is written; becomes a list of SI floats."""

    def __init__(self, of: Range) -> None:
        self.of, self.name = of, of.unit

    def convert(self, value: Any, parameter: click.Parameter | None, context: click.Context | None) -> list[float]:
        """SI values; click's error where the text is no range."""
        if isinstance(value, list):
            return value
        try:
            return self.of.parsed(value)
        except ValueError as problem:
            self.fail(str(problem), parameter, context)


SPEED = _Range(quantity.SPEED)
DEPTH = _Range(quantity.DEPTH)


class _Noise(click.ParamType):
    """Noise levels such as `0,0.5um,1um`; becomes a list of metres."""

    name = "levels"

    def convert(self, value: Any, parameter: click.Parameter | None, context: click.Context | None) -> list[float]:
        """SI values; click's error where one has no unit of length (0 needs none)."""
        if isinstance(value, list):
            return value
        from testbed.units import UnitProblem, parse_quantity

        levels = []
        for part in str(value).split(","):
            try:
                levels.append(0.0 if re.fullmatch(r"\s*0+(\.0*)?\s*", part) else parse_quantity(part, "m"))
            except UnitProblem as problem:
                self.fail(str(problem), parameter, context)
        if min(levels) < 0:
            self.fail(f"'{value}' holds a level below 0", parameter, context)
        return levels


NOISE = _Noise()


class _Quantity(click.ParamType):
    """A number with its unit; becomes SI. holds: whether there may be such a one; refused: what is said where not."""

    def __init__(self, name: str, unit: str, holds: Callable[[float], bool], refused: str) -> None:
        self.name, self.unit, self.holds, self.refused = name, unit, holds, refused

    def convert(self, value: Any, parameter: click.Parameter | None, context: click.Context | None) -> float:
        """The SI value; click's error where it is none."""
        if isinstance(value, float):
            return value
        from testbed.units import UnitProblem, parse_quantity

        try:
            number = parse_quantity(value, self.unit)
        except UnitProblem as problem:
            self.fail(str(problem), parameter, context)
        if not self.holds(number):
            self.fail(f"'{value}' {self.refused}", parameter, context)
        return number


RISK = _Quantity("chance", "1", lambda risk: 0.0 < risk < 1.0, "is no chance between 0 and 100 %: give for example 5%")
LENGTH = _Quantity("length", "m", lambda length: length > 0.0, "is not above 0: give for example 0.2mm")
RATE = _Quantity("rate", "Hz", lambda rate: 0.0 < rate < math.inf, "must be above 0: give a rate such as 10kHz")


def shared(function: Callable[..., Any]) -> Callable[..., Any]:
    """--json, --seed and --quiet, which every command that computes takes."""
    for option in reversed((
        click.option("--json", "json_file", metavar="FILE", help="Write JSON, SI values; - for standard output."),
        click.option("--seed", type=click.IntRange(min=0), default=None, help="Seed of everything random."),
        click.option("--quiet", is_flag=True, help="Print nothing but errors."),
    )):
        function = option(function)
    return function


model_option = click.option("-m", "--model", "model_file", required=True, metavar="MODEL.yaml",
                            help="What is believed of the machine.")
effects_option = click.option("--effects", "folders", multiple=True, metavar="DIR",
                              help="A folder of your own effects; may be repeated. They are programs: read them first.")
