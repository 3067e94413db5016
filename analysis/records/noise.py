"""How loud a sensor is by itself: from idling, else from repeated revolutions, else from what is no smooth motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from testbed.analysis.records.free_decay import FreeDecay, fit_free_decay, spectral_peak
from testbed.analysis.records.hum import MAINS
from testbed.analysis.records.periods import period_changes, revolutions
from testbed.analysis.records.segments import Segment, main_channel, revolution_period
from testbed.analysis.records.white_noise import read_white_noise, rounding, white_noise
from testbed.recording import Recording

PAIRED = 1.5  # samples that count as one: of changes between neighbours, which are correlated by -1/2
VIBRATIONS = 3  # that are taken out of idling
FEWEST_QUIET = 128  # samples of idling that are left when its loud beginning is taken away
EARLY = 2 / 3  # of idling, that no tooth has entered
TURNS = 3  # revolutions of idling that are enough,
ENOUGH = 0.06  # or seconds: three periods of the mains, whose hum is noise
LOUDER = 3.5  # standard errors of a ratio of two rms, by which that beginning is louder
SURE = 4.0  # standard errors: of a frequency, within which it may be that of the mains,
MAINS_DRIFT = 0.002  # which itself is so many parts off at the most
TRANSIENTS = 4  # directions in which revolutions may differ while a transient dies or grows: two free vibrations
LASTING = 0.01  # that a motion's size changes by in a revolution, at the least, to be a transient
RESTS = 4  # revolutions more than directions, without which they tell no noise
INTERPOLATED, LOUD = 32, 1.3  # samples a revolution, below which what interpolation leaves may be as loud as noise, or louder
ROUNDED = 0.5  # of what a vibration leaves, that rounding makes: what is left beyond the white part is then motion
FOURTH = 2.63  # of fourth differences: the sum of their squared autocorrelations, (70, -56, 28, -8, 1) / 70
Basis = Literal["idle", "ring-down", "repeated periods", "high-frequency residual", "upper bound"]


@dataclass(frozen=True)
class Noise:
    """rms of a channel's noise in the channel's unit, and what it was read from.

    doubt: standard error of the rms over the rms, as for white noise: over few samples it is a few per cent. An upper bound is
    no reading: the noise is not known, but cannot be louder.
    """

    rms: float
    basis: Basis
    channel: str
    doubt: float = 0.0

    @property
    def known(self) -> bool:
        """Whether the record tells its noise."""
        return self.basis != "upper bound"


def samples_of(recording: Recording, segment: Segment) -> slice:
    """The samples of a segment."""
    first = round((segment.start - recording.start) * recording.sampling_rate)
    last = round((segment.stop - recording.start) * recording.sampling_rate)
    return slice(max(0, first), min(len(recording), last))


def noise_floor(recording: Recording, segments: Sequence[Segment], channel: str | None = None) -> Noise:
    """Noise of a channel, its own unit.

    idle: rms about a straight line, a revolution at a time, so that drift does not count. ring-down: rms of what free
    vibrations leave of it, taken only where that is white. repeated periods: rms of the change from one revolution to the
    next over sqrt(2), median over steady cutting, taken only where the cut repeats itself (not in chatter); or of what a
    transient leaves that has not died yet, where that is white. high-frequency residual: fourth differences, which see white
    noise only. upper bound: the same where a motion as fast as the sampling may be all that they see. Never below the
    converter's rounding, of what was measured, nor above the record's own rms.
    """
    name = channel or main_channel(recording)
    values = np.asarray(recording.channels[name], dtype=float)
    found = _read(recording, segments, name, values)
    most, least = float(np.std(values)), rounding(np.delete(values, recording.filled))
    return replace(found, rms=max(min(found.rms, most), least))


def _read(recording: Recording, segments: Sequence[Segment], name: str, values: np.ndarray) -> Noise:
    """The noise as the first basis tells it that the record has."""
    period = revolution_period(recording)
    turn = (period or 64 / recording.sampling_rate) * recording.sampling_rate
    rate, enough = recording.sampling_rate, max(min(TURNS * turn, ENOUGH * recording.sampling_rate), 64) if period else 64
    parts = [(segment.kind, values[samples_of(recording, segment)]) for segment in segments]
    read = [one for kind, part in parts if kind == "idle" and len(part) > enough for one in _of_idling(part, rate, turn)]
    if read:
        rms, used = _quietest(read)
        return Noise(rms, "idle", name, _doubt(used))
    read = [one for kind, part in parts if kind == "ring-down" and len(part) > enough for one in _of_ringing(part, rate, turn)]
    if read:
        rms, used = _quietest(read)
        return Noise(rms, "ring-down", name, _doubt(used))
    longest = max((part for kind, part in parts if kind == "steady"), key=len, default=np.empty(0))
    white = read_white_noise(values)
    if period and len(longest) > 6 * turn:
        change, level = period_changes(longest, turn)
        read = _of_changes(change, turn)
        if _quietest(read)[0] < 0.25 * float(np.median(level)):
            rms, used = _quietest([*read, *_beside_transients(longest, turn)])
            if turn >= INTERPOLATED or rms < LOUD * white.rms or not white.known:
                return Noise(rms, "repeated periods", name, _doubt(used, PAIRED))
    return Noise(white.rms, "high-frequency residual" if white.known else "upper bound", name, _doubt(len(values), FOURTH))


def _of_idling(values: np.ndarray, rate: float, turn: float) -> list[tuple[float, int]]:
    """(rms of the noise in idling, the samples it is read from), in several ways, none of which tells too little.

    What still rings from before is motion: it is left in, waited for; free vibrations are fitted. The end is left out, too:
    amid ringing, the first tooth may have entered before it is seen.
    """
    margin = int(min(turn, len(values) / 8))
    quiet, read = values[margin : len(values) - margin], []
    rest, early = _died_away(quiet), quiet[: round(EARLY * len(quiet))]
    parts = [quiet, *([rest] if rest is not quiet else []), *([early] if len(early) >= FEWEST_QUIET else [])]
    for part in parts:
        rms = _about_lines(part, max(64, int(2 * turn)))
        read += [(rms, len(part)), (_beside_ringing(part, rate, rms), len(part))]
    return read


def _of_ringing(values: np.ndarray, rate: float, turn: float) -> list[tuple[float, int]]:
    """The same of a ring-down, whose beginning the last tooth may still shape; nothing where it is no free vibration."""
    margin = int(min(turn, len(values) / 8))
    parts = [values[margin:], values[round((1.0 - EARLY) * len(values)) :]]
    read = [(_beside_ringing(part, rate, math.inf), len(part)) for part in parts if len(part) >= FEWEST_QUIET]
    return [(rms, used) for rms, used in read if math.isfinite(rms)]


def _of_changes(change: np.ndarray, turn: float) -> list[tuple[float, int]]:
    """The same of what changes (rms) from one revolution to the next, of all and of later ones, when a transient has died."""
    counts = [count for count in (len(change), len(change) // 2, len(change) // 4) if count >= TURNS or count == len(change)]
    return [(float(np.median(change[-count:]) / math.sqrt(2.0)), round(count * turn)) for count in counts]


def _beside_transients(values: np.ndarray, turn: float) -> list[tuple[float, int]]:
    """The same of what a slow transient leaves of its revolutions, where that is white; nothing where there is none.

    A linear machine's revolutions differ from their mean in a few directions only, along which they shrink or grow. What keeps
    its size, hum or chatter, is left to the noise.
    """
    rows, gains = revolutions(values, turn)
    if rows.shape[1] <= TRANSIENTS + 1:  # so few samples a revolution that such directions take them all
        return []
    rows = rows - rows.mean(axis=1, keepdims=True)
    left, sizes, _ = np.linalg.svd(rows - rows.mean(axis=0), full_matrices=False)
    count, length = rows.shape
    most = min(count, length) - RESTS  # directions that leave enough to tell noise by
    freedom = np.array([(count - 1 - taken) * (length - taken) for taken in range(max(0, most))])
    power = np.cumsum(sizes[::-1] ** 2)[::-1][: len(freedom)]
    rest = np.sqrt(power / (freedom * gains.mean()))
    for taken in range(min(TRANSIENTS, len(rest) - 2) + 1):
        if rest[taken] <= (1.0 + LOUDER / math.sqrt(freedom[taken])) * rest[taken + 1]:  # no further direction
            white = rest[taken] <= 1.3 * white_noise(values)
            if not white or not taken:
                return []
            known = SURE * rest[taken] / sizes[taken - 1]
            changes = _least_change(left[:, :taken] * sizes[:taken]) > LASTING + known
            return [(float(rest[taken]), int(freedom[taken]))] if changes else []
    return []


def _least_change(places: np.ndarray) -> float:
    """Of the motions along places (revolutions, directions), the least change of a size in a revolution, over that size."""
    from_one = np.column_stack([places[:-1], np.ones(len(places) - 1)])  # about a mean that is not where they die to
    step = np.linalg.lstsq(from_one, places[1:], rcond=None)[0][:-1]
    return float(np.abs(np.abs(np.linalg.eigvals(step)) - 1.0).min())


def _quietest(read: Sequence[tuple[float, int]]) -> tuple[float, int]:
    """Of several readings that of most samples, unless one of fewer is quieter beyond chance; of as many, the quieter."""
    best, *others = sorted(read, key=lambda one: (-one[1], one[0]))
    for rms, samples in others:
        if rms * (1.0 + LOUDER / math.sqrt(samples)) < best[0]:
            best = rms, samples
    return best


def _died_away(values: np.ndarray) -> np.ndarray:
    """Idling without its beginning, as long as that is louder than the rest beyond chance: an old motion dies away there."""
    while len(values) >= 2 * FEWEST_QUIET:
        half = len(values) // 2
        first, rest = (_about_lines(part, FEWEST_QUIET) for part in (values[:half], values[half:]))
        if first <= (1.0 + LOUDER / math.sqrt(half)) * rest:
            break
        values = values[half:]
    return values


def _doubt(samples: int, lost: float = 1.0) -> float:
    """Standard error of an rms over itself, from white samples; `lost` of them count as one."""
    return math.sqrt(lost / (2.0 * max(samples, 1)))


def _beside_ringing(values: np.ndarray, rate: float, rms: float) -> float:
    """rms of what free vibrations, one after the other, leave of idling, where they leave only white noise; else `rms`.

    A structure that was pushed before the record still rings while idling, perhaps amid another vibration: that is motion, not
    noise. Hum stays.
    """
    step, rest, before = rounding(values), values, rms
    for _ in range(VIBRATIONS):
        fit = fit_free_decay(rest, 0, spectral_peak(rest))
        if fit is None or fit.rest > 0.98 * before or _is_hum(fit, rate, len(values)):
            return rms
        rest, before = rest - fit.at(np.arange(len(rest))), fit.rest
        white = max(white_noise(rest), step)
        if fit.rest <= 1.3 * white:
            return min(fit.rest, white) if step > ROUNDED * fit.rest else fit.rest
    return rms


def _is_hum(fit: FreeDecay, rate: float, samples: int) -> bool:
    """Whether a vibration is at a multiple of the mains, as closely as its frequency is known, and does not die."""
    frequency, known = fit.frequency * rate, SURE * fit.decay_error * rate / (2.0 * math.pi)  # as well as its decay
    near = min(1.5 * rate / samples, known + MAINS_DRIFT * frequency)
    mains = any(abs(frequency - base * round(frequency / base)) < near for base in MAINS)
    return mains and abs(fit.decay) * samples < 0.1


def _about_lines(values: np.ndarray, length: int) -> float:
    """Root of the mean square about straight lines of `length` samples, corrected for the two numbers of each line."""
    length = min(length, len(values))
    count = len(values) // length
    rows = values[: count * length].reshape(count, length)
    time = np.arange(length) - 0.5 * (length - 1)
    rows = rows - rows.mean(axis=1, keepdims=True)
    squares = (rows**2).sum(axis=1) - (rows @ time) ** 2 / (time @ time)
    return float(np.sqrt(np.maximum(squares, 0.0).mean() / max(1, length - 2)))
