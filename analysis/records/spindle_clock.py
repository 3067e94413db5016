"""The spindle's period and the place of its mark, from the times of a tachometer's marks."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import UnivariateSpline, make_interp_spline

STEADY_CLOCK = 2e-4  # scatter of the revolutions, relative, up to which the speed is taken as constant
ANOTHER = 1.9  # times the nominal speed, or as little of it, that no spindle runs at which is set to it
CLOSE = 0.25  # of a revolution, within which the time between two marks is a whole number of them
MARK_SHARE = 0.1  # of a sample: how well an edge between two samples is placed
HALFWAY = 0.1  # of a sample, within which the edges of a digital line lie halfway between two samples,
DIGITAL = 0.9  # share of them that do, and
DIGITAL_SHARE = 1.0 / math.sqrt(12.0)  # of a sample: how well such an edge is placed, which may have come at any time between


def clock_of(marks: np.ndarray, sample: float = 0.0) -> tuple[float, float, bool]:
    """(period of a revolution, time of the first mark by regression, whether the speed is constant).

    sample: duration of one (s) where the marks come from a digital line, whose edges scatter over it at a constant speed.
    """
    turns = turns_of(marks)
    slope, anchor = np.polyfit(turns, marks, 1)
    for _ in range(2):  # a lost or false mark must not move the clock
        rest = marks - anchor - slope * turns
        good = np.abs(rest) < max(4.0 * 1.4826 * float(np.median(np.abs(rest))), 1e-9)
        slope, anchor = np.polyfit(turns[good], marks[good], 1)
    rest = marks - anchor - slope * turns
    return float(slope), float(anchor), float(np.median(np.abs(rest))) < max(STEADY_CLOCK * slope, 0.5 * sample)


def check_speed(period: float, nominal: float) -> None:
    """ValueError where marks show a period (s) that is another by far than the nominal one: it is the record that is wrong."""
    if not 1.0 / ANOTHER < period / nominal < ANOTHER:
        raise ValueError(f"its tachometer shows {60 / period:.1f} rpm where {60 / nominal:.1f} rpm is written down "
                         "(sampling_rate, pulses_per_revolution, spindle_speed or the tachometer is wrong)")


def turns_of(marks: np.ndarray) -> np.ndarray:
    """Revolutions from the first mark to each of them; lost marks leave gaps, false ones fall on their neighbours."""
    gaps = np.diff(marks)
    usual = np.median(gaps)
    gaps = gaps / np.mean(gaps[np.abs(gaps - usual) < CLOSE * usual])
    whole = np.round(gaps)
    if (whole >= 1).all() and (np.abs(gaps - whole) < CLOSE).all():
        return np.concatenate([[0.0], np.cumsum(whole)])  # follows a speed that wanders
    return np.round(np.concatenate([[0.0], np.cumsum(gaps)]))


def digital(marks: np.ndarray, rate: float, start: float) -> bool:
    """Whether the marks (s) are edges of a digital line: all of them halfway between two samples (1 / rate, s, from start)."""
    between = (marks - start) * rate % 1.0
    return float(np.mean(np.abs(between - 0.5) < HALFWAY)) >= DIGITAL


def smoothed(marks: np.ndarray, sample: float) -> np.ndarray:
    """Marks (s) of a digital line at a varying speed, on the smoothest course (a cubic spline) within their scatter."""
    turns = turns_of(marks)
    if len(marks) < 5 or (np.diff(turns) <= 0).any():
        return marks
    course = UnivariateSpline(turns, marks, k=3, s=len(marks) * (DIGITAL_SHARE * sample) ** 2)
    return np.asarray(course(turns))


def along_marks(marks: np.ndarray, turn: np.ndarray, period: float) -> np.ndarray:
    """Times (s) at revolutions `turn` from the first mark, on a cubic spline through the marks; beyond them at `period` (s).

    Straight lines between them would be late by an eighth of what a revolution's duration changes by from one to the next.
    """
    turns = turns_of(marks)
    smooth = len(turns) > 3 and (np.diff(turns) > 0).all()  # false marks fall on their neighbours
    course = make_interp_spline(turns, marks, k=3) if smooth else lambda at: np.interp(at, turns, marks)
    inside = np.clip(turn, 0.0, turns[-1])
    return np.asarray(course(inside)) + (turn - inside) * period


def clock_error(marks: np.ndarray, period: float, anchor: float, rate: float, *, halfway: bool = False) -> tuple[float, float]:
    """Standard deviations of (angle at the first mark in rad, relative speed) that the marks leave.

    The scatter of the marks says how well their mean is known; what all marks of a record have in common (where the pulse
    crosses its threshold between two samples) it cannot say: a share of a sample (1 / rate, s) stands for that. Edges of a
    digital line (`halfway`) may err alike where a revolution is a whole number of samples, or drift by one over the record.
    """
    rest = (marks - anchor) / period
    rest = rest - np.round(rest)
    scatter = max(1.4826 * float(np.median(np.abs(rest))), 1e-7)
    edge = (DIGITAL_SHARE if halfway else MARK_SHARE) / (rate * period)
    share = math.hypot(2.0 * scatter / math.sqrt(len(marks)), edge)
    drifting = edge / len(marks) if halfway else 0.0
    return 2 * math.pi * share, math.hypot(math.sqrt(12.0) * scatter / len(marks) ** 1.5, drifting)
