"""Options that commands share, and the reading of what is typed for them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import click

from testbed.problem import InputProblem

MOST_POINTS = 5_000
_NUMBER = re.compile(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*[a-zA-Z/]*\s*")


class _Range(click.ParamType):
    """A number, or FIRST:LAST:COUNT, in a usual unit, or another that is written; becomes a list of SI floats.

    most: in that unit, beyond which there is no such cut.
    """

    def __init__(self, unit: str, si: str, name: str, zero: bool, most: float) -> None:
        self.unit, self.si, self.name, self.zero, self.most = unit, si, name, zero, most

    def _factor(self, unit: str) -> float:
        from testbed.units import factor_to

        return factor_to(unit, self.si)

    def _number(self, text: str) -> float:
        """A number in the usual unit. ValueError for what is none, and for a unit of something else."""
        match = _NUMBER.fullmatch(text)
        if match is None:
            raise ValueError(text)
        unit = text[match.end(1) :].strip()
        return float(match[1]) * (self._factor(unit) / self._factor(self.unit) if unit else 1.0)

    def convert(self, value: Any, parameter: click.Parameter | None, context: click.Context | None) -> list[float]:
        """SI values; click's error where the text is no range."""
        if isinstance(value, list):
            return value
        example = f"give a number in {self.unit}, or FIRST:LAST:COUNT"
        parts = str(value).split(":")
        if len(parts) == 2:
            self.fail(f"'{value}' does not say how many: give FIRST:LAST:COUNT, such as {value}:101", parameter, context)
        try:
            ends = [self._number(part) for part in parts[:2]]
            count = int(parts[2]) if len(parts) == 3 else 1
        except ValueError:
            ends, count = [], 0
        if len(parts) not in (1, 3) or not ends:
            self.fail(f"'{value}' is not a range: {example}", parameter, context)
        if not 1 <= count <= MOST_POINTS:
            self.fail(f"'{value}' asks for {count} points: give 1 to {MOST_POINTS}", parameter, context)
        if not all(math.isfinite(end) for end in ends):
            self.fail(f"'{value}' is not finite: {example}", parameter, context)
        if min(ends) < 0 or (min(ends) == 0 and not self.zero):
            least = "at least 0" if self.zero else "above 0"
            self.fail(f"'{value}' must be {least}: {example}", parameter, context)
        if count == 1 and len(set(ends)) > 1:
            self.fail(f"'{value}' asks for one point at two places: {example}", parameter, context)
        if count > 1 and ends[1] <= ends[0]:
            self.fail(f"'{value}' does not rise: give FIRST below LAST", parameter, context)
        factor = self._factor(self.unit)
        if ends[-1] > self.most:
            self.fail(f"{ends[-1]:g} {self.unit} is beyond any cut ({self.most:g} {self.unit}): --speed is in rpm, --depth in "
                      "mm; were they exchanged?", parameter, context)
        if count == 1:
            return [ends[0] * factor]
        return [(ends[0] + (ends[1] - ends[0]) * index / (count - 1)) * factor for index in range(count)]


SPEED = _Range("rpm", "rad/s", "rpm", zero=False, most=1e6)
DEPTH = _Range("mm", "m", "mm", zero=True, most=1e3)


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


def catalogue_of(folders: tuple[str, ...]) -> Any:
    """The effects known to this command."""
    from testbed.catalogue import catalogue

    return catalogue(*folders)


def cutting_model(path: str, catalogue: Any = None, otherwise: str = "") -> Any:
    """A model.yaml that has a cutter. InputProblem, with what to do `otherwise`, where it has none."""
    from testbed.files.model_file import read_model

    model = read_model(path, catalogue)
    check_cutting(model, path, otherwise)
    return model


def check_cutting(model: Any, path: str, otherwise: str = "") -> None:
    """InputProblem, with what to do `otherwise`, where a model has no cutter."""
    if model.cutter is None:
        raise InputProblem(path, "has no cutter and cutting", f"add both: this command is about a cut{otherwise}")


def refuse_planar(model: Any, place: str, instead: str = "this command takes one mode along x so far; run, chart, "
                  "multipliers, identify and compare take any") -> None:
    """InputProblem where a model has more than the one mode along the feed, with what to do instead."""
    if model.planar:
        raise InputProblem(place, "has modes beyond one of the workpiece along x, or a pitch for each tooth", instead)


def refuse_planar_effects(model: Any, place: str) -> None:
    """InputProblem where a machine beyond one mode along x has effects: such a loop is not linearised so far."""
    if model.planar and model.effects:
        raise InputProblem(place, f"has effects ({', '.join(sorted(model.effects))}) beside modes beyond one of the workpiece "
                           "along x, or a pitch for each tooth", "leave the effects out: here such a machine cuts without them")


def in_the_work(model: Any) -> tuple[Any, list[str]]:
    """A machine in x and y without loss of contact, which its linear answer does not need, and a note where it had that."""
    if not model.planar or set(model.effects) != {"contact_loss"}:
        return model, []
    return model.without_effect("contact_loss"), ["contact_loss is left out: this is an answer for teeth that stay in the work"]


def guesses_note(model: Any) -> list[str]:
    """A line where a model has parameters that no record told: what it foretells is a guess as far as it hangs on them."""
    told = ", ".join(f"{path} ({model.value(path):.4g})" for path in model.not_determined)
    return [f"guesses, not determined by the records behind this model: {told}; what follows hangs on them"] if told else []
