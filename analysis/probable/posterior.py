"""What records tell of a machine, as machines can be drawn from it: the fit's covariance, widened as its intervals are.

What the records do not tell is held where it was believed, and drawn with the standard deviation that the model file gives it
or, of the machine itself, with what a belief may be off by. The fit is linearised with it unknown too, and that deviation
joined as one more measurement: whatever else it pulls along moves with it. Of what no record speaks at all (the coefficients,
where nothing cuts) the file's deviation counts by itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from testbed.analysis.comparison.compare import Comparison
from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.effect_start import all_free
from testbed.analysis.fit.estimates import estimates
from testbed.analysis.fit.evidence import effective_size
from testbed.analysis.fit.fit_state import FreeParameter, WaveformFit
from testbed.analysis.fit.identifiable import DOUBT
from testbed.analysis.fit.length_cut import moved_by_lengths
from testbed.analysis.fit.tooth_circles import at_least_strength
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.information import Z_95
from testbed.analysis.probable.draws import OPEN, Known, bounds_of
from testbed.effect import Effect
from testbed.machine import Model, base_parameter

FAINT = 1e-12  # of the largest eigenvalue of the scaled information: below, nothing is told


@dataclass(frozen=True)
class Told:
    """What a fit tells. given: parameters that no record told and no file gave a deviation, held as believed.

    assumed: those of them that are drawn, with the deviation (SI) that a belief may be off by. wider: times the noise, by which
    residuals that are large or correlated count.
    """

    known: Known
    given: tuple[str, ...]
    assumed: Mapping[str, float]
    wider: float


def why_no_chance(found: Comparison) -> str:
    """In words, why no chance can be taken from a comparison; empty where one can."""
    if found.says_nothing:
        return "hardly anything but noise was measured"
    if found.against:
        return "; ".join(found.against)
    if not found.adequate:
        return ("the model leaves more than noise in the records, and what it lacks may bend its parameters beyond any "
                "interval: testbed diagnose says whether an effect is missing")
    return "" if found.fit.converged else "the fit did not converge"


def posterior(fitter: Fitter, fit: WaveformFit, values: Mapping[str, Estimate], believed: Model,
              catalogue: Mapping[str, Effect]) -> Told:  # fmt: skip
    """What the records tell after a fit. values: its estimates, those that are held among them; believed: the model's file."""
    fitter, fit = at_least_strength(fitter, fit, catalogue)
    model = fit.state.model
    found, deviations = estimates(fitter, fit, catalogue), dict(believed.spreads)
    own = {one.path for one in fitter.free}
    held = [path for path in values if path not in own]
    every = [*all_free(fitter.records, model, catalogue), *_stated(fitter, deviations, catalogue)]
    assumed = {one.path: DOUBT[name] * one.scale for one in every
               if one.path in held and one.path not in deviations and (name := base_parameter(one.path) or "") in DOUBT}
    beliefs = assumed | deviations
    joined = [one for one in every if one.path not in own and one.path in beliefs]
    wider = math.sqrt(max(1.0, fit.variance) * max(1.0, sum(rest.size for rest in fit.residuals) / effective_size(fit)))
    covariance = _joined(fitter, fit, joined, beliefs, wider)
    free = [*fitter.free, *joined]
    for row in moved_by_lengths(fitter, fit)[:, : len(fitter.free)]:
        way = np.append(row, np.zeros(len(joined)))
        covariance += np.outer(way, way)
    half = np.array([(found[one.path].high - found[one.path].low) / (2.0 * Z_95) if one.path in found else 0.0 for one in free])
    more = np.maximum(1.0, half / np.sqrt(np.diag(covariance)))
    known = Known(model, tuple(one.path for one in free), covariance * np.outer(more, more),
                  tuple(_within(one, model) for one in free))
    moved = any(record.cut is not None and not record.forces_only for record in fitter.records)
    scale = ("mass", "stiffness") if moved else ()  # motion of a cut tells coefficients over masses, and those alone count
    known = _with_stated(known, {path: size for path, size in deviations.items() if not path.endswith(scale)}, catalogue)
    given = tuple(path for path in held if path not in deviations)
    return Told(known, given, {path: assumed[path] for path in given if path in assumed}, wider)


def _stated(fitter: Fitter, deviations: Mapping[str, float], catalogue: Mapping[str, Effect]) -> list[FreeParameter]:
    """What cuts speak of and no fit asks for: the immersion, where the file gives it a deviation."""
    asked = any(record.cut is not None for record in fitter.records) and "immersion" in deviations
    return [FreeParameter("immersion", deviations["immersion"], bounds_of("immersion", catalogue))] if asked else []


def _within(one: FreeParameter, model: Model) -> tuple[float, float]:
    """Bounds of draws: those of the fit, and where machines are, as long as the one found is among them."""
    if one.periodic:
        return OPEN
    (low, high), (least, most) = one.bounds, model.limits.get(one.path, OPEN)
    return (max(low, least), min(high, most)) if least < model.value(one.path) < most else (low, high)


def _with_stated(known: Known, deviations: Mapping[str, float], catalogue: Mapping[str, Effect]) -> Known:
    """What is known, and beside it the values of which only the file speaks, each by itself."""
    more = {path: size for path, size in deviations.items() if path not in known.paths}
    count = len(known.paths)
    covariance = np.diag([0.0] * count + [size**2 for size in more.values()])
    covariance[:count, :count] = known.covariance
    return Known(known.model, (*known.paths, *more), covariance,
                 (*known.bounds, *(bounds_of(path, catalogue) for path in more)))


def _joined(fitter: Fitter, fit: WaveformFit, joined: list[FreeParameter], deviations: Mapping[str, float], wider: float
            ) -> np.ndarray:  # fmt: skip
    """Covariance (n, n) of the fit's parameters, and of those that join it with the deviation that was stated."""
    count = len(fitter.free)
    if not joined:
        return wider**2 / max(1.0, fit.variance) * fit.covariance[:count, :count]
    every = Fitter(fitter.engine, fitter.records, [*fitter.unknowns, *joined])
    information = np.zeros((len(every.names),) * 2)
    for part in every.linearise_all(fit.state):
        information += part.information[0]
    information /= wider**2 * np.outer(every.steps, every.steps)
    for one in joined:
        place = every.names.index(one.path)
        information[place, place] += deviations[one.path] ** -2
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    covariance = (vectors / np.maximum(values, FAINT * values[-1])) @ vectors.T / np.outer(size, size)
    places = [every.names.index(one.path) for one in (*fitter.free, *joined)]
    return covariance[np.ix_(places, places)]
