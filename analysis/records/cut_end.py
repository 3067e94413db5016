"""The last revolutions of a cut in one channel: the lines that do not repeat with the spindle, and what is known of each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from testbed.analysis.records.hum import MAINS
from testbed.analysis.records.lines import side_lobe
from testbed.analysis.records.orders import PADDED, Turns, level_at, spectrum

STANDS, SIDE_STANDS = 5.0, 4.0  # times its surroundings: a line, a side band
LINES = 8  # that are looked at
SIDE_BANDS, SURE_SIDES = 4, 4  # to either side; of both, that none but the cut's own line has
BESIDE = 2.5  # bins from an order of the spindle, within which a line may be but that order's change
NOISE_BEFORE = 3.0  # times the floor of the idling's spectrum, up to which a level there is noise's
BEFORE = 0.4  # of a line, that stands before the entry where it is none of the cut's
ON_MAINS = 1e-3  # of the frequency, within which a line is on a multiple of the mains: so much do they err
PLACED = 0.15, 0.5  # bins: how well a line's place is known among others, and in noise as high as the line
WAVES = 4.0  # of a line, in the idling or at the cut's end, without which nothing is told of it there
MOST_HUM = 20  # multiples of the mains
FAMILY, FAMILY_BINS = 3, 1.5  # multiples of a line whose side bands belong to it, and how far they may lie from their places
FOLDED, FOLDS, NEAR_THE_TOP = 2.0, 3, 0.6  # of the loudest order near the spectrum's top: a harmonic from above, folded


class Line(NamedTuple):
    """A line between the orders: its order, amplitude, height over its surroundings, how much is kept of it from the first half
    to the second, and from the time before to the first, its side bands, and whether it lies on a multiple of the mains."""

    order: float
    amplitude: float
    stands: float
    kept: float
    kept_before: float
    sides: int
    on_mains: bool


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
        object.__setattr__(self, "still", self._still())

    def _still(self) -> np.ndarray:
        """Spectrum of the idling; empty where too little was recorded, or the teeth cut there already."""
        if len(self.idle) < 2 * self.turns.rows.shape[1]:
            return np.empty(0)
        lines, floor = spectrum(self.idle)
        teeth = np.arange(self.flutes, len(self.amplitudes), self.flutes)
        loudest = float(teeth[np.argmax(self.amplitudes[teeth])]) if len(teeth) else 0.0
        place = loudest / self.turns.period * len(self.idle) * PADDED / self.rate
        level = level_at(lines, place, PADDED)
        cuts = level > STANDS * floor[min(round(place), len(floor) - 1)] and level > BEFORE * self.amplitudes[round(loudest)]
        return np.empty(0) if cuts and not self.on_mains(loudest) else lines

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
    def unmeasured(self) -> bool:
        """Whether a motion cannot be measured against the feed."""
        return self.integrals is None and not self.is_force

    @property
    def measured(self) -> bool:
        """Whether a line can be measured against the feed."""
        return self.integrals is not None

    def before(self, order: float) -> float:
        """Amplitude that stood before the entry at an order's frequency; NaN where too little idling was recorded then."""
        waves = order / self.turns.period * len(self.idle) / self.rate
        return level_at(self.still, waves * PADDED, PADDED) if len(self.still) and waves >= WAVES else math.nan

    def line_before(self, line: Line) -> float:
        """The same of a line, over its amplitude; 0 where it was but noise: hum is on the mains, and counts at any height."""
        level = self.before(line.order)
        noise = not line.on_mains and level < NOISE_BEFORE * float(self.still_floor(np.array([line.order]))[0])
        return 0.0 if noise else level / line.amplitude

    def still_floor(self, orders: np.ndarray) -> np.ndarray:
        """The floor of the idling's spectrum at these orders; nothing where none was recorded."""
        if not len(self.still):
            return np.zeros(len(orders))
        floor = self._idle_floor
        return np.interp(orders / self.turns.period * len(self.idle) * PADDED / self.rate, np.arange(len(floor)), floor)

    @cached_property
    def _idle_floor(self) -> np.ndarray:
        return spectrum(self.idle)[1]

    def beside_order(self, order: float) -> bool:
        """Whether a line lies as near to an order of the spindle as that order's own change may spread."""
        return abs(order - round(order)) < BESIDE / self.count

    def of_an_order(self, line: Line) -> bool:
        """Whether a line may be but an order of the spindle that changes its size: beside it, no louder, or with few sides."""
        own = float(self.amplitudes[round(line.order) :][:1].max(initial=0.0))
        return self.beside_order(line.order) and (line.amplitude < own or line.sides < SURE_SIDES)

    def on_mains(self, order: float, bins: float = 1.0) -> bool:
        """Whether an order lies on a multiple of the mains; bins: how well its place is known."""
        hertz = order / self.turns.period
        near = bins / (self.count * self.turns.period) + ON_MAINS * hertz
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

    def family(self, order: float) -> float:
        """Share of what does not repeat that a line makes with its multiples and their side bands at the tooth passing."""
        lines, floor = self.spectrum
        orders = np.arange(len(lines)) / (self.count * PADDED)
        power = np.where((np.abs(lines) > STANDS * floor) & (orders > 2.0 / self.count), np.abs(lines) ** 2, 0.0)
        near = np.zeros(len(orders), bool)
        for place in (sign * multiple * order for multiple in range(1, FAMILY + 1) for sign in (-1.0, 1.0)):
            away = orders - place
            near |= np.abs(away - np.round(away / self.flutes) * self.flutes) < FAMILY_BINS / self.count
        own = float(power[near].sum())
        others = sum(float(power[at]) for at in np.flatnonzero(power * ~near) if not self.on_mains(float(orders[at])))
        return own / max(own + others, 1e-300)

    def lines(self) -> list[Line]:
        """The lines of what does not repeat, loudest first; none that lies within a bin of an order."""
        lines, floor = self.spectrum
        size, bins = np.abs(lines), self.count * PADDED
        inner = size[1:-1]
        tops = np.flatnonzero((inner >= size[:-2]) & (inner > size[2:]) & (inner > STANDS * floor[1:-1])) + 1
        half, rows = self.count // 2, self.whole.rows
        parts = [self._about_mean(rows[max(len(rows) - back, 0) : len(rows) - back + half]) for back in (2 * half, half)]
        earlier = rows[max(len(rows) - 3 * half, 0) : len(rows) - 2 * half]
        if len(earlier) == half:
            parts.insert(0, self._about_mean(earlier))
        found: list[Line] = []
        for top in tops[np.argsort(-size[tops])]:
            left, here, right = size[top - 1 : top + 2]
            order = (top + 0.5 * (left - right) / (left - 2.0 * here + right)) / bins
            if order < WAVES / self.count or self._on_order(order) or any(
                    side_lobe(abs(order - other.order) * self.count, here / other.amplitude) for other in found):
                continue
            *before, first, last = (max(level_at(part, order * half * PADDED, 1.5 * PADDED), 1e-300) for part in parts)
            stands = float(here / floor[top])
            found.append(Line(order, float(here), stands, last / first, first / before[0] if before else 0.0, 0,
                              self.on_mains(order, max(PLACED[0], PLACED[1] / stands))))
            if len(found) == LINES:
                break
        return [line._replace(sides=self._sides(line.order, found)) for line in found]

    def _about_mean(self, rows: np.ndarray) -> np.ndarray:
        return spectrum((rows - self.turns.rows.mean(axis=0)).ravel())[0]

    def _on_order(self, order: float) -> bool:
        return abs(order - round(order)) < 1.0 / self.count

    def _sides(self, order: float, found: Sequence[Line]) -> int:
        """How many side bands at the tooth passing a line has: none is an order, hum, or a side lobe of a line found."""
        lines, floor = self.spectrum
        bins, count = self.count * PADDED, 0
        for step in (*range(-SIDE_BANDS, 0), *range(1, SIDE_BANDS + 1)):
            place = abs(order + step * self.flutes)
            if not 2.0 / self.count < place < (len(lines) - 1) / bins - 1.0 or self._on_order(place) or self.on_mains(place):
                continue
            level = level_at(lines, place * bins, PADDED / 2)
            away = [(abs(place - other.order) * self.count, level / other.amplitude) for other in found]
            lobe = any(off > 1.0 and side_lobe(off, ratio) for off, ratio in away)
            count += not lobe and level > SIDE_STANDS * floor[round(place * bins)]
        return count
