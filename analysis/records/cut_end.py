"""The last revolutions of a cut in one channel: the lines that do not repeat with the spindle, and what is known of each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from analysis.records.hum import MAINS
from analysis.records.orders import PADDED, Turns, level_at, spectrum

STANDS, SIDE_STANDS = 5.0, 4.0  # times its surroundings: a line, a side band
LINES = 8  # that are looked at
SIDE_BANDS = 4  # to either side
ON_MAINS = 0.4, 5e-4  # bins, and of the frequency, within which a line is on a multiple of the mains
MOST_HUM = 20  # multiples of the mains
FOLDED, FOLDS, NEAR_THE_TOP = 2.0, 3, 0.6  # of the loudest order near the spectrum's top: a harmonic from above, folded


class Line(NamedTuple):
    """A line between the orders: its order, amplitude, height over its surroundings, and the halves' ratio of it."""

    order: float
    amplitude: float
    stands: float
    kept: float
    sides: int


@dataclass(frozen=True)
class CutEnd:
    """The last revolutions of a cut in one channel, and what is known of it.

    integrals: how often the channel is to be integrated for metres, None where it is no calibrated motion. idle: samples before
    the entry at `rate` (Hz). whole: all revolutions of the cut; sure: whether the speed is.
    """

    turns: Turns
    whole: Turns
    flutes: int
    idle: np.ndarray
    rate: float
    integrals: int | None
    feed: float
    is_force: bool
    sure: bool
    spectrum: tuple[np.ndarray, np.ndarray] = field(init=False)
    amplitudes: np.ndarray = field(init=False)
    still: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        rest = (self.turns.rows - self.turns.rows.mean(axis=0)).ravel()
        object.__setattr__(self, "spectrum", spectrum(rest))
        object.__setattr__(self, "amplitudes", self.turns.amplitudes())
        object.__setattr__(self, "still", spectrum(self.idle)[0] if len(self.idle) > 1 else np.empty(0))

    @property
    def count(self) -> int:
        """Revolutions looked at."""
        return len(self.turns.rows)

    def from_tooth_to_tooth(self, orders: np.ndarray) -> np.ndarray:
        """Factor (complex) from a line's amplitude to its motion's change from tooth to tooth over the feed; 1 in a force."""
        if self.integrals is None:
            return np.ones(np.shape(orders), complex)
        turning = 2j * math.pi * np.maximum(np.asarray(orders, float), 0.5 / self.count) / self.turns.period
        return (1.0 - np.exp(-2j * math.pi * np.asarray(orders) / self.flutes)) / turning**self.integrals / self.feed

    @property
    def measured(self) -> bool:
        """Whether a line can be measured against the feed."""
        return self.integrals is not None

    def before(self, order: float) -> float:
        """Amplitude that stood before the entry at an order's frequency; NaN where nothing was recorded then."""
        if len(self.idle) < 2 * self.turns.rows.shape[1]:
            return math.nan
        return level_at(self.still, order / self.turns.period * len(self.idle) * PADDED / self.rate, PADDED)

    def on_mains(self, order: float) -> bool:
        """Whether a line lies on a multiple of the mains."""
        hertz = order / self.turns.period
        near = ON_MAINS[0] / (self.count * self.turns.period) + ON_MAINS[1] * hertz
        return any(abs(hertz - base * min(max(1, round(hertz / base)), MOST_HUM)) < near for base in MAINS)

    def folded(self, line: Line) -> bool:
        """Whether a line may be a harmonic of the teeth from above half the sampling rate: a recorder without a filter.

        Then it is hardly louder than those just below.
        """
        if line.amplitude > FOLDED * float(self.amplitudes[round(NEAR_THE_TOP * len(self.amplitudes)) :].max()):
            return False
        sampled = self.rate * self.turns.period
        at = np.array([sign * line.order + fold * sampled for fold in range(1, FOLDS + 1) for sign in (-1.0, 1.0)])
        return bool((np.abs(at - np.round(at)) < 1.0 / self.count).any())

    def lines(self) -> list[Line]:
        """The lines of what does not repeat, loudest first; none that lies within a bin of an order."""
        lines, floor = self.spectrum
        size, bins = np.abs(lines), self.count * PADDED
        inner = size[1:-1]
        tops = np.flatnonzero((inner >= size[:-2]) & (inner > size[2:]) & (inner > STANDS * floor[1:-1])) + 1
        first, second = (self._about_mean(half) for half in self.turns.halves())
        found: list[Line] = []
        for top in tops[np.argsort(-size[tops])]:
            order = top / bins
            if order < 2.0 / self.count or self._on_order(order) or any(
                    abs(order - other.order) < 2.5 / self.count for other in found):
                continue
            ends = [level_at(half, order * self.count // 2 * PADDED, 1.5 * PADDED) for half in (first, second)]
            found.append(Line(order, float(size[top]), float(size[top] / floor[top]), ends[1] / max(ends[0], 1e-300),
                               self._sides(order)))
            if len(found) == LINES:
                break
        return found

    def _about_mean(self, half: Turns) -> np.ndarray:
        return spectrum((half.rows - self.turns.rows.mean(axis=0)).ravel())[0]

    def _on_order(self, order: float) -> bool:
        return abs(order - round(order)) < 1.0 / self.count

    def _sides(self, order: float) -> int:
        """How many side bands at the tooth passing a line has, none of which is an order or hum."""
        lines, floor = self.spectrum
        bins, count = self.count * PADDED, 0
        for step in (*range(-SIDE_BANDS, 0), *range(1, SIDE_BANDS + 1)):
            place = abs(order + step * self.flutes)
            if not 2.0 / self.count < place < (len(lines) - 1) / bins - 1.0 or self._on_order(place) or self.on_mains(place):
                continue
            count += level_at(lines, place * bins, PADDED / 2) > SIDE_STANDS * floor[round(place * bins)]
        return count
