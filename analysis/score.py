"""How well a method of identification does: bias, spread, rms error, coverage and failures against a known truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbed.machine import Model

PARAMETERS = ("natural_frequency", "damping_ratio", "tangential_coefficient")


@dataclass(frozen=True)
class ParameterScore:
    """One parameter at one noise level, over the identifications that did not fail.

    bias: mean error; spread: standard deviation of the estimates; rms: of the error; all in the parameter's unit.
    coverage: fraction of 95 % intervals that hold the truth. count: identifications; failures: those that gave none.
    All NaN where every identification failed.
    """

    parameter: str
    noise: float
    truth: float
    bias: float
    spread: float
    rms: float
    coverage: float
    count: int
    failures: int
    reasons: tuple[str, ...] = ()


def _one_score(parameter: str, noise: float, truth: float, estimates: Sequence[Any], failures: int,
               reasons: tuple[str, ...]) -> ParameterScore:
    count = len(estimates) + failures
    if not estimates:
        nan = float("nan")
        return ParameterScore(parameter, noise, truth, nan, nan, nan, nan, count, failures, reasons)
    values = np.array([estimate.value for estimate in estimates])
    inside = [estimate.low <= truth <= estimate.high for estimate in estimates]
    spread = float(np.std(values, ddof=1)) if values.size > 1 else 0.0
    return ParameterScore(parameter, noise, truth, float(values.mean() - truth), spread,
                          float(np.sqrt(np.mean((values - truth) ** 2))), float(np.mean(inside)), count, failures,
                          reasons)


def score(method: Callable[[Any], Mapping[str, Any]], truth: Model, records: Callable[[float, int], Any],
          noise_levels: Sequence[float], seeds: Sequence[int],
          parameters: Sequence[str] = PARAMETERS) -> list[ParameterScore]:
    """Score `method` on synthetic records of a known machine.

    records(noise, seed) makes one campaign's records at a noise level (rms, m). method(records) returns, by
    parameter path, something with `value`, `low` and `high`; a ValueError or ArithmeticError from it is a failure,
    any other error is a fault and comes through. Returns a score per noise level and parameter.
    """
    scores = []
    for noise in noise_levels:
        found: list[Mapping[str, Any]] = []
        reasons: list[str] = []
        for seed in seeds:
            campaign = records(noise, seed)
            try:
                found.append(method(campaign))
            except (ValueError, ArithmeticError) as problem:
                reasons.append(f"seed {seed}: {problem}")
        for parameter in parameters:
            scores.append(_one_score(parameter, noise, truth.value(parameter), [each[parameter] for each in found],
                                     len(reasons), tuple(reasons)))
    return scores
