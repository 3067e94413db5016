"""Are the machine's constants constant? Base parameters fitted test by test, and their trends against the conditions.

Every record is fitted alone, from the joint fit, with its own nuisances; the mark angle and the effects the model has stay
as found jointly. A constant that drifts names the family of what is missing: damping that rises with depth over speed is
process damping, coefficients that fall with feed an edge force (Altintas 2012, Manufacturing Automation, section 2.3).
The trends are regressions weighted by the intervals and by what the values scatter beyond them (as in a meta-analysis:
DerSimonian and Laird 1986); many are tried, so the false discoveries among them are controlled (Benjamini and Hochberg
1995), and a change too small to matter is none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, stdtr

from testbed.analysis.comparison.adequacy import Adequacy, controlled
from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.estimates import estimates, matters
from testbed.analysis.fit.fit_state import FreeParameter, WaveformFit
from testbed.analysis.fit.free_parameters import free_parameters
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.information import Z_95
from testbed.effect import Effect
from testbed.system.threads import threaded

PARAMETERS = ("natural_frequency", "damping_ratio", "tangential_coefficient", "normal_coefficient")
COVARIATES = ("spindle speed", "depth of cut", "feed per tooth", "depth over speed")
LEAST = 4  # tests that a trend needs
LEVEL = 0.05
ITERATIONS = 10
ERROR_FLOOR = 1e-5  # of a value: the engine's own error; no interval is believed to be smaller
MARK_ERROR = 0.02  # of a sample: no tachometer's edge is placed better


@dataclass(frozen=True)
class TestFit:
    """One record fitted alone. conditions: by covariate (rad/s, m, m/tooth, m s); parameters: with 95 % intervals."""

    __test__ = False  # a test of a machine, not of this program

    name: str
    conditions: Mapping[str, float]
    parameters: Mapping[str, Estimate]
    converged: bool


@dataclass(frozen=True)
class Trend:
    """A parameter against a condition: relative change over the range of the condition, its p value, whether it holds
    with the false discoveries controlled and matters."""

    parameter: str
    covariate: str
    change: float
    p_value: float
    holds: bool = False


@dataclass(frozen=True)
class Constancy:
    """All tests, the trends tried; by parameter the chance p of so large a scatter if it were constant, and the scatter's
    standard deviation relative to the mean."""

    tests: tuple[TestFit, ...]
    trends: tuple[Trend, ...]
    scatter: Mapping[str, float]
    spread: Mapping[str, float]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Those that any test could speak of, in the usual order."""
        return tuple(name for name in PARAMETERS if any(name in test.parameters for test in self.tests))

    def drift(self, parameter: str) -> Trend | None:
        """The surest trend of a parameter that holds, if any."""
        held = [trend for trend in self.trends if trend.parameter == parameter and trend.holds]
        return min(held, key=lambda trend: trend.p_value, default=None)

    def verdict(self, parameter: str) -> str:
        """What is to be said of one parameter."""
        tests = [test for test in self.tests if parameter in test.parameters]
        trend = self.drift(parameter)
        if trend is not None:
            way = "rises" if trend.change > 0 else "falls"
            return (
                f"drifts: {way} with {trend.covariate}, by {abs(trend.change):.1%} over the range tested, "
                f"{said_p(trend.p_value)}"
            )
        if parameter not in self.scatter:
            return "one test alone cannot say"
        spread, chance = self.spread[parameter], said_p(self.scatter[parameter])
        why = "with no trend" if len(tests) >= LEAST else f"and {len(tests)} tests are too few for a trend"
        if self._beyond(parameter):
            if spread > matters(parameter):
                return f"scatters by {spread:.1%}, more than its intervals ({chance}), {why}"
            return f"differs by {spread:.2%} from test to test: more than its intervals ({chance}), but too little to matter"
        if self._apart(parameter):
            return f"differs by no more than chance allows ({chance}), though intervals exclude each other: by {spread:.2%}"
        if spread > 3.0 * matters(parameter):
            return f"does not differ beyond its intervals, which are wide: the tests scatter by {spread:.1%}"
        return f"is constant: the tests scatter by {spread:.2%}"

    def short(self, parameter: str) -> str:
        """The verdict in a few words, for the title of a picture."""
        if self.drift(parameter) is not None:
            return "drifts"
        if parameter not in self.scatter:
            return "one test"
        if self._beyond(parameter):
            return "scatters" if self.spread[parameter] > matters(parameter) else "differs too little to matter"
        if self._apart(parameter):
            return "differs as chance may have it"
        return "uncertain" if self.spread[parameter] > 3.0 * matters(parameter) else "constant"

    def _beyond(self, parameter: str) -> bool:
        """Whether the tests differ by more than their intervals, all parameters' chances together."""
        return self.scatter[parameter] < LEVEL / len(self.parameters)

    def _apart(self, parameter: str) -> bool:
        """Whether two tests have intervals that exclude each other."""
        some = [test.parameters[parameter] for test in self.tests if parameter in test.parameters]
        return max(one.low for one in some) > min(one.high for one in some)


def said_p(p_value: float) -> str:
    """A p value in words; below 1e-12 its size says nothing."""
    return f"p = {p_value:.2g}" if p_value >= 1e-12 else "p < 1e-12"


class _OneTest(Fitter):
    """A single record with the mark angle held: one test alone could trade it against the coefficients."""

    def __init__(self, whole: Fitter, index: int, free: Sequence[FreeParameter]) -> None:
        record = whole.records[index]
        if record.clock_error is not None:
            least = MARK_ERROR * 2 * math.pi / (record.rate * record.period)
            record = replace(record, clock_error=(max(record.clock_error[0], least), record.clock_error[1]))
        super().__init__(whole.engine, [record], free)
        self.fits_angle = False
        self.names = tuple(one.path for one in free)


def conditions_of_test(record: Observed) -> dict[str, float]:
    """The covariates of a cut (SI); empty for other records."""
    if record.cut is None:
        return {}
    speed, depth = record.cut.spindle_speed, record.cut.axial_depth_of_cut
    return dict(zip(COVARIATES, (speed, depth, record.cut.feed_per_tooth, depth / speed), strict=True))


def fit_alone(whole: Fitter, fit: WaveformFit, index: int, catalogue: Mapping[str, Effect]) -> TestFit:
    """One record's own base parameters, from where the joint fit ended."""
    record = whole.records[index]
    free = [one for one in free_parameters([record], fit.state.model) if one.path in PARAMETERS]
    fitter = _OneTest(whole, index, free)
    state = replace(fit.state, nuisances=(fit.state.nuisances[index],))
    found = fitter.fit(state, iterations=ITERATIONS, tolerance=1e-4)
    return TestFit(record.name, conditions_of_test(record), estimates(fitter, found, catalogue), found.converged)


def constancy(fitter: Fitter, fit: WaveformFit, catalogue: Mapping[str, Effect]) -> Constancy:
    """Fit every record of a joint fit alone and look for trends. Deterministic."""
    chosen = [
        place
        for place, record in enumerate(fitter.records)
        if any(one.path in PARAMETERS for one in free_parameters([record], fit.state.model))
    ]
    return judged(threaded(lambda place: fit_alone(fitter, fit, place, catalogue), chosen))


def judged(tests: Sequence[TestFit]) -> Constancy:
    """Trends of tests already fitted."""
    trends, scatter, spread = [], {}, {}
    for parameter in PARAMETERS:
        values, errors, cuts = _of(tests, parameter)
        if len(values) < 2:
            continue
        mean = np.sum(values / errors**2) / np.sum(errors**-2.0)
        spread[parameter] = float(values.std(ddof=1) / abs(values.mean()))
        scatter[parameter] = float(chdtrc(len(values) - 1, np.sum(((values - mean) / errors) ** 2)))
        for covariate in COVARIATES:
            x = np.array([test.conditions.get(covariate, math.nan) for test in cuts])
            known = np.isfinite(x)
            if known.sum() >= LEAST and len(np.unique(np.round(x[known] / np.abs(x[known]).max(), 6))) > 1:
                trends.append(Trend(parameter, covariate, *_slope(x[known], values[known], errors[known])))
    marked = controlled([Adequacy(one.parameter, one.covariate, one.change, one.p_value) for one in trends], LEVEL)
    held = tuple(
        replace(trend, holds=test.fails and abs(trend.change) > matters(trend.parameter))
        for trend, test in zip(trends, marked, strict=True)
    )
    return Constancy(tuple(tests), held, scatter, spread)


def _of(tests: Sequence[TestFit], parameter: str) -> tuple[np.ndarray, np.ndarray, list[TestFit]]:
    """(values, standard errors, tests) of a parameter where a test could speak of it at all."""
    kept = [test for test in tests if parameter in test.parameters]
    values = np.array([test.parameters[parameter].value for test in kept])
    spread = np.array([test.parameters[parameter].high - test.parameters[parameter].low for test in kept])
    errors = np.maximum(spread / (2 * Z_95), ERROR_FLOOR * np.abs(values))
    sure = np.isfinite(errors) & (errors > 0)
    return values[sure], errors[sure], [test for test, fine in zip(kept, sure, strict=True) if fine]


def _slope(x: np.ndarray, values: np.ndarray, errors: np.ndarray) -> tuple[float, float]:
    """(relative change over the range of x, p value) of a weighted straight line."""
    columns = np.column_stack([np.ones_like(x), (x - x.mean()) / np.ptp(x)])
    freedom = len(x) - 2
    excess = 0.0

    def line(excess: float) -> tuple[np.ndarray, float, np.ndarray]:
        weight = 1.0 / np.sqrt(errors**2 + excess)
        found, *_ = np.linalg.lstsq(columns * weight[:, None], values * weight, rcond=None)
        return found, float(np.sum(((values - columns @ found) * weight) ** 2)), weight

    if line(0.0)[1] > freedom:  # what scatters beyond the intervals goes into the weights, so that no test rules alone
        low, high = 0.0, float(np.ptp(values)) ** 2 + float(errors.max()) ** 2
        for _ in range(60):
            excess = 0.5 * (low + high)
            low, high = (excess, high) if line(excess)[1] > freedom else (low, excess)
    found, _, weight = line(excess)
    error = math.sqrt(float(np.linalg.pinv((columns * weight[:, None]).T @ (columns * weight[:, None]))[1, 1]))
    p_value = float(2.0 * stdtr(freedom, -abs(found[1]) / max(error, 1e-300)))
    return float(found[1] / max(abs(found[0]), 1e-300)), p_value
