"""The spindle speed of a cut without a tachometer, from all harmonics of the tooth passing at once.

A fit to a hundred tooth passes needs the speed to a part of one pass; a log book says it to a per cent. No line is picked: of
every speed near the stated one, how far the spectrum stands above its surroundings is summed, as a logarithm, over the
harmonics. So many faint lines tell as much as a loud one, and a loud one that is no harmonic (chatter, hum) does not decide.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.records.hum import MAINS
from testbed.analysis.records.lines import amplitude_spectrum, comb_speed

REACH = 0.03  # of the stated speed, that is searched about it
LEAST = 256  # samples whose lines are looked at one by one
HARMONICS = 4, 60  # fewest and most that are looked at
NYQUIST = 0.45  # of the sampling rate: highest harmonic
FEWEST = 4.0  # passes
PADDED = 8  # times the record's length: the spectrum's points
BETWEEN = 0.1  # of what the highest harmonic resolves: step of the search
FLOOR = 50  # resolved frequencies to either side, whose median is what a line stands above
FAR_REACH = 0.045  # of it, where a cut may chatter: further than a log book errs
SIDES, SIDE_HARMONICS = 12, 40  # side bands to either side, and harmonics beside them
SURE = 6.0  # standard deviations of the sum at frequencies that are no harmonics, by which it must stand out
SURE_OF_TURNS = 12.0  # the same of the spindle's own orders, of which more lie near any line


def heard_speed(values: np.ndarray, rate: float, stated: float, flutes: int, idle: np.ndarray | None = None) -> float | None:
    """Spindle speed (rad/s) of a steady cut, also where the `stated` one is another by far, if single lines show that surely.

    idle: samples of idling, whose lines are not the cut's. None where the harmonics do not stand out.
    """
    lines = comb_speed(values, rate, stated, flutes, idle=idle) if len(values) >= LEAST else None
    if lines is not None and abs(lines.spindle_speed / stated - 1.0) > REACH:
        stated = lines.spindle_speed
    return passing_speed(values, rate, stated, flutes)


def passing_speed(values: np.ndarray, rate: float, stated: float, flutes: int) -> float | None:
    """Spindle speed (rad/s) near the `stated` one, from samples of a steady cut; None where its harmonics do not stand out."""
    passing = stated * flutes / (2.0 * math.pi)
    if len(values) * passing < FEWEST * rate:
        return None
    heights, step = _heights(np.asarray(values, dtype=float), rate)
    least, most = HARMONICS
    orders = np.arange(1, max(least, min(most, int(NYQUIST * rate / passing))) + 1)
    reach = REACH * passing
    trials = np.arange(passing - reach, passing + reach, BETWEEN * rate / len(values) / len(orders))
    places = np.minimum(trials[:, None] * orders / step, len(heights) - 2.0)
    below = places.astype(int)
    sums = np.sum(heights[below] + (places - below) * (heights[below + 1] - heights[below]), axis=1)
    best = int(np.argmax(sums))
    by_chance = len(orders) * heights.mean() + SURE * math.sqrt(len(orders)) * heights.std()
    return float(trials[best]) * 2.0 * math.pi / flutes if sums[best] > by_chance else None


def _heights(values: np.ndarray, rate: float) -> tuple[np.ndarray, float]:
    """Logarithm of the spectrum's power above its surroundings, and the distance of its points (Hz)."""
    from scipy.ndimage import median_filter

    frequencies, spectrum = amplitude_spectrum(values, rate, PADDED)
    width = min(len(spectrum) // 4 * 2 + 1, 2 * FLOOR * PADDED + 1)
    floor = median_filter(spectrum, size=width, mode="mirror")
    return np.log1p((spectrum / (2.0 * np.maximum(floor, 1e-300))) ** 2), float(frequencies[1])


def cut_speeds(values: np.ndarray, rate: float, stated: float, flutes: int,
               idle: np.ndarray | None = None) -> tuple[tuple[float, ...], bool]:  # fmt: skip
    """Spindle speeds (rad/s) that a cut which may chatter can have run at, likeliest first, and whether the first is sure.

    As `heard_speed`; where that finds none near the stated one, the side bands of the loudest line that is no multiple of the
    mains count as much as the harmonics, the spindle's own orders are tried beside those of the teeth, and what was heard
    elsewhere is another speed to try.
    """
    heard = heard_speed(values, rate, stated, flutes, idle)
    if heard is not None and abs(heard / stated - 1.0) < FAR_REACH:
        return (heard,), True
    heights, step = _heights(np.asarray(values, dtype=float), rate)
    loudest, resolved = _loudest(values, rate), rate / len(values)
    passing = stated * flutes / (2.0 * math.pi)
    stands, hertz = _comb(heights, step, passing, resolved, rate, loudest)
    turning = _comb(heights, step, passing / flutes, resolved, rate, loudest) if flutes > 1 else (0.0, 0.0)
    if turning[0] > max(stands, SURE_OF_TURNS):  # runout shows where the teeth themselves are faint
        stands, hertz = turning[0], turning[1] * flutes
    near, sure = hertz * 2.0 * math.pi / flutes, stands > SURE
    return ((near,), sure) if sure or heard is None else ((heard, near), False)


def _comb(heights: np.ndarray, step: float, spacing: float, resolved: float, rate: float,
          loudest: float) -> tuple[float, float]:  # fmt: skip
    """(by how many standard deviations it stands out, spacing in Hz) of the comb near a `spacing` that carries most."""
    orders = np.arange(1, max(HARMONICS[0], min(SIDE_HARMONICS, int(NYQUIST * rate / spacing))) + 1)
    trials = np.arange(spacing * (1.0 - FAR_REACH), spacing * (1.0 + FAR_REACH), BETWEEN * resolved / len(orders))
    sides = np.concatenate([np.arange(-SIDES, 0), np.arange(1, SIDES + 1)])
    places = np.abs(np.column_stack([trials[:, None] * orders, loudest + trials[:, None] * sides]))
    inside = (places > 3.0 * resolved) & (places < NYQUIST * rate)
    at = np.minimum(places / step, len(heights) - 2.0)
    below = at.astype(int)
    sums = np.where(inside, heights[below] + (at - below) * (heights[below + 1] - heights[below]), 0.0).sum(axis=1)
    best, count = int(np.argmax(sums)), places.shape[1]
    return float((sums[best] - count * heights.mean()) / (math.sqrt(count) * heights.std())), float(trials[best])


def _loudest(values: np.ndarray, rate: float) -> float:
    """Frequency (Hz) of the loudest line that is no multiple of the mains."""
    frequencies, spectrum = amplitude_spectrum(values, rate, PADDED)
    resolved = rate / len(values)
    hum = [np.abs(frequencies - base * np.maximum(np.round(frequencies / base), 1.0)) < resolved for base in MAINS]
    return float(frequencies[np.argmax(np.where(np.any(hum, axis=0) | (frequencies < 3.0 * resolved), 0.0, spectrum))])
