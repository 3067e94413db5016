"""Answers to a benchmark: one JSON file, checked key by key, so that a misspelt one is not a missing answer."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from testbed.problem import InputProblem
from testbed.units import nearest

PARAMETERS = {"natural_frequency": "Hz", "damping_ratio": "1", "tangential_coefficient": "N/m^2"}
MOST_BYTES = 50_000_000


@dataclass(frozen=True)
class Answer:
    """What a method says of one campaign; what it does not say is no answer.

    parameters: name -> (value, low, high), SI, the ends NaN where it gives no interval. effects: the effects that are missing
    in the model, empty: none is; None: no answer. chatter: cut -> whether it chatters.
    """

    parameters: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    effects: tuple[str, ...] | None = None
    chatter: Mapping[str, bool] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """As it stands in the file."""
        return {"parameters": {name: {"value": value, "low": None if math.isnan(low) else low,
                                      "high": None if math.isnan(high) else high}
                               for name, (value, low, high) in self.parameters.items()},
                "effects": None if self.effects is None else list(self.effects), "chatter": dict(self.chatter)}


def read_answers(path: Path, asked: Mapping[str, Collection[str]], effects: Collection[str]) -> dict[str, Answer]:
    """The answers of a file. asked: campaign -> its cuts; effects: the catalogue's names. InputProblem for a malformed one."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputProblem(path, "is too large for answers", "give the file of answers")
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise InputProblem(path, f"cannot be read ({problem.strerror})", "give a file of answers") from None
    except (ValueError, RecursionError) as problem:
        raise InputProblem(path, f"is no JSON ({problem})", "see the example in the benchmark's README.md") from None
    given = content.get("campaigns") if isinstance(content, dict) else None
    if not isinstance(given, dict):
        raise InputProblem(path, "has no `campaigns`", "see the example in the benchmark's README.md")
    return {name: _answer(path, name, one, _known(path, "campaigns", name, asked) and asked[name], effects)
            for name, one in given.items()}


def _known(path: Path, where: str, name: object, known: Collection[str]) -> bool:
    if name in known:
        return True
    close = nearest(str(name), known)
    raise InputProblem(path, f"{where}: '{name}' is not known",
                       f"did you mean {close}?" if close else f"known: {', '.join(list(known)[:12])}")


def _answer(path: Path, campaign: str, given: Any, cuts: Any, effects: Collection[str]) -> Answer:
    if not isinstance(given, dict):
        raise InputProblem(path, f"campaigns.{campaign} is no mapping", "see the example in the benchmark's README.md")
    for key in given:
        _known(path, f"campaigns.{campaign}", key, ("parameters", "effects", "chatter"))
    parts = {key: given.get(key) or {} for key in ("parameters", "chatter")}
    for key, part in parts.items():
        if not isinstance(part, dict):
            raise InputProblem(path, f"campaigns.{campaign}.{key} is no mapping", "see the benchmark's README.md")
        for name in part:
            _known(path, f"campaigns.{campaign}.{key}", name, PARAMETERS if key == "parameters" else cuts)
    named = given.get("effects")
    if named is not None and not (isinstance(named, list) and all(isinstance(one, str) for one in named)):
        raise InputProblem(path, f"campaigns.{campaign}.effects is no list of names", "[] says that none is missing")
    for one in named or ():
        _known(path, f"campaigns.{campaign}.effects", one, effects)
    for cut, said in parts["chatter"].items():
        if said is not None and not isinstance(said, bool):
            raise InputProblem(path, f"campaigns.{campaign}.chatter.{cut} is {said!r}", "give true, false, or null: not known")
    return Answer({name: _three(path, f"campaigns.{campaign}.parameters.{name}", one)
                   for name, one in parts["parameters"].items() if one is not None},
                  None if named is None else tuple(sorted(set(named))),
                  {cut: said for cut, said in parts["chatter"].items() if said is not None})


def _three(path: Path, where: str, given: Any) -> tuple[float, float, float]:
    form = "give {value, low, high} in SI units; low and high may be null"
    if not isinstance(given, dict) or set(given) - {"value", "low", "high"} or "value" not in given:
        raise InputProblem(path, f"{where} is no value with its interval", form)
    found = []
    for key in ("value", "low", "high"):
        one = given.get(key)
        if one is None and key != "value":
            one = math.nan
        elif not isinstance(one, (int, float)) or isinstance(one, bool) or not math.isfinite(one):
            raise InputProblem(path, f"{where}.{key} is no number", form)
        found.append(float(one))
    value, low, high = found
    if math.isnan(low) != math.isnan(high) or low > high:
        raise InputProblem(path, f"{where}: {low:g} to {high:g} is no interval", form)
    return value, low, high
