"""What records do not tell of a model is held where it was believed, and the rest fitted beside it.

Where only a product of two parameters shows (a mode's mass and how much of it the sensor sees), a fit may end anywhere along
that valley, and its values, written to a file, would be taken for knowledge. So those that shape an effect are held at what was
believed, then the base's, then strengths, one after the other while the records are explained as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.estimates import estimates, unit_of
from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.free_parameters import free_parameters
from testbed.analysis.fit.identifiable import spread_by_held
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.information import Z_95
from testbed.effect import Effect
from testbed.machine import Model, base_parameter

AS_WELL = 2.0  # by which minus the log likelihood may be larger with a parameter held: two standard errors of it
ITERATIONS = 15


@dataclass(frozen=True)
class Held:
    """A fit with what its records do not tell held.

    values: every parameter's estimate; guesses: paths of those that are not determined; held: of those of them that were held,
    of a structure in the plane before the fit, too.
    """

    fitter: Fitter
    fit: WaveformFit
    values: Mapping[str, Estimate]
    guesses: tuple[str, ...]
    held: tuple[str, ...]

    @property
    def model(self) -> Model:
        """The model of the fit, which says what in it is not determined."""
        model = self.fit.state.model
        before = (path for path in model.not_determined if path not in self.values)
        return replace(model, not_determined=tuple(sorted({*before, *self.guesses})))


def with_guesses_held(fitter: Fitter, fit: WaveformFit, believed: Model, catalogue: Mapping[str, Effect]) -> Held:
    """The fit with what is not determined held as believed, where that explains the records as well.

    believed: the model before the fit; of an effect that it lacks, what the effect's file begins with is believed.
    """
    known = {one.path for one in fitter.free}
    before = [one.path for one in free_parameters(fitter.records, believed)
              if believed.structure.planar and one.path not in known]
    held = list(before)
    found = estimates(fitter, fit, catalogue)
    free = {one.path for one in fitter.free}
    tried: set[str] = set()
    while paths := [path for path, one in found.items() if path in free - tried and _is_guess(path, one, catalogue)]:
        path = min(paths, key=lambda one: _turn(one, catalogue))
        tried.add(path)
        for value in _believed_values(path, fit.state.model.value(path), believed, catalogue):
            without = fitter.without(path)
            other = without.fit(fit.state.with_value(path, value), iterations=ITERATIONS)
            if other.cost <= fit.cost + AS_WELL * max(1.0, fit.variance):
                fitter, fit = without, replace(other, alike=fit.alike, converged=fit.converged or other.converged)
                held.append(path)
                found = estimates(fitter, fit, catalogue)
                break
    values = dict(found)
    for path, spread in spread_by_held(fitter, fit, believed).items():
        one, more = values[path], Z_95 * spread
        values[path] = replace(one, low=one.value - math.hypot(one.value - one.low, more),
                               high=one.value + math.hypot(one.high - one.value, more))
    for path in held:
        value = fit.state.model.value(path)
        ends = (-math.inf, math.inf) if path in before else _bounds(path, value, catalogue)
        values[path] = Estimate(value, *ends, unit_of(path, catalogue), bounded=False)
    values = {path: values[path] for path in [*_in_order(believed, values), *values]}
    return Held(fitter, fit, values, tuple(path for path, one in values.items() if not one.determined), tuple(held))


def _in_order(model: Model, values: Mapping[str, Estimate]) -> list[str]:
    """Paths of the base parameters among the values, as the model has them."""
    return [path for path in model.base_parameters if path in values] if model.structure.planar else []


def _is_guess(path: str, one: Estimate, catalogue: Mapping[str, Effect]) -> bool:
    """Whether a value is a guess. Of a strength that may be nothing, the one found is the best there is, however wide."""
    return not one.determined and (not one.bounded or _turn(path, catalogue) < 2)


def _turn(path: str, catalogue: Mapping[str, Effect]) -> int:
    """When a parameter is held: first what shapes an effect, last its strength."""
    if base_parameter(path):
        return 1
    effect, _, parameter = path.partition(".")
    return 2 if catalogue[effect].parameter(parameter).vanishes else 0


def _believed_values(path: str, found: float, believed: Model, catalogue: Mapping[str, Effect]) -> list[float]:
    """Where a parameter may be held: as believed, or there with its sign turned."""
    effect, _, parameter = path.partition(".")
    if base_parameter(path) or effect in believed.effects:
        value = believed.value(path)
    else:
        known = catalogue[effect].parameter(parameter)
        value = known.example if known.start is None else known.start
    low, high = _bounds(path, value, catalogue)
    turned = [-value] if found * value < 0.0 and low <= -value <= high else []
    return [*turned, value]


def _bounds(path: str, value: float, catalogue: Mapping[str, Effect]) -> tuple[float, float]:
    effect, _, parameter = path.partition(".")
    return (value, value) if base_parameter(path) else catalogue[effect].parameter(parameter).bounds
