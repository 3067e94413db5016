"""model.yaml, what the user believes of the machine: read with units and checked, written to read back exactly.

    structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}   # or: flexure
    cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}
    cutting: {direction: up-milling, immersion: 0.162,                                # or radial_depth: 4.51 mm
              tangential_coefficient: 550 N/mm^2, normal_coefficient: 200 N/mm^2}
    effects: {process_damping: {coefficient: 1.0e5 N/m}}

`structure` may also be `{machine: flexure, damping_ratio: 0.004}`: the named machine with some values replaced; or any number
of modes, each with a mass or a stiffness, a direction (x, y, or an angle from x, the feed, towards y) and what carries it:

    structure: {modes: [{natural_frequency: 922 Hz, damping_ratio: 0.011, mass: 39.93 gram, direction: x, on: tool}]}

`cutter` may give `pitch`, the angle of each tooth to the one before it: [85 deg, 95 deg, 85 deg, 95 deg]. A value of the
structure, the cutting and the effects may have a standard deviation: 550 +- 50 N/mm^2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator

from testbed.catalogue import catalogue as known_effects
from testbed.catalogue import unknown_effect
from testbed.effect import Effect
from testbed.files.spread_file import nominal, said
from testbed.files.structure_file import exact, read_structure, structure_lines
from testbed.files.synonyms import milling_direction
from testbed.files.yaml_text import Document, Path_, Strict, above_zero, did_you_mean, in_unit, load, parse, validate
from testbed.machine import MOST_FLUTES, Cutter, Cutting, Direction, Model, radial_immersion_fraction
from testbed.problem import InputProblem
from testbed.system.atomic import write_text
from testbed.units import UnitProblem, format_quantity, parse_quantity

LARGEST_COEFFICIENT = 1e12  # N/m^2: the hardest alloys are cut at some 1e4 N/mm^2


def _immersion(number: float) -> str | None:
    return None if 0.0 < number <= 0.5 else "must be above 0 and at most 0.5 (0.5 is a slot)"


def _helix(number: float) -> str | None:
    return None if abs(number) < math.pi / 2 else "must lie between -90 deg and 90 deg"


def _coefficient(number: float) -> str | None:
    return None if abs(number) <= LARGEST_COEFFICIENT else "lies beyond 1e6 N/mm^2: is the unit right?"


def _tangential(number: float) -> str | None:
    return above_zero(number) or _coefficient(number)


class _Cutter(Strict):
    flutes: int = 1
    diameter: Annotated[float, in_unit("m", above_zero)] = 19.05e-3
    helix_angle: Annotated[float, in_unit("rad", _helix)] = 0.0
    pitch: list[Annotated[float, in_unit("rad", above_zero)]] = []


class _Cutting(Strict):
    direction: Annotated[Direction, BeforeValidator(milling_direction)] = "up-milling"
    immersion: Annotated[float | None, in_unit("1", _immersion)] = None
    radial_depth: Annotated[float | None, in_unit("m", above_zero)] = None
    tangential_coefficient: Annotated[float, in_unit("N/m^2", _tangential)]
    normal_coefficient: Annotated[float, in_unit("N/m^2", _coefficient)]


class _ModelFile(Strict):
    structure: Any
    cutter: Any = None
    cutting: Any = None
    effects: Any = None
    not_determined: list[str] = []
    tapped: dict[str, list[Any]] = {}


def read_model(path: str | Path, catalogue: Mapping[str, Effect] | None = None) -> Model:
    """Read model.yaml. InputProblem with file, line and field where anything in it is wrong."""
    return replace(model_from(load(path), (), catalogue), file=str(path))


def is_model(path: str | Path) -> bool:
    """Whether a file is a model.yaml by its keys; its values, and effects that this command does not know, may be wrong."""
    try:
        validate(load(path), _ModelFile)
    except InputProblem:
        return False
    return True


def model_from(document: Document, path: Path_ = (), catalogue: Mapping[str, Effect] | None = None) -> Model:
    """The model that stands at `path` of a document; the root, or under `model` in a scenario."""
    known = known_effects() if catalogue is None else catalogue
    document, spreads = nominal(document, path, known)
    parts = validate(document, _ModelFile, path)
    structure, machine = read_structure(document, (*path, "structure"))
    if (parts.cutter is None) != (parts.cutting is None):
        there, absent = ("cutter", "cutting") if parts.cutting is None else ("cutting", "cutter")
        raise document.problem(path, f"{there} without {absent}", f"add {absent}, or remove both")
    effects = _effects(document, (*path, "effects"), known)
    if not structure.planar:  # one mode along the feed, which has no number
        spreads = {name.removeprefix("modes[0]."): size for name, size in spreads.items()}
    model = Model(structure, effects=effects, machine=machine, spreads=tuple(spreads.items()))
    guesses = tuple(parts.not_determined)
    if parts.cutter is None:
        return _with_records(document, path, model, guesses, parts.tapped)
    cutter = validate(document, _Cutter, (*path, "cutter"))
    if not 1 <= cutter.flutes <= MOST_FLUTES:
        wrong = "must be at least 1" if cutter.flutes < 1 else "is more than any cutter has"
        raise document.problem((*path, "cutter", "flutes"), f"'{cutter.flutes}' {wrong}", f"give 1 to {MOST_FLUTES}")
    try:
        shape = Cutter(cutter.flutes, cutter.diameter, cutter.helix_angle, tuple(cutter.pitch))
    except ValueError as problem:  # the values alone are checked already
        raise document.problem((*path, "cutter", "pitch"), str(problem),
                               "give one angle a tooth; all together make 360 deg") from None
    model = replace(model, cutter=shape, cutting=_cutting(document, (*path, "cutting"), cutter.diameter))
    return _with_records(document, path, model, guesses, parts.tapped)


def _with_records(document: Document, path: Path_, model: Model, guesses: tuple[str, ...],
                  tapped: Mapping[str, list[Any]]) -> Model:
    """The model with the parameters named that no record told, and those that a tap did; each must be one of its own."""
    for place, name in enumerate(guesses):
        try:
            model.value(name)
        except KeyError:
            known = [*model.base_parameters, *(f"{effect}.{one}" for effect, values in model.effects.items() for one in values)]
            raise document.problem((*path, "not_determined", place), f"'{name}' is no parameter of this model",
                                   did_you_mean(name, known)) from None
    ends = {}
    for name, given in tapped.items():
        there = (*path, "tapped", name)
        if name not in model.base_parameters:
            raise document.problem(there, f"'{name}' is no parameter of this machine",
                                   did_you_mean(name, list(model.base_parameters)))
        try:
            low, high = (parse_quantity(one, model.base_parameters[name]) for one in given)
        except UnitProblem as problem:
            raise document.problem(there, problem.what, problem.do) from None
        except ValueError:
            low, high = math.inf, -math.inf
        if not low <= high:
            raise document.problem(there, "is no interval", "give its two ends, the lower one first: [146.4 Hz, 146.8 Hz]")
        ends[name] = (low, high)
    return replace(model, not_determined=guesses, tapped=ends)


def _cutting(document: Document, path: Path_, diameter: float) -> Cutting:
    part = validate(document, _Cutting, path)
    if (part.immersion is None) == (part.radial_depth is None):
        raise document.problem(path, "gives both immersion and radial_depth" if part.immersion is not None
                               else "gives no immersion", "give one of immersion and radial_depth")
    immersion, depth = part.immersion, part.radial_depth
    if immersion is None:
        assert depth is not None  # one of the two is given
        if depth > diameter:
            raise document.problem((*path, "radial_depth"), "is above the cutter's diameter", "correct one of them")
        immersion = radial_immersion_fraction(depth, diameter)
    return Cutting(part.direction, immersion, part.tangential_coefficient, part.normal_coefficient)


def _effects(document: Document, path: Path_, catalogue: Mapping[str, Effect]) -> dict[str, dict[str, float]]:
    try:
        given = document.at(path)
    except KeyError:
        return {}
    if given is None:
        return {}
    if isinstance(given, str) or (isinstance(given, list) and all(isinstance(name, str) for name in given)):
        given = dict.fromkeys([given] if isinstance(given, str) else given)
    if not isinstance(given, dict):
        raise document.problem(path, "is no mapping of effects", "write for example `contact_loss: {}`")
    effects = {}
    for name, parameters in given.items():
        if name not in catalogue:
            raise document.problem((*path, name), "unknown effect", unknown_effect(str(name), catalogue))
        effects[name] = _parameters(document, (*path, name), catalogue[name], parameters)
    return effects


def _parameters(document: Document, path: Path_, effect: Effect, given: object) -> dict[str, float]:
    """An effect's parameters in SI, each with its unit and within its bounds.

    None may be missing but what few channels show, and what gives the law another form.
    """
    if not isinstance(given, (dict, type(None))):
        raise document.problem(path, f"'{given}' is not a mapping", "give the parameters by name")
    given = given or {}
    names = [parameter.name for parameter in effect.every_parameter]
    for name in given:
        if name not in names:
            raise document.problem((*path, name), "unknown parameter", did_you_mean(name, names))
    values = {}
    for parameter in effect.every_parameter:
        place = (*path, parameter.name)
        if parameter.name not in given:
            if parameter.channels or parameter in effect.form:
                continue
            shown = format_quantity(parameter.example, parameter.unit)
            raise document.problem(place, f"is missing ({parameter.meaning})", f"add it, for example {shown}")
        try:
            value = parse_quantity(given[parameter.name], parameter.unit)
        except UnitProblem as problem:
            raise document.problem(place, problem.what, problem.do) from None
        low, high = parameter.bounds
        if not low <= value <= high:
            allowed = f"{format_quantity(low, parameter.unit)} to {format_quantity(high, parameter.unit)}"
            raise document.problem(place, f"'{given[parameter.name]}' lies outside the law's bounds", f"give {allowed}")
        values[parameter.name] = value
    return dict(effect.complete(values))


def model_text(model: Model, catalogue: Mapping[str, Effect] | None = None) -> str:
    """The text of a model.yaml that reads back to exactly this model."""
    lines = structure_lines(model)
    if model.cutter is not None and model.cutting is not None:
        cutter, cutting = model.cutter, model.cutting
        lines += ["cutter:", f"  flutes: {cutter.flutes}", f"  diameter: {exact(cutter.diameter, 'mm')}",
                  f"  helix_angle: {exact(cutter.helix_angle, 'deg')}", *_pitch_lines(cutter),
                  "cutting:", f"  direction: {cutting.direction}",
                  f"  immersion: {said(model, 'immersion', cutting.immersion, '1')}",
                  *(f"  {name}: {said(model, name, model.value(name), 'N/mm^2')}"
                    for name in ("tangential_coefficient", "normal_coefficient"))]
    if model.not_determined:
        told = ", ".join(f'"{path}"' if "[" in path else path for path in model.not_determined)
        lines.append(f"not_determined: [{told}]  # no record told these: they are guesses")
    if model.tapped:
        lines.append("tapped:  # 95 % intervals by a tap test: testbed compare says whether the cut has the same")
        lines += [f"  {name}: [{exact(low, model.base_parameters[name])}, {exact(high, model.base_parameters[name])}]"
                  for name, (low, high) in model.tapped.items() if name in model.base_parameters]
    if not model.effects:
        return "\n".join(lines) + "\n"
    known = known_effects() if catalogue is None else catalogue
    lines.append("effects:")
    for name, values in model.effects.items():
        lines.append(f"  {name}:" if values else f"  {name}: {{}}")
        lines += [f"    {key}: {said(model, f'{name}.{key}', value, known[name].parameter(key).unit)}"
                  for key, value in values.items()]
    return "\n".join(lines) + "\n"


def effect_text(effect: Effect, values: Mapping[str, float]) -> str:
    """What a model file says of one effect, in one line, rounded for a reader."""
    told = ", ".join(f"{name}: {format_quantity(value, effect.parameter(name).unit)}" for name, value in values.items())
    return f"effects: {{{effect.name}: {{{told}}}}}"


def _pitch_lines(cutter: Cutter) -> list[str]:
    return [f"  pitch: [{', '.join(exact(angle, 'deg') for angle in cutter.pitch_angles)}]"] if cutter.pitch_angles else []


def write_model(model: Model, path: str | Path, catalogue: Mapping[str, Effect] | None = None,
                remarks: Sequence[str] = ()) -> None:
    """Write model.yaml, whole or not at all, with remarks as comments above. InputProblem where the place cannot be written."""
    write_text(path, "".join(f"# {one}\n" for one in remarks) + model_text(model, catalogue))


def model_from_text(text: str, name: str = "model", catalogue: Mapping[str, Effect] | None = None) -> Model:
    """The model a text holds; `name` stands for the file in messages."""
    return model_from(parse(text, name), (), catalogue)
