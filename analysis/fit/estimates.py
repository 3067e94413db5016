"""The machine's parameters as a fit found them, with intervals, and whether these records determine them at all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from analysis.estimate import Estimate
from analysis.fit.evidence import effective_size
from analysis.fit.fit_state import Free, WaveformFit
from analysis.fit.length_cut import moved_by_lengths
from analysis.fit.tooth_circles import at_least_strength, directed, unknown_directions
from analysis.fit.waveform import Fitter
from analysis.information import Z_95
from testbed.effect import Effect
from testbed.machine import BASE_UNITS

AT_BOUND = 1e-6  # of a bound: what is closer lies at it
NO_INTERVAL = 1e-9  # of a value: a narrower interval is none
MATTERS = {"natural_frequency": 2e-4, "damping_ratio": 0.03}  # relative change that counts; of the others 0.01
DIRECTED = 1.5  # rad: half an interval of an angle from which the direction is unknown


def at_bound(free: Sequence[Free], found: Mapping[str, Estimate]) -> tuple[str, ...]:
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
    return MATTERS.get(parameter, 0.01)


def unit_of(path: str, catalogue: Mapping[str, Effect]) -> str:
    """SI unit of a fitted parameter by its path."""
    if path == "mark_angle":
        return "rad"
    effect, _, parameter = path.partition(".")
    return catalogue[effect].parameter(parameter).unit if parameter else BASE_UNITS[path]


def estimates(fitter: Fitter, fit: WaveformFit, catalogue: Mapping[str, Effect]) -> dict[str, Estimate]:
    """Every fitted machine parameter with its 95 % interval.

    The interval is that of the linearised fit, widened for residuals that are larger than the noise and correlated, for what
    no record shows of the lengths cut, and to hold what other states that explain as much would give, within what is possible.
    A strength whose direction is unknown is at least what it is along the direction found; of one that may be nothing, or that
    two teeth alone show, the direction may be any.
    """
    fitter, fit = at_least_strength(fitter, fit, catalogue)
    count = sum(rest.size for rest in fit.residuals)
    wider = math.sqrt(max(1.0, count / effective_size(fit)))
    formal = wider**2 * np.maximum(np.diag(fit.covariance), 0.0)
    spread = Z_95 * np.sqrt(formal + np.sum(moved_by_lengths(fitter, fit) ** 2, axis=0))
    found = {}
    adrift = _adrift(fitter, fit, spread, catalogue)
    for one, half in zip(fitter.free, spread, strict=False):
        value, (least, most) = fit.state.model.value(one.path), one.bounds
        others = [state.model.value(one.path) for state in fit.alike]
        low, high = min([value, *others]) - float(half), max([value, *others]) + float(half)
        if one.path in adrift.values():
            high = most
        if one.path in adrift:
            low, high = least, most
        low, high = min(max(low, least), value), max(min(high, most), value)
        found[one.path] = Estimate(value, low, high, unit_of(one.path, catalogue), one.scale, low > least or high < most)
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
