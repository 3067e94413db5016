"""How well a method of identification does: bias, spread, rms error, coverage, failures and cost against a known truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbed.analysis.information import Z_95
from testbed.machine import Model

PARAMETERS = ("natural_frequency", "damping_ratio", "tangential_coefficient")


@dataclass(frozen=True)
class ParameterScore:
    """One parameter at one noise level, over the identifications that did not fail.

    bias: mean error; spread: standard deviation of the estimates; rms: of the error; all in the parameter's unit.
    coverage: fraction of 95 % intervals that hold the truth, NaN where the method gives none. stated: the standard
    deviation that the intervals claim (their mean half width over `Z_95`), in the parameter's unit. count:
    identifications; failures: those that gave no value. method, tests: which method, from how many tests. All numbers
    are NaN where every identification failed.
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
    stated: float = math.nan
    method: str = ""
    tests: int = 0


@dataclass(frozen=True)
class Case:
    """One identification of a study: method, noise level (rms, m), number of tests, number of the repeat."""

    method: str
    noise: float
    tests: int
    number: int


@dataclass(frozen=True)
class Outcome:
    """What a case gave: parameter -> (value, low, high), or why there is nothing; processor time (s) it took."""

    found: Mapping[str, tuple[float, float, float]] | None
    reason: str = ""
    seconds: float = math.nan


@dataclass(frozen=True)
class Cost:
    """Processor time (s) of one identification: median and 90th percentile. It differs from run to run."""

    method: str
    noise: float
    tests: int
    median: float
    high: float


def _one_score(parameter: str, truth: float, estimates: Sequence[tuple[float, float, float]], case: Case, count: int,
               reasons: tuple[str, ...]) -> ParameterScore:
    nan, failures = float("nan"), count - len(estimates)
    if not estimates:
        return ParameterScore(parameter, case.noise, truth, nan, nan, nan, nan, count, failures, reasons, nan, case.method,
                              case.tests)
    values, low, high = (np.array(column, float) for column in zip(*estimates, strict=True))
    given = np.isfinite(low) & np.isfinite(high)
    coverage = float(np.mean((low[given] <= truth) & (truth <= high[given]))) if given.any() else nan
    stated = float(np.mean(high[given] - low[given])) / (2 * Z_95) if given.any() else nan
    spread = float(np.std(values, ddof=1)) if values.size > 1 else 0.0
    return ParameterScore(parameter, case.noise, truth, float(values.mean() - truth), spread,
                          float(np.sqrt(np.mean((values - truth) ** 2))), coverage, count, failures, reasons, stated,
                          case.method, case.tests)


def score(method: Callable[[Any], Mapping[str, Any]], truth: Model, records: Callable[[float, int], Any],
          noise_levels: Sequence[float], seeds: Sequence[int],
          parameters: Sequence[str] = PARAMETERS) -> list[ParameterScore]:
    """Score `method` on synthetic records of a known machine.

    records(noise, seed) makes one campaign's records at a noise level (rms, m). method(records) returns, by
    parameter path, something with `value`, `low` and `high`; a ValueError or ArithmeticError from it is a failure,
    any other error is a fault and comes through. Returns a score per noise level and parameter.
    """
    outcomes: dict[Case, Outcome] = {}
    for noise in noise_levels:
        for seed in seeds:
            campaign = records(noise, seed)
            try:
                found = method(campaign)
                outcome = Outcome({name: (found[name].value, found[name].low, found[name].high) for name in parameters})
            except (ValueError, ArithmeticError) as problem:
                outcome = Outcome(None, str(problem))
            outcomes[Case("", noise, 0, seed)] = outcome
    return study_scores(outcomes, truth, parameters)


def study_scores(outcomes: Mapping[Case, Outcome], truth: Model,
                 parameters: Sequence[str] = PARAMETERS) -> list[ParameterScore]:
    """A score for each method, number of tests, noise level and parameter, in the order of the cases.

    A parameter that a method never gives has no score; one that it gives at times counts as failed at the others.
    """
    groups: dict[tuple[str, int, float], list[tuple[Case, Outcome]]] = {}
    given: dict[str, set[str]] = {}
    for case, outcome in outcomes.items():
        groups.setdefault((case.method, case.tests, case.noise), []).append((case, outcome))
        given.setdefault(case.method, set()).update(outcome.found or {})
    scores = []
    for (method, _, _), members in groups.items():
        reasons = tuple(f"seed {case.number}: {outcome.reason}" for case, outcome in members if outcome.found is None)
        for parameter in parameters:
            if given[method] and parameter not in given[method]:
                continue
            found = [outcome.found[parameter] for _, outcome in members if outcome.found and parameter in outcome.found]
            scores.append(_one_score(parameter, truth.value(parameter), found, members[0][0], len(members), reasons))
    return scores


def costs(outcomes: Mapping[Case, Outcome]) -> list[Cost]:
    """What an identification costs, for each method, number of tests and noise level, failures included."""
    groups: dict[tuple[str, int, float], list[float]] = {}
    for case, outcome in outcomes.items():
        groups.setdefault((case.method, case.tests, case.noise), []).append(outcome.seconds)
    return [Cost(method, noise, tests, float(np.median(seconds)), float(np.quantile(seconds, 0.9)))
            for (method, tests, noise), seconds in groups.items()]


def cases(methods: Iterable[str], tests: Iterable[int], repeats: Mapping[float, int]) -> list[Case]:
    """Every identification of a study. repeats: how many at each noise level (m)."""
    counts = list(tests)
    return [Case(method, noise, count, number) for method in methods for count in counts
            for noise, most in repeats.items() for number in range(most)]


def binomial_interval(share: float, count: int) -> tuple[float, float]:
    """95 % interval of a probability from a share of `count` trials (Wilson 1927, J. Am. Stat. Assoc. 22, 209)."""
    if count < 1 or not math.isfinite(share):
        return math.nan, math.nan
    z2 = Z_95**2 / count
    middle, half = share + z2 / 2, Z_95 * math.sqrt(share * (1 - share) / count + z2 / (4 * count))
    return max(0.0, (middle - half) / (1 + z2)), min(1.0, (middle + half) / (1 + z2))
