"""Identification of damping, natural frequency and cutting coefficient from the multipliers of several cuts.

Mann and Young (2006), section 4c: nonlinear least squares between empirical multipliers and those of the linear machine, by
spectral elements. Complex multipliers are fitted, not moduli (moduli alone have another minimum at ten times the damping), all
that a transient determines, weighted by their covariance. Measured and model multipliers are paired by optimal
assignment. The ratio of normal to tangential coefficient and the mass are the model's and stay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import OptimizeResult, least_squares, linear_sum_assignment

from testbed.analysis.estimate import Estimate
from testbed.analysis.information import Z_95
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.spectral_elements import plain_multipliers
from testbed.analysis.multipliers.floquet import EmpiricalMultipliers
from testbed.analysis.multipliers.recorded_cut import at_measured_speed, measured_multipliers, started_from_ring_down
from testbed.cut import Cut
from testbed.machine import Model
from testbed.recording import Recording

_ERROR_FLOOR = 3e-4  # of a multiplier: faster modes left out of the empirical fit, the map's own error
# where the machine is looked for: frequency and coefficients, times the start; the least damping as a share of the start's
FREQUENCIES, COEFFICIENTS, LEAST_DAMPING, MOST_DAMPING = (0.8, 1.25), (1e-2, 1e2), 1e-3, 0.9
_AT_END = 1e-3  # of an end of that range: what is closer stopped there
_SCALES = (1e-3, 0.2, 0.05)  # of the logarithms of frequency, damping and coefficient
# a faster mode stands, in a fit of few modes, for several that die with it: its multiplier is nobody's
_SLOWEST_SHARE = 0.3
_RATIO_STEP = 0.01  # of the logarithm of the coefficients' ratio
_CANDIDATES = 6  # model multipliers a measured one may be paired with
_MOST_NAMED = 6  # tests that an error names
_DISCORD = 10.0  # misfit per degree of freedom from which one test is asked whether it contradicts the others:
_ACCORD = 5.0  # theirs without it is at most this, and a tenth,
_FEWEST_IN_ACCORD = 3  # and so many they are at the least
_SUSPECTS = 3  # tests that are asked, the most misfitted


@dataclass(frozen=True)
class MultiplierTest:
    """One test: measured multipliers, the identified model's paired with them, whether the test was used and why."""

    cut: Cut
    measured: np.ndarray
    model: np.ndarray
    used: bool
    reason: str


@dataclass(frozen=True)
class Identification:
    """The machine found.

    model; parameters: `natural_frequency` (Hz), `damping_ratio`, `tangential_coefficient` and `normal_coefficient`
    (N/m^2); tests in the order given; chi_square: weighted misfit per degree of freedom (about 1 when the model
    explains the tests; NaN without spare data); converged; ratio_slope: relative change of the tangential coefficient
    for one of the ratio of the coefficients, which is the model's.
    """

    model: Model
    parameters: dict[str, Estimate]
    tests: tuple[MultiplierTest, ...]
    chi_square: float
    converged: bool
    ratio_slope: float


@dataclass(frozen=True)
class _Target:
    """Measured multipliers with their conjugates left out, and what whitens their differences to the model's."""

    cut: Cut
    values: np.ndarray  # complex, imaginary part >= 0
    real: np.ndarray  # bool: only the real part is compared
    whiten: np.ndarray


def _target(found: EmpiricalMultipliers, cut: Cut) -> _Target:
    slow = np.abs(found.multipliers) >= _SLOWEST_SHARE * np.abs(found.multipliers).max()
    upper = np.nonzero((found.multipliers.imag >= 0.0) & slow)[0]
    values = found.multipliers[upper]
    real = np.abs(values.imag) < 1e-12
    places = np.concatenate([upper, upper[~real] + found.rank])
    covariance = found.covariance[np.ix_(places, places)] + _ERROR_FLOOR**2 * np.eye(places.size)
    return _Target(cut, values, real, np.linalg.inv(np.linalg.cholesky(covariance)))


def _paired(measured: np.ndarray, model: np.ndarray) -> np.ndarray:
    """Of the model's multipliers in the upper half plane, the one that belongs to each measured one."""
    candidates = model[:_CANDIDATES]
    candidates = candidates[candidates.imag >= -1e-12]
    if candidates.size < measured.size:
        candidates = model[:_CANDIDATES + measured.size]
    rows, columns = linear_sum_assignment(np.abs(measured[:, None] - candidates[None, :]) ** 2)
    return candidates[columns[np.argsort(rows)]]


def _model_at(start: Model, scaled: np.ndarray) -> Model:
    """scaled: logarithms of natural frequency, damping ratio and tangential coefficient over their starting values."""
    assert start.cutting is not None
    frequency, damping, coefficient = np.exp(scaled)
    return replace(
        start,
        structure=replace(start.structure, natural_frequency=start.structure.natural_frequency * frequency,
                          damping_ratio=min(_damping(start) * damping, MOST_DAMPING)),
        cutting=replace(start.cutting, tangential_coefficient=start.cutting.tangential_coefficient * coefficient,
                        normal_coefficient=start.cutting.normal_coefficient * coefficient))


def _damping(model: Model) -> float:
    return max(model.structure.damping_ratio, 1e-4)  # a logarithm needs a start above zero


def _residual(scaled: np.ndarray, start: Model, targets: Sequence[_Target]) -> np.ndarray:
    model = _model_at(start, scaled)
    rows = []
    for target in targets:
        predicted = _paired(target.values, plain_multipliers(milling_equation(model, target.cut)))
        difference = target.values - predicted
        imaginary = np.where(predicted.imag >= 0, 1.0, -1.0) * predicted.imag
        difference = difference.real + 1j * (target.values.imag - imaginary)
        rows.append(target.whiten @ np.concatenate([difference.real, difference.imag[~target.real]]))
    return np.concatenate(rows)


def _starts(start: Model, targets: Sequence[_Target], seed: int, count: int) -> list[np.ndarray]:
    """The best points of a deterministic scatter about the starting guess, and the guess itself."""
    random = np.random.default_rng(seed)
    scatter = np.column_stack([random.uniform(-0.06, 0.06, 160), random.uniform(-1.5, 1.5, 160),
                               random.uniform(math.log(0.15), math.log(4.0), 160)])

    def cost(point: np.ndarray) -> float:
        # far away a whitened misfit says nothing but how precise the best test was: bounded per number
        return float(np.sum(np.tanh(_residual(point, start, loose)) ** 2))

    loose = [replace(target, whiten=np.eye(target.whiten.shape[0]) / 0.3) for target in targets]
    ranked = sorted(scatter, key=cost)
    return [np.zeros(3), *ranked[:count]]


def identify_multipliers(model: Model, cuts: Sequence[Cut], measured: Sequence[EmpiricalMultipliers], *,
                         names: Sequence[str] = (), starts: int = 5, seed: int = 0,
                         ratio_doubt: float = 0.0) -> Identification:
    """Fit natural frequency, damping ratio and cutting coefficient to empirical multipliers of these cuts.

    The intervals hold for the model's ratio of the coefficients, or allow for a standard error `ratio_doubt` of its
    logarithm. Tests that are not believed are left out, and one that contradicts all others. ValueError if those that remain
    hold fewer numbers than parameters; it calls the tests by `names`, or by their number.
    """
    if model.cutting is None:
        raise ValueError("the model has no cutting coefficients to identify")

    def fitted(tests: Sequence[EmpiricalMultipliers]) -> tuple[Identification, np.ndarray]:
        return _fitted(model, cuts, tests, names, starts, seed, ratio_doubt)

    found, misfits = fitted(measured)
    if not found.chi_square > _DISCORD or np.count_nonzero(misfits) <= _FEWEST_IN_ACCORD:
        return found
    others = []
    for place in np.argsort(-misfits)[:_SUSPECTS]:
        reason = f"it contradicts the others: the misfit is {found.chi_square:.3g} with it"
        tests = [replace(one, believed=False, reason=reason) if at == place else one for at, one in enumerate(measured)]
        try:
            others.append(fitted(tests)[0])
        except ValueError:  # too few numbers are left without it
            continue
    best = min(others, key=lambda one: one.chi_square, default=found)
    return best if best.chi_square <= min(_ACCORD, 0.1 * found.chi_square) else found


def _fitted(model: Model, cuts: Sequence[Cut], measured: Sequence[EmpiricalMultipliers], names: Sequence[str],
            starts: int, seed: int, ratio_doubt: float) -> tuple[Identification, np.ndarray]:
    """The machine that fits the believed tests, and each test's share of the misfit; ValueError as above."""
    used = [found.believed and found.rank > 0 for found in measured]
    targets = [_target(found, cut) for found, cut, use in zip(measured, cuts, used, strict=True) if use]
    numbers = sum(target.whiten.shape[0] for target in targets)
    if numbers < 3:
        called = names or [f"test {number}" for number in range(1, len(cuts) + 1)]
        reasons = [f"{name} ({found.reason})" for name, found, use in zip(called, measured, used, strict=True) if not use]
        more = [f"and {len(reasons) - _MOST_NAMED} more"] if len(reasons) > _MOST_NAMED else []
        raise ValueError(f"only {numbers} numbers for 3 parameters; tests left out: "
                         + (", ".join(reasons[:_MOST_NAMED] + more) or "none"))
    lower = np.log([FREQUENCIES[0], LEAST_DAMPING, COEFFICIENTS[0]])
    upper = np.log([FREQUENCIES[1], MOST_DAMPING / _damping(model), COEFFICIENTS[1]])
    fits = []
    for point in _starts(model, targets, seed, starts):  # robust and coarse: a far start may pair multipliers wrongly
        fits.append(least_squares(_residual, np.clip(point, lower + 1e-6, upper - 1e-6), bounds=(lower, upper),
                                  args=(model, targets), loss="soft_l1", x_scale=_SCALES, max_nfev=40))
    best = None
    for fit in sorted(fits, key=lambda each: each.cost)[:2]:
        fine = least_squares(_residual, fit.x, bounds=(lower, upper), args=(model, targets),
                             x_scale=_SCALES, max_nfev=60)
        if best is None or fine.cost < best.cost:
            best = fine
    assert best is not None
    ends = np.cumsum([target.whiten.shape[0] for target in targets])[:-1]
    misfits = np.zeros(len(cuts))
    misfits[np.flatnonzero(np.array(used))] = [float(part @ part) for part in np.split(best.fun, ends)]
    return _answer(model, cuts, measured, used, best, numbers, _ratio_slopes(model, targets, best),
                   ratio_doubt), misfits


def _ratio_slopes(start: Model, targets: Sequence[_Target], best: OptimizeResult) -> np.ndarray:
    """How the logarithms that are fitted follow that of the coefficients' ratio: a Gauss-Newton step at another one; (3,)."""
    assert start.cutting is not None
    other = replace(start.cutting, normal_coefficient=start.cutting.normal_coefficient * math.exp(_RATIO_STEP))
    change = _residual(best.x, replace(start, cutting=other), targets) - best.fun
    return -(np.linalg.pinv(best.jac) @ change) / _RATIO_STEP


def _answer(start, cuts, measured, used, best, numbers, ratio_slopes, ratio_doubt) -> Identification:
    model = _model_at(start, best.x)
    assert model.cutting is not None
    spare = numbers - 3
    chi_square = 2.0 * float(best.cost) / spare if spare else float("nan")
    # a misfit above the multipliers' own errors widens the intervals; one below does not narrow them
    inflation = math.sqrt(max(1.0, chi_square)) if spare else 1.0
    errors = inflation * np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac)))

    def estimate(value: float, error: float, ratio_slope: float, unit: str) -> Estimate:
        log_spread = Z_95 * math.hypot(float(error), ratio_doubt * float(ratio_slope))
        factor = math.exp(min(log_spread, 700.0))  # what is fitted is the logarithm
        return Estimate(float(value), float(value) / factor, float(value) * factor, unit)

    of_frequency, of_damping, of_coefficient = ratio_slopes
    parameters = {
        "natural_frequency": estimate(model.structure.natural_frequency, errors[0], of_frequency, "Hz"),
        "damping_ratio": estimate(model.structure.damping_ratio, errors[1], of_damping, "1"),
        "tangential_coefficient": estimate(model.cutting.tangential_coefficient, errors[2], of_coefficient, "N/m^2"),
        "normal_coefficient": estimate(model.cutting.normal_coefficient, errors[2], 1.0 + of_coefficient, "N/m^2"),
    }
    tests = []
    for cut, found, use in zip(cuts, measured, used, strict=True):
        predicted = plain_multipliers(milling_equation(model, cut))
        tests.append(MultiplierTest(cut, found.multipliers, beside(found, predicted), use, found.reason))
    return Identification(model, parameters, tuple(tests), chi_square, bool(best.success), float(of_coefficient))


def beside(measured: EmpiricalMultipliers, predicted: np.ndarray) -> np.ndarray:
    """The predicted multipliers (complex, largest first) nearest to the measured ones, in their order; without any, two."""
    if not measured.rank:
        return predicted[:2]
    rows, columns = linear_sum_assignment(np.abs(measured.multipliers[:, None] - predicted[None, :]))
    return predicted[columns[np.argsort(rows)]]


def identify(model: Model, tests: Sequence[tuple[Recording, Cut]], *, names: Sequence[str] = (),
             starts: int = 5, seed: int = 0, channel: str = "displacement", delays: int | None = None) -> Identification:
    """Identify the machine from recorded cuts; `model` is the starting guess.

    Where free decay follows a cut, natural frequency and damping start from it. Each test is a recording and its cut;
    entry and exit come from the recording's conditions `entry_time` and `exit_time`, else from its pass times, else
    the whole recording is taken as the cut. A cut of too few periods is left out. names and ValueError as above. The model
    is asked at the speeds that the marks show or, where there are none, the vibration.
    """
    if model.cutter is None:
        raise ValueError("the model has no cutter: multipliers need cuts")
    tests = [(recording, at_measured_speed(cut, recording, model.cutter.flutes, channel)) for recording, cut in tests]
    measured = [measured_multipliers(recording, cut, model.cutter.flutes, channel, delays) for recording, cut in tests]
    model = started_from_ring_down(model, tests, channel)
    return identify_multipliers(model, [cut for _, cut in tests], measured, names=names, starts=starts,
                                seed=seed)


def at_an_end(start: Model, found: Model) -> tuple[str, ...]:
    """Parameters of a machine found by multipliers that lie at an end of the range searched from the `start`."""
    ranges = {name: tuple(end * start.value(name) for end in ends) for name, ends in (
        ("natural_frequency", FREQUENCIES), ("tangential_coefficient", COEFFICIENTS), ("normal_coefficient", COEFFICIENTS))}
    ranges["damping_ratio"] = LEAST_DAMPING * _damping(start), MOST_DAMPING
    return tuple(name for name, ends in ranges.items()
                 if found.value(name) and any(math.isclose(found.value(name), end, rel_tol=_AT_END) for end in ends))
