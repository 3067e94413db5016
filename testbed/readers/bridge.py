"""Samples that a sensor of motion did not measure, though the file has a number there: seen, and bridged.

A lone wrong sample weighs in a fit as much as all the noise of a second. A motion goes on smoothly through all of these, as a
force or an acceleration need not: theirs are left as they are.
"""

from __future__ import annotations

import numpy as np

from testbed.readers import checks
from testbed.readers.source import base_name
from testbed.readers.spikes import most_spikes, quantum, spikes

MOTIONS = ("displacement", "velocity")
DROPOUT = 16  # samples at the most for which a signal is somewhere else
STEP = 0.3  # of the usual step from sample to sample, that leads into a stretch that stands still or out of it
MOST_STILL = 0.05  # of a record that may stand still; beyond that the record is at fault


def unmeasured(name: str, values: np.ndarray, full_scale: float | None = None) -> np.ndarray:
    """Which samples of a channel (samples,) are not the motion's, bool: lone spikes, dropouts, a stretch that stands still."""
    wrong = np.zeros(len(values), dtype=bool)
    if base_name(name) not in MOTIONS:
        return wrong
    lone = spikes(values)
    if len(lone) <= most_spikes(len(values)):
        wrong[lone] = True
    for first, stop in _dropouts(values):
        wrong[first:stop] = True
    still = checks.stuck_stretch(values)
    if still and not checks.clipped(values, full_scale) and _let_go(values, *still):
        wrong[still[0] : still[0] + still[1]] = True
    return wrong


def bridged(values: np.ndarray, wrong: np.ndarray) -> np.ndarray:
    """The values with a smooth curve of four neighbours through lone wrong samples, and a straight line through more."""
    if not wrong.any():
        return values
    kept = np.flatnonzero(~wrong)
    mended = values.copy()
    mended[wrong] = np.interp(np.flatnonzero(wrong), kept, values[kept])
    alone = np.flatnonzero(wrong)
    alone = alone[(alone >= 2) & (alone < len(values) - 2)]
    alone = alone[~(wrong[alone - 2] | wrong[alone - 1] | wrong[alone + 1] | wrong[alone + 2])]
    mended[alone] = (4 * (values[alone - 1] + values[alone + 1]) - values[alone - 2] - values[alone + 2]) / 6
    return mended


def _dropouts(values: np.ndarray) -> list[tuple[int, int]]:
    """(first, stop) of stretches to which the signal jumps and from which it jumps back to where it was."""
    found, places = [], checks.jumps(values)
    usual = float(np.median(np.abs(np.diff(values)))) if len(values) > 1 else 0.0
    for first, stop in zip(places[:-1], places[1:], strict=True):
        away = min(abs(values[first] - values[first - 1]), abs(values[stop] - values[stop - 1]))
        if stop - first <= DROPOUT and abs(values[stop] - values[first - 1]) < min(0.25 * away, 4 * usual * (stop - first + 1)):
            found.append((first, stop))
    return found


def _let_go(values: np.ndarray, first: int, length: int) -> bool:
    """Whether a stretch of equal samples is the sensor's: the motion, which comes to rest and leaves it smoothly, went on."""
    stop = first + length
    if length > MOST_STILL * len(values) or first == 0 or stop >= len(values):
        return False
    steps = np.abs(np.diff(values))
    usual = float(np.median(steps[steps > 0]))
    smooth = max(STEP * usual, 1.5 * quantum(values))  # one step of a coarse converter is no jump
    return max(float(steps[first - 1]), float(steps[stop - 1])) > smooth
