"""The structure of a model file: mass, frequency and damping of one mode, a machine of `models/`, or a list of modes."""

from __future__ import annotations

import math
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator

from testbed.files.spread_file import said
from testbed.files.yaml_text import Document, Path_, Strict, above_zero, did_you_mean, in_unit, validate
from testbed.machine import BASE_UNITS, STRUCTURE, Carrier, Mode, Model, Structure, repeated_mode
from testbed.units import UnitProblem, format_quantity, parse_quantity

_SHORT = {name: BASE_UNITS[name] for name in STRUCTURE}
_AXES = {"x": 0.0, "y": 0.5 * math.pi, "-x": math.pi, "-y": -0.5 * math.pi}


def _below_one(number: float) -> str | None:
    return None if 0.0 <= number < 1.0 else "must be at least 0 and below 1"


def as_direction(value: object) -> float:
    """The angle (rad) of `x`, `y` or an angle with its unit."""
    if isinstance(value, str) and value.strip().lower() in _AXES:
        return _AXES[value.strip().lower()]
    try:
        return parse_quantity(value, "rad")
    except UnitProblem as problem:
        raise UnitProblem(problem.what, "write x, y, or an angle from x towards y such as 30 deg") from None


class _Mode(Strict):
    natural_frequency: Annotated[float, in_unit("Hz", above_zero)]
    damping_ratio: Annotated[float, in_unit("1", _below_one)]
    direction: Annotated[float, BeforeValidator(as_direction)]
    mass: Annotated[float | None, in_unit("kg", above_zero)] = None
    stiffness: Annotated[float | None, in_unit("N/m", above_zero)] = None
    on: Carrier = "workpiece"


class _Structure(Strict):
    machine: str | None = None
    modes: Any = None
    mass: Annotated[float | None, in_unit("kg", above_zero)] = None
    natural_frequency: Annotated[float | None, in_unit("Hz", above_zero)] = None
    damping_ratio: Annotated[float | None, in_unit("1", _below_one)] = None


def machines() -> tuple[str, ...]:
    """Names of the machines that stand in `models/`."""
    from testbed import models

    folders = (entry for place in models.__path__ for entry in Path(place).iterdir())
    return tuple(sorted(entry.name for entry in folders if (entry / "__init__.py").exists()))


def machine_structure(name: str) -> Structure:
    """The structure of a machine of `models/`; KeyError if there is none of that name."""
    if name not in machines():
        raise KeyError(name)
    return import_module(f"testbed.models.{name}").structure()


def read_structure(document: Document, path: Path_) -> tuple[Structure, str | None]:
    """The structure and the name of the machine it came from."""
    given = document.at(path)
    if isinstance(given, dict) and given.get("modes") is not None:
        return _modes(document, path, given), None
    values: dict[str, Any] = {}
    machine, where = (given, path) if isinstance(given, str) else (None, (*path, "machine"))
    if machine is None:
        part = validate(document, _Structure, path)
        machine = part.machine
        values = part.model_dump(exclude_none=True, exclude={"machine", "modes"})
    if machine is not None:
        try:
            values = _short_form(machine_structure(machine)) | values
        except KeyError:
            raise document.problem(where, f"unknown machine '{machine}'", did_you_mean(machine, machines())) from None
    for name in _SHORT:
        if name not in values:
            raise document.problem((*path, name), "is missing", f"add it, or name a machine: {', '.join(machines())}")
    return Structure(**values), machine


def _short_form(structure: Structure) -> dict[str, float]:
    """The three values of a machine of one mode along the feed."""
    return {name: getattr(structure, name) for name in _SHORT}


def _modes(document: Document, path: Path_, given: dict[str, Any]) -> Structure:
    """The structure that a list of modes gives."""
    beside = [name for name in given if name != "modes"]
    validate(document, _Structure, path)  # what is no key at all is said first
    if beside:
        raise document.problem((*path, beside[0]), "stands beside modes", "give the modes alone")
    if not isinstance(given["modes"], list) or not given["modes"]:
        raise document.problem((*path, "modes"), "is no list of modes", "begin each mode with a dash")
    modes = [_mode(document, (*path, "modes", place)) for place in range(len(given["modes"]))]
    twice = repeated_mode(modes)
    if twice is not None:
        raise document.problem((*path, "modes", twice), "a mode stands twice",
                               "leave one out, or correct its frequency or direction")
    return Structure.of(modes)


def _mode(document: Document, path: Path_) -> Mode:
    one = validate(document, _Mode, path)
    if (one.mass is None) == (one.stiffness is None):
        given = "gives neither mass nor stiffness" if one.mass is None else "gives both mass and stiffness"
        raise document.problem(path, given, "give one of the two")
    mass = one.mass
    if mass is None:
        assert one.stiffness is not None  # one of the two is given
        mass = _mass(one.stiffness, one.natural_frequency)
    return Mode(mass, one.natural_frequency, one.damping_ratio, one.direction, one.on)


def structure_lines(model: Model) -> list[str]:
    """The lines of a model file that read back to exactly this structure."""
    spreads = dict(model.spreads)
    if model.structure.planar or "stiffness" in spreads or "direction" in spreads:
        return ["structure:", "  modes:", *(_mode_line(model, place) for place in range(len(model.structure.modes)))]
    values = _short_form(model.structure)
    if model.machine is not None:
        usual = _short_form(machine_structure(model.machine))
        values = {name: value for name, value in values.items() if value != usual[name] or name in spreads}
        if not values:
            return [f"structure: {model.machine}"]
    machine = [f"  machine: {model.machine}"] if model.machine is not None else []
    return ["structure:", *machine, *(f"  {name}: {said(model, name, value, _SHORT[name])}" for name, value in values.items())]


def _mode_line(model: Model, place: int) -> str:
    mode, before, spreads = model.structure.modes[place], f"modes[{place}]." * model.structure.planar, dict(model.spreads)
    values = {name: said(model, before + name, getattr(mode, name), unit) for name, unit in _SHORT.items()}
    if f"{before}stiffness" in spreads:
        del values["mass"]
        values["stiffness"] = said(model, f"{before}stiffness", _stiffness(mode), "N/m")
    axis = next((name for name, angle in _AXES.items() if angle == mode.direction), exact(mode.direction, "deg"))
    turned = spreads.get(f"{before}direction")
    values["direction"] = axis if turned is None else f"{axis} +- {exact(turned, 'deg')}"
    return f"    - {{{', '.join(f'{name}: {value}' for name, value in values.items())}, on: {mode.on}}}"


def _stiffness(mode: Mode) -> float:
    """The stiffness (N/m) of which the mode's mass is made, to the last digit."""
    below, above = mode.stiffness, mode.stiffness
    for _ in range(8):
        for one in (below, above):
            if _mass(one, mode.natural_frequency) == mode.mass:
                return one
        below, above = math.nextafter(below, 0.0), math.nextafter(above, math.inf)
    return mode.stiffness


def _mass(stiffness: float, natural_frequency: float) -> float:
    return stiffness / (2.0 * math.pi * natural_frequency) ** 2


def exact(value: float, unit: str) -> str:
    """A number with its unit that reads back to exactly this value."""
    return format_quantity(value, unit, digits=None)
