"""The part of scenario.yaml that says what differs from run to run by chance: `random`.

    random:
      natural_frequency: {normal: 146.6 Hz, deviation: 0.2 Hz}
      damping_ratio: {lognormal: 0.0032, deviation: 20 %}       # the median; the deviation is of the logarithm
      mark_angle: {uniform: [0 deg, 360 deg]}
      process_damping: {present: 30 %, coefficient: {loguniform: [1e4 N/m, 1e6 N/m]}}

Every run draws from its own seed. Where an effect is absent its parameters stand at their neutral values. A draw out of
what the parameter may be is drawn again.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from testbed.catalogue import unknown_effect
from testbed.effect import Effect
from testbed.files.yaml_text import Document, Path_, did_you_mean
from testbed.machine import Model
from testbed.scenario.design import DEPTH, SPEED
from testbed.scenario.draws import KINDS, Chance, Distribution
from testbed.scenario.variables import MARK, Variable, effect_variables, named, value_at, variables
from testbed.units import UnitProblem, parse_quantity

# What a draw may be, where the parameter's own bounds are not in a catalogue.
_FLOORS = {"mass": 1e-300, "natural_frequency": 1e-300, "damping_ratio": 0.0, "immersion": 1e-300, "feed": 1e-300}
_CEILINGS = {"damping_ratio": 1.0 - 1e-12, "immersion": 0.5}


def read_random(document: Document, model: Model, catalogue: Mapping[str, Effect]) -> tuple[Model, tuple[Chance, ...]]:
    """What is drawn for every run, and the model with every effect that may be present, at its neutral values."""
    given = document.data.get("random")
    if given is None:
        return model, ()
    if not isinstance(given, dict) or not given:
        raise document.problem(("random",), "is no mapping", "write `damping_ratio: {uniform: [0.002, 0.01]}`")
    known = {name: one for name, one in variables(model, catalogue).items()
             if name not in (SPEED, DEPTH) and name.partition(".")[0] not in catalogue}
    known[MARK] = Variable(MARK, "rad", lambda _: None)
    chances = []
    for name in given:
        path: Path_ = ("random", name)
        if name in catalogue:
            chance = _effect(document, path, catalogue[name])
            model = model.with_effect(name, **catalogue[name].neutral())
            chances.append(chance)
            continue
        if name not in known:
            raise document.problem(path, "unknown parameter or effect", unknown_effect(str(name), {**known, **catalogue}))
        chances.append(Chance(((name, distribution(document, path, named(document, path, known, catalogue))),)))
    return model, tuple(chances)


def _effect(document: Document, path: Path_, effect: Effect) -> Chance:
    given = document.at(path)
    given = {} if given is None else given
    if not isinstance(given, dict):
        raise document.problem(path, f"'{given}' is not a mapping", "give `present` and the effect's parameters")
    known = effect_variables(effect)
    names = [one.name for one in effect.parameters]
    for key in given:
        if key != "present" and key not in names:
            raise document.problem((*path, key), "unknown parameter", did_you_mean(str(key), ["present", *names]))
    share = _share(document, (*path, "present"), given["present"]) if "present" in given else 1.0
    drawn = []
    for name in names:
        if name not in given:
            raise document.problem((*path, name), f"is missing ({effect.parameter(name).meaning})",
                                   "give it a value or a distribution")
        variable = known[f"{effect.name}.{name}"]
        drawn.append((variable.name, distribution(document, (*path, name), variable, *effect.parameter(name).bounds)))
    neutral = tuple((f"{effect.name}.{name}", value) for name, value in effect.neutral().items())
    if not names and share < 1.0:
        raise document.problem((*path, "present"), "this effect has no parameter that could switch it off", "leave it out")
    return Chance(tuple(drawn), effect.name, share, neutral)


def _share(document: Document, path: Path_, value: Any) -> float:
    share = value_at(document, path, Variable("present", "1", lambda _: None), value)
    if not 0.0 <= share <= 1.0:
        raise document.problem(path, f"'{value}' must be 0 to 100 %", "correct the value")
    return share


def distribution(document: Document, path: Path_, variable: Variable, low: float | None = None,
                 high: float | None = None) -> Distribution:
    """`{uniform: [a, b]}`, `{normal: mean, deviation: b}` and the like, or a plain value; within `low` to `high`."""
    given = document.at(path)
    quantity = variable.name.rpartition(".")[2]  # of a mode, too
    bounds = (_FLOORS.get(quantity, float("-inf")) if low is None else low,
              _CEILINGS.get(quantity, float("inf")) if high is None else high)
    if not isinstance(given, dict):
        return Distribution("fixed", value_at(document, path, variable, given))
    kind = next((name for name in KINDS if name in given), None)
    if kind is None:
        first = str(next(iter(given), ""))
        raise document.problem((*path, first) if first else path, "is no distribution", did_you_mean(first, KINDS))
    paired = kind in ("uniform", "loguniform")
    allowed = {kind} if paired else {kind, "deviation"}
    for key in given:
        if key not in allowed:
            raise document.problem((*path, key), "unknown key", did_you_mean(str(key), sorted(allowed)))
    try:
        if paired:
            ends = given[kind]
            if not isinstance(ends, list) or len(ends) != 2:
                raise document.problem((*path, kind), f"'{ends}' is not two ends", f"write {kind}: [LOWEST, HIGHEST]")
            first_, second = (value_at(document, (*path, kind), variable, end) for end in ends)
        else:
            if "deviation" not in given:
                raise document.problem((*path, "deviation"), "is missing", "add it")
            first_ = value_at(document, (*path, kind), variable, given[kind])
            second = parse_quantity(given["deviation"], "1" if kind == "lognormal" else variable.unit)
        return Distribution(kind, first_, second, *bounds)
    except UnitProblem as problem:
        raise document.problem((*path, "deviation"), problem.what, problem.do) from None
    except ValueError as problem:
        raise document.problem((*path, kind), str(problem), "correct the value") from None
