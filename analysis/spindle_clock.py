"""The spindle's period and the place of its mark, from the times of a tachometer's marks."""

from __future__ import annotations

import math

import numpy as np

STEADY_CLOCK = 2e-4  # scatter of the revolutions, relative, up to which the speed is taken as constant
MARK_SHARE = 0.1  # of a sample: how well an edge between two samples is placed


def clock_of(marks: np.ndarray) -> tuple[float, float, bool]:
    """(period of a revolution, time of the first mark by regression, whether the speed is constant)."""
    turns = np.round((marks - marks[0]) / np.median(np.diff(marks)))
    slope, anchor = np.polyfit(turns, marks, 1)
    for _ in range(2):  # a lost or false mark must not move the clock
        rest = marks - anchor - slope * turns
        good = np.abs(rest) < max(4.0 * 1.4826 * float(np.median(np.abs(rest))), 1e-9)
        slope, anchor = np.polyfit(turns[good], marks[good], 1)
    rest = marks - anchor - slope * turns
    return float(slope), float(anchor), float(np.median(np.abs(rest))) < STEADY_CLOCK * slope


def clock_error(marks: np.ndarray, period: float, anchor: float, rate: float) -> tuple[float, float]:
    """Standard deviations of (angle at the first mark in rad, relative speed) that the marks leave.

    The scatter of the marks says how well their mean is known; what all marks of a record have in common (where the pulse
    crosses its threshold between two samples) it cannot say: a share of a sample (1 / rate, s) stands for that.
    """
    rest = (marks - anchor) / period
    rest = rest - np.round(rest)
    scatter = max(1.4826 * float(np.median(np.abs(rest))), 1e-7)
    share = math.hypot(2.0 * scatter / math.sqrt(len(marks)), MARK_SHARE / (rate * period))
    return 2 * math.pi * share, math.sqrt(12.0) * scatter / len(marks) ** 1.5
