"""One measured receptance: its lines, which of them may be believed, how uncertain they are, and which way it points."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d

from testbed.machine import Carrier

_NEIGHBOURS = 3  # lines to either side that foretell one by a cubic
_QUIET = 40  # lines to either side, of which the median scatter is the noise: peaks are few among them
_BELIEVED = 0.9  # least coherence of a line and its neighbours, or share of what is no noise
_SMOOTH = 9  # lines that a coherence is averaged over
_SHORTEST = 6  # lines that stand together
FEWEST_LINES = 24  # of a band that holds a mode
_HALVES = 0.5  # of one octave to the next: drift falls to a quarter, the answer of a stiffness stays
_STEP = 2.0 ** (1.0 / 3.0)
_FALLS = 10.0  # times: less from 0 Hz on is no drift


@dataclass(frozen=True)
class FrequencyResponse:
    """Receptance over frequency: `receptance` (lines,) in m/N at `frequency` (Hz, even steps).

    along, sensed: unit vectors (x, y) of force and sensor. deviations: (blows, lines), what each blow adds to the mean; their
    sum is 0; no row where there were no blows. coherence: (lines,), None where the data have none. driven: lines at which
    the force had power. decay: 1/s, of an exponential window on force and response; the receptance is at s = i omega + decay.
    floor: (lines,), m/N, what the sensors' white noise makes of each line, None where there is no record.
    """

    name: str
    frequency: np.ndarray
    receptance: np.ndarray
    along: tuple[float, float]
    sensed: tuple[float, float]
    on: Carrier
    deviations: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    coherence: np.ndarray | None = None
    driven: np.ndarray | None = None
    decay: float = 0.0
    floor: np.ndarray | None = None

    @property
    def laplace(self) -> np.ndarray:
        """s of each line, 1/s."""
        return 2j * np.pi * self.frequency + self.decay

    @property
    def drive_point(self) -> bool:
        """Whether force and sensor point along one line, so that every mode answers with the force."""
        return abs(abs(np.dot(self.along, self.sensed)) - 1.0) < 1e-9

    def turned(self) -> FrequencyResponse:
        """The response of the same sensor, turned round."""
        return replace(self, receptance=-self.receptance, deviations=-self.deviations)

    def scaled(self, factor: float) -> FrequencyResponse:
        """The response times a factor above 0."""
        return replace(self, receptance=self.receptance * factor, deviations=self.deviations * factor,
                       floor=None if self.floor is None else self.floor * factor)

    @cached_property
    def noise(self) -> np.ndarray:
        """Standard deviation (lines,), m/N, of a line about what its neighbours foretell, at least the sensors' own."""
        weight = np.maximum(np.abs(self.laplace) ** 2, 1e-300)  # the noise of an acceleration is even
        flat = self.receptance * weight
        places = np.arange(-_NEIGHBOURS, _NEIGHBOURS + 1)
        others = places[places != 0]
        share = np.linalg.lstsq(np.vander(others, 4).T, np.array([0.0, 0.0, 0.0, 1.0]), rcond=None)[0]
        kernel = np.zeros(len(places))
        kernel[places != 0] = -share
        kernel[_NEIGHBOURS] = 1.0
        scatter = np.abs(np.convolve(flat, kernel[::-1], mode="same")) ** 2 / float(kernel @ kernel)
        middle = median_filter(scatter, 2 * min(_QUIET, len(flat) // 4) + 1, mode="nearest") / np.log(2.0)
        found = np.sqrt(middle) / weight
        return found if self.floor is None else np.maximum(found, self.floor)

    @cached_property
    def lowest(self) -> float:
        """Where a sensor's drift, or a body that is free to move, ends: Hz, 0 where the response does not fall from 0 Hz on.

        A structure that is held answers a slow force by its stiffness. Integrated twice, the drift of an accelerometer rises as
        the inverse square of the frequency instead, and hides all modes from a fit.
        """
        lines = np.flatnonzero((self.frequency > 0.0) & np.isfinite(self.receptance))
        if len(lines) < FEWEST_LINES:
            return 0.0
        frequency, size = self.frequency[lines], np.abs(self.receptance[lines])

        def octave(first: float) -> float:
            inside = (frequency >= first) & (frequency < 2.0 * first)
            return float(np.median(size[inside])) if inside.any() else math.inf

        low = float(frequency[0])
        while octave(2.0 * low) < _HALVES * octave(low):
            low *= _STEP
        return low if octave(low) < octave(float(frequency[0])) / _FALLS else 0.0

    def from_lowest(self) -> FrequencyResponse:
        """The response with the lines below `lowest` taken for not driven."""
        driven = np.ones(len(self.frequency), dtype=bool) if self.driven is None else self.driven
        return replace(self, driven=driven & (self.frequency >= self.lowest))

    def believed(self, low: float, high: float) -> np.ndarray:
        """Which lines (lines,) between low and high (Hz) a fit may use: force, coherence, more than noise."""
        inside = (self.frequency >= low) & (self.frequency <= high) & np.isfinite(self.receptance)
        if self.driven is not None:
            inside &= self.driven
        power = uniform_filter1d(np.abs(self.receptance * self.frequency**2) ** 2, _SMOOTH, mode="nearest")
        noise = uniform_filter1d((self.noise * self.frequency**2) ** 2, _SMOOTH, mode="nearest")
        share = 1.0 - noise / np.maximum(power, 1e-300)
        if self.coherence is not None:
            share = np.minimum(share, maximum_filter1d(uniform_filter1d(self.coherence, _SMOOTH, mode="nearest"), _SMOOTH))
        return _runs(inside & (share > _BELIEVED))


def axis_of(vector: tuple[float, float]) -> tuple[float, float]:
    """A direction without its sign."""
    x, y = vector
    return (abs(x), abs(y)) if abs(x) < 1e-12 or abs(y) < 1e-12 else (x, y) if x > 0 else (-x, -y)


def _runs(good: np.ndarray) -> np.ndarray:
    """The good lines (lines,), bool, without those that stand all but alone."""
    lines = np.flatnonzero(good)
    found = np.zeros(len(good), dtype=bool)
    for run in np.split(lines, np.flatnonzero(np.diff(lines) > 2) + 1):
        found[run] = len(run) >= _SHORTEST
    return found
