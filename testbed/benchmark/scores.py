"""Scores of answers against the truth: identification, naming, chatter. What was not answered is never counted as right."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbed.benchmark.answers import PARAMETERS, Answer


@dataclass(frozen=True)
class ParameterScore:
    """One parameter over all campaigns: how many were answered; relative errors, median and largest; how many intervals were
    given, the share of them that hold the truth, and their median width relative to it. NaN where there is nothing to count."""

    parameter: str
    answered: int
    error: float
    worst: float
    intervals: int
    coverage: float
    width: float


@dataclass(frozen=True)
class Score:
    """Of one method. right, wrong, none: campaigns by what it named - the very effects that are hidden (or rightly none),
    others, or nothing where something is hidden or no answer at all. recall: share of the chattering cuts, of the quiet ones,
    that are told as such; answered: cuts with an answer, of `cuts`. balanced_accuracy: the mean of the two recalls."""

    parameters: tuple[ParameterScore, ...]
    campaigns: int
    right: int
    wrong: int
    none: int
    recall_chatter: float
    recall_quiet: float
    balanced_accuracy: float
    answered: int
    cuts: int


def score(truth: Mapping[str, Any], answers: Mapping[str, Answer]) -> Score:
    """truth: campaign -> {parameters, effects, chatter} as it was sealed; answers: campaign -> Answer."""
    said = {name: answers.get(name, Answer()) for name in truth}
    named = [_named(truth[name]["effects"], said[name].effects) for name in truth]
    told = [(bool(true), said[name].chatter.get(cut)) for name in truth for cut, true in truth[name]["chatter"].items()]
    chatter, quiet = (_share([answer == true for true, answer in told if true == which]) for which in (True, False))
    right, wrong, none = (named.count(one) for one in ("right", "wrong", "none"))
    return Score(tuple(_parameter(name, truth, said) for name in PARAMETERS), len(named), right, wrong, none, chatter, quiet,
                 0.5 * (chatter + quiet), sum(answer is not None for _, answer in told), len(told))


def _share(values: list[bool]) -> float:
    return float(np.mean(values)) if values else math.nan


def _named(hidden: Any, named: tuple[str, ...] | None) -> str:
    if named is not None and set(named) == set(hidden):
        return "right"
    return "wrong" if named else "none"


def _parameter(name: str, truth: Mapping[str, Any], said: Mapping[str, Answer]) -> ParameterScore:
    pairs = [(truth[campaign]["parameters"][name], one.parameters[name]) for campaign, one in said.items()
             if name in one.parameters]
    errors = [abs(value - true) / abs(true) for true, (value, _, _) in pairs]
    spans = [(true, low, high) for true, (_, low, high) in pairs if not math.isnan(low)]
    return ParameterScore(
        name, len(pairs), float(np.median(errors)) if errors else math.nan, max(errors, default=math.nan), len(spans),
        _share([low <= true <= high for true, low, high in spans]),
        float(np.median([(high - low) / abs(true) for true, low, high in spans])) if spans else math.nan)
