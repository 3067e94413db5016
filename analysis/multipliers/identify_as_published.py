"""Identification as the paper did it, to measure later methods against: four delays, one multiplier a test, no weights.

Mann and Young (2006), sections 2 and 4c. The motion is sampled at four equally spaced phases a period; the least-squares
Jacobian of the first periods after the entry, of as many dimensions as there are singular values before their knee, gives
one largest multiplier a test; natural frequency, damping and cutting coefficient are fitted to these by unweighted
nonlinear least squares from a single start. Not in the paper, and chosen here: 16 periods, and the knee as the largest
ratio of neighbouring singular values, if it is above 3. The paper gives no intervals, and none are made up here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares

from testbed.analysis.estimate import Estimate
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.temporal_elements import characteristic_multipliers
from testbed.analysis.multipliers.floquet import delay_embedding_multipliers, once_per_period_samples, passing_period
from testbed.analysis.multipliers.recorded_cut import cut_bounds
from testbed.cut import Cut
from testbed.machine import Model
from testbed.recording import Recording

DELAYS, PERIODS = 4, 16
_ELEMENTS, _KNEE = 8, 3.0
_NONE = math.nan


def published_multiplier(recording: Recording, cut: Cut, flutes: int) -> complex:
    """The largest empirical multiplier, imaginary part at least 0. ValueError for fewer than 8 periods in the cut."""
    start, stop = cut_bounds(recording, cut)
    period = passing_period(recording, cut.spindle_speed, flutes)
    samples = once_per_period_samples(recording, period, start, stop, DELAYS)[:PERIODS]
    if samples.shape[0] < 2 * DELAYS:
        raise ValueError(f"{samples.shape[0]} periods in the cut; at least {2 * DELAYS} are needed")
    singular = np.linalg.svd(np.diff(samples, axis=0), compute_uv=False)
    drops = singular[1:-1] / np.maximum(singular[2:], 1e-300)
    rank = 2 + int(np.argmax(drops)) if drops.max() > _KNEE else DELAYS
    largest = delay_embedding_multipliers(samples, rank)[0]
    return complex(largest.real, abs(largest.imag))


def identify_as_published(model: Model, tests: Sequence[tuple[Recording, Cut]]) -> Mapping[str, Estimate]:
    """Natural frequency (Hz), damping ratio and both cutting coefficients (N/m^2), from `model` as the start.

    Intervals are NaN. ValueError for fewer than two tests: each gives two numbers, and three are wanted.
    """
    if model.cutter is None or model.cutting is None:
        raise ValueError("the model has no cutter: multipliers need cuts")
    if len(tests) < 2:
        raise ValueError("one test gives two numbers for three parameters")
    flutes, cuts = model.cutter.flutes, [cut for _, cut in tests]
    measured = np.array([published_multiplier(recording, cut, flutes) for recording, cut in tests])
    names = ("natural_frequency", "damping_ratio", "tangential_coefficient")
    first = np.array([max(model.value(name), 1e-4) for name in names])
    ratio = model.cutting.normal_coefficient / model.cutting.tangential_coefficient

    def at(scaled: np.ndarray) -> Model:
        frequency, damping, coefficient = first * np.exp(scaled)
        return model.with_values({"natural_frequency": frequency, "damping_ratio": min(damping, 0.9),
                                  "tangential_coefficient": coefficient, "normal_coefficient": ratio * coefficient})

    def difference(scaled: np.ndarray) -> np.ndarray:
        here = at(scaled)
        largest = np.array([characteristic_multipliers(milling_equation(here, cut), _ELEMENTS)[0] for cut in cuts])
        error = largest.real + 1j * np.abs(largest.imag) - measured
        return np.concatenate([error.real, error.imag])

    lower, upper = np.log([0.8, 1e-3, 1e-2]), np.log([1.25, 0.9 / first[1], 1e2])
    fit = least_squares(difference, np.zeros(3), bounds=(lower, upper), x_scale=(1e-3, 0.2, 0.05), max_nfev=100)
    found = at(fit.x)
    units = {"natural_frequency": "Hz", "damping_ratio": "1", "tangential_coefficient": "N/m^2",
             "normal_coefficient": "N/m^2"}
    return {name: Estimate(found.value(name), _NONE, _NONE, unit) for name, unit in units.items()}
