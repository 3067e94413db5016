"""The machine's parameters as a fit found them, with intervals, and whether these records determine them at all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.evidence import effective_size
from testbed.analysis.fit.fit_state import FreeParameter, WaveformFit
from testbed.analysis.fit.length_cut import moved_by_lengths
from testbed.analysis.fit.tooth_circles import at_least_strength, directed, unknown_directions
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.information import Z_95
from testbed.effect import Effect
from testbed.machine import BASE_UNITS, base_parameter

AT_BOUND = 1e-6  # of a bound: what is closer lies at it
NO_INTERVAL = 1e-9  # of a value: a narrower interval is none
LEAST_SLIP = 1e-3  # of the speed: two cuts or more that are off alike by more may be timed by a clock that is off
SLIPS_ALIKE = 0.2  # of that factor, up to which the cuts' own differ
BY_THE_CLOCK = {"Hz": 1.0, "N": 2.0, "N/m": 2.0, "N/m^2": 2.0, "N/m^3": 2.0}  # by unit: powers of its rate, the mass held
MATTERS = {"natural_frequency": 2e-4, "damping_ratio": 0.03}  # relative change that counts; of the others 0.01
DIRECTED = 1.5  # rad: half an interval of an angle from which the direction is unknown


def at_bound(free: Sequence[FreeParameter], found: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Those of the parameters that lie at an end of the range searched, or have no interval."""
    bounds = {one.path: one.bounds for one in free}
    return tuple(path for path, one in found.items() if one.high - one.low <= NO_INTERVAL * abs(one.value)
                 or any(math.isclose(one.value, end, rel_tol=AT_BOUND) for end in bounds.get(path, ())))


def said_at_bound(paths: Sequence[str]) -> str:
    """In words, what it means that parameters lie at a bound."""
    which = "it" if len(paths) == 1 else "them"
    return f"{', '.join(paths)} at the end of the range searched: these records do not determine {which} with this model"


def not_determined(found: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Those of the parameters that the data do not tell."""
    return tuple(path for path, one in found.items() if not one.determined)


def said_not_determined(paths: Sequence[str]) -> str:
    """In words, that the data do not tell parameters."""
    return f"{', '.join(paths)}: not determined by these records; a value that is given all the same is a guess"


def matters(parameter: str) -> float:
    """Relative change of a parameter of the machine from which it counts."""
    return MATTERS.get(base_parameter(parameter) or parameter, 0.01)


def unit_of(path: str, catalogue: Mapping[str, Effect]) -> str:
    """SI unit of a fitted parameter by its path."""
    if path == "mark_angle":
        return "rad"
    own = base_parameter(path)
    effect, _, parameter = path.partition(".")
    return BASE_UNITS[own] if own else catalogue[effect].parameter(parameter).unit


def speed_factors(fitter: Fitter, fit: WaveformFit) -> list[float]:
    """The speed found over the stated one, of every cut."""
    cuts = [(one, own) for one, own in zip(fitter.records, fit.state.nuisances, strict=True) if one.cut is not None]
    return [2.0 * math.pi / one.period * own.speed / one.cut.spindle_speed for one, own in cuts if one.cut is not None]


def clock_factor(fitter: Fitter, fit: WaveformFit) -> float:
    """By what all frequencies may be too high: the cuts' common factor over the stated speeds; 1 where they have none.

    A spindle that slips and a sampling rate that is written down wrongly look the same.
    """
    off = [math.log(one) for one in speed_factors(fitter, fit)]
    middle = math.fsum(off) / len(off) if off else 0.0
    alike = len(off) > 1 and max(off) - min(off) <= SLIPS_ALIKE * abs(middle)
    return math.exp(middle) if alike and abs(middle) > LEAST_SLIP else 1.0


def clock_note(fitter: Fitter, fit: WaveformFit) -> list[str]:
    """A line where a common factor of all speeds leaves open what time is."""
    factor = clock_factor(fitter, fit)
    said = (f"all cuts turn at {factor:.5g} times the stated speed: the spindle may slip, or the sampling rate may be off; the "
            "intervals of frequencies and of coefficients hold both")
    return [said] if factor != 1.0 else []


def estimates(fitter: Fitter, fit: WaveformFit, catalogue: Mapping[str, Effect]) -> dict[str, Estimate]:
    """Every fitted machine parameter with its 95 % interval.

    The interval is that of the linearised fit, widened for residuals that are larger than the noise and correlated, for what
    no record shows of the lengths cut, and to hold what other states that explain as much would give, within what is possible.
    Where all cuts turn at one factor beside the stated speed, frequencies are held to be off by as much, too, and what is a
    force by the mass by its square.
    A strength whose direction is unknown is at least what it is along the direction found; of one that may be nothing, or that
    two teeth alone show, the direction may be any.
    """
    fitter, fit = at_least_strength(fitter, fit, catalogue)
    count = sum(rest.size for rest in fit.residuals)
    wider = math.sqrt(max(1.0, count / effective_size(fit)))
    formal = wider**2 * np.maximum(np.diag(fit.covariance), 0.0)
    spread = Z_95 * np.sqrt(formal + np.sum(moved_by_lengths(fitter, fit) ** 2, axis=0))
    found = {}
    adrift, clock = _adrift(fitter, fit, spread, catalogue), clock_factor(fitter, fit)
    for one, half in zip(fitter.free, spread, strict=False):
        value, (least, most) = fit.state.model.value(one.path), one.bounds
        unit = unit_of(one.path, catalogue)
        others = [state.model.value(one.path) for state in fit.alike]
        others += [value * clock ** -(BY_THE_CLOCK.get(unit, 0.0) * (1.0 + SLIPS_ALIKE))]
        low, high = min([value, *others]) - float(half), max([value, *others]) + float(half)
        if one.path in adrift.values():
            high = most
        if one.path in adrift:
            low, high = least, most
        low, high = min(max(low, least), value), max(min(high, most), value)
        found[one.path] = Estimate(value, low, high, unit, one.scale, low > least or high < most)
    for direction, strength in adrift.items():
        if direction not in found and strength in found:
            effect, _, parameter = direction.partition(".")
            known = catalogue[effect].parameter(parameter)
            found[direction] = Estimate(fit.state.model.value(direction), *known.bounds, known.unit, bounded=False)
    return found


def _adrift(fitter: Fitter, fit: WaveformFit, spread: np.ndarray, catalogue: Mapping[str, Effect]) -> dict[str, str]:
    """The strength, by its direction, of every direction that is unknown; both are paths, free or not.

    "" for the strength where the direction alone is unknown, because there may be nothing that it is the direction of.
    """
    model, half = fit.state.model, dict(zip((one.path for one in fitter.free), spread, strict=False))
    cannot, found = unknown_directions(model, catalogue), {}
    for name in model.effects:
        if (pair := directed(catalogue[name])) is None:
            continue
        strength, direction = (f"{name}.{one}" for one in pair)
        size, turn = half.get(strength), half.get(direction)
        away = abs(model.value(strength) - catalogue[name].parameter(pair[0]).neutral)
        if name in cannot or turn is not None and turn > DIRECTED:
            found[direction] = strength
        elif turn is not None and size is not None and away < size:
            found[direction] = ""
    return found
