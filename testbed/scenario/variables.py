"""What of a scenario may vary from run to run: each parameter by its path, with its unit and what it may be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from testbed.effect import Effect
from testbed.files.yaml_text import Document, Path_, above_zero, at_least_zero, did_you_mean
from testbed.machine import Model
from testbed.scenario.design import DEPTH, FEED, SPEED, STARTS
from testbed.units import UnitProblem, factor_to, format_quantity, parse_quantity

Check = Callable[[float], str | None]
MARK = "mark_angle"
FASTEST_SPINDLE = 1e6  # rpm: beyond any machine


@dataclass(frozen=True)
class Variable:
    """A parameter that may vary: its unit as stored (SI), and what is wrong with a value, or None."""

    name: str
    unit: str
    check: Check


def variables(model: Model, catalogue: Mapping[str, Effect]) -> dict[str, Variable]:
    """All that may vary, by path: operating conditions, the machine's parameters, those of the model's effects."""
    found = {SPEED: Variable(SPEED, "rad/s", _spindle_speed), DEPTH: Variable(DEPTH, "m", at_least_zero),
             FEED: Variable(FEED, "m/tooth", above_zero)}
    found |= {name: Variable(name, unit, lambda _: None) for name, unit in zip(STARTS, ("m", "m/s"), strict=True)}
    found |= {name: Variable(name, unit, _allowed(model, name)) for name, unit in model.base_parameters.items()}
    for effect in model.effects:
        found |= effect_variables(catalogue[effect])
    return found


def _spindle_speed(number: float) -> str | None:
    fast = number > FASTEST_SPINDLE * factor_to("rpm", "rad/s")
    return above_zero(number) or (f"lies beyond {FASTEST_SPINDLE:g} rpm: is the unit right?" if fast else None)


def effect_variables(effect: Effect) -> dict[str, Variable]:
    """The parameters of one effect, by path."""
    return {f"{effect.name}.{one.name}": Variable(f"{effect.name}.{one.name}", one.unit, _within(*one.bounds, one.unit))
            for one in effect.parameters}


def _allowed(model: Model, name: str) -> Check:
    def check(number: float) -> str | None:
        try:
            model.with_values({name: number})
        except ValueError as problem:
            return "is refused: " + str(problem)
        return None

    return check


def _within(low: float, high: float, unit: str) -> Check:
    allowed = f"{format_quantity(low, unit)} to {format_quantity(high, unit)}"
    return lambda number: None if low <= number <= high else f"lies outside the law's bounds, {allowed}"


def named(document: Document, path: Path_, known: Mapping[str, Variable], catalogue: Mapping[str, Effect]) -> Variable:
    """The variable whose name is the path's last key; InputProblem, with the nearest known name, where there is none."""
    name = str(path[-1])
    if name in known:
        return known[name]
    effect = name.partition(".")[0]
    if effect in catalogue and not any(other.startswith(effect + ".") for other in known):
        raise document.problem(path, f"the model has no effect {effect}", f"add {effect} under model.effects first")
    raise document.problem(path, "unknown parameter", did_you_mean(name, known))


def value_at(document: Document, path: Path_, variable: Variable, value: object) -> float:
    """A quantity of the file in SI, checked; InputProblem with its line."""
    try:
        number = parse_quantity(value, variable.unit)
    except UnitProblem as problem:
        raise document.problem(path, problem.what, problem.do) from None
    wrong = variable.check(number)
    if wrong:
        raise document.problem(path, f"'{value}' {wrong}", "correct the value")
    return number
