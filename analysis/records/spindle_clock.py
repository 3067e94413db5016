"""The spindle's period and the place of its mark, from the times of a tachometer's marks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.interpolate import UnivariateSpline, make_interp_spline

STEADY_CLOCK = 2e-4  # scatter of the revolutions, relative, up to which the speed is taken as constant
ENOUGH = 16  # marks from which their scatter can be told from a speed that varies
CHANCE = 1e-3  # of a rhythm among marks that scatter, below which it is the speed's
WANDER = 3.0  # standard errors of the squared change from one mark to the next, by which it is another than that of scatter
HARMONICS = 2  # of a mark's place between two samples, by which an edge is placed too early or too late,
MOST_MOVED = 0.5  # samples at the most
ANOTHER = 1.9  # times the nominal speed, or as little of it, that no spindle runs at which is set to it
CLOSE = 0.25  # of a revolution, within which the time between two marks is a whole number of them
MARK_SHARE = 0.1  # of a sample: how well an edge between two samples is placed
SHARP, FILTERED = 2.0, 0.5  # samples that a sharp edge may take; how late another may be, as a share of what it takes more
FAINTEST = 1e-3  # of a sample: scatter of marks that is none
DIFFERENCES = (2, 3, 4, 5)  # orders of those by which a course is taken out of marks,
FEWEST = 4  # and how many more marks there are at the least
HALFWAY = 0.1  # of a sample, within which the edges of a digital line lie halfway between two samples,
DIGITAL = 0.9  # share of them that do, and
DIGITAL_SHARE = 1.0 / math.sqrt(12.0)  # of a sample: how well such an edge is placed, which may have come at any time between


def clock_of(marks: np.ndarray, sample: float = 0.0, rate: float = 0.0) -> tuple[float, float, bool]:
    """(period of a revolution, time of the first mark by regression, whether the speed is constant).

    sample: duration of one (s) where the marks come from a digital line, whose edges scatter over it at a constant speed.
    rate: samples/s of a line on which they were placed between samples, 0 where it is not known. Marks that scatter more are
    those of a constant speed where they do so without rhythm or wander, as at a noisy threshold, or at no other rhythm than
    that of the samples.
    """
    turns = turns_of(marks)
    period, anchor, rest = _regression(marks, turns)
    if sample > 0.0:
        return period, anchor, float(np.median(np.abs(rest))) < max(STEADY_CLOCK * period, 0.5 * sample)
    steady = _steady(rest, period)
    moved = _by_samples(marks, rest, rate) if not steady and rate > 0.0 and len(marks) >= ENOUGH else None
    if moved is not None:
        placed = _regression(marks - moved, turns)
        if _steady(placed[2], placed[0]):
            return placed[0], placed[1], True
    return period, anchor, steady


def _steady(rest: np.ndarray, period: float) -> bool:
    """Whether what marks stray (s, each) from those of a constant speed is little, or chance."""
    return float(np.median(np.abs(rest))) < STEADY_CLOCK * period or _only_scatter(rest)


def _regression(marks: np.ndarray, turns: np.ndarray) -> tuple[float, float, np.ndarray]:
    """(period, time of the first mark, what each mark strays from that), s, by all marks that are not lost or false."""
    slope, anchor = np.polyfit(turns, marks, 1)
    for _ in range(2):  # a lost or false mark must not move the clock
        rest = marks - anchor - slope * turns
        good = np.abs(rest) < max(4.0 * 1.4826 * float(np.median(np.abs(rest))), 1e-9)
        slope, anchor = np.polyfit(turns[good], marks[good], 1)
    return float(slope), float(anchor), marks - anchor - slope * turns


def _by_samples(marks: np.ndarray, rest: np.ndarray, rate: float) -> np.ndarray | None:
    """By how much marks were moved (s) by where between two samples they fell; None where that is more than an edge can be.

    An edge as short as a sample is no straight line between two of them: how early or late it is placed depends on that alone.
    """
    place = 2.0 * math.pi * marks * rate
    design = np.column_stack([np.ones(len(marks)), marks - marks[0], *(
        wave(order * place) for order in range(1, HARMONICS + 1) for wave in (np.cos, np.sin))])  # fmt: skip
    near = np.abs(rest) <= 4.0 * 1.4826 * float(np.median(np.abs(rest)))
    share = np.linalg.lstsq(design[near], rest[near], rcond=None)[0]
    moved = design[:, 2:] @ share[2:]
    return moved if float(np.max(np.abs(moved))) < MOST_MOVED / rate else None


def _only_scatter(rest: np.ndarray) -> bool:
    """Whether marks stray (s, each) from those of a constant speed by chance alone: each by itself, at no rhythm.

    A speed that varies shifts a mark by what it was at all revolutions before, so neighbours stray alike; or at a rhythm.
    """
    count = len(rest)
    if count < ENOUGH:
        return False
    limit = 4.0 * 1.4826 * float(np.median(np.abs(rest)))  # a lost or false mark must not hide the rest
    stray = np.clip(rest, -limit, limit)
    stray = stray - np.mean(stray)
    change = float(np.mean(np.diff(stray) ** 2)) / (2.0 * float(np.var(stray)) or 1.0)  # 1 where each strays by itself
    power = np.abs(np.fft.rfft(stray)[1 : (count + 1) // 2]) ** 2
    share = float(np.max(power)) / (float(np.sum(power)) or 1.0)
    chance = len(power) * (1.0 - share) ** (len(power) - 1)  # of so large a share, by Fisher's test
    return abs(change - 1.0) < WANDER / math.sqrt(count) and chance > CHANCE


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


def smoothed(marks: np.ndarray, sample: float, *, halfway: bool = True) -> np.ndarray:
    """Marks (s) at a varying speed, on the smoothest course (a cubic spline) within their scatter.

    sample: duration of one (s). Edges of a digital line (`halfway`) scatter over a share of it; others by what a smooth course
    leaves of them, and passes laid between marks that jitter would be of unequal duration. Where that is more than an edge can
    be off, the course is none so smooth, and the marks stay.
    """
    turns = turns_of(marks)
    if len(marks) < 5 or (np.diff(turns) <= 0).any():
        return marks
    scatter = DIGITAL_SHARE * sample if halfway else _jitter(marks, turns)
    if not halfway and not FAINTEST < scatter / sample < MARK_SHARE:
        return marks
    course = UnivariateSpline(turns, marks, k=3, s=len(marks) * scatter**2)
    return np.asarray(course(turns))


def _jitter(marks: np.ndarray, turns: np.ndarray) -> float:
    """Scatter of marks (s) about a smooth course, by differences of the order that leaves least; 0 where marks are lost."""
    if (np.diff(turns) != 1.0).any():
        return 0.0
    orders = [order for order in DIFFERENCES if len(marks) > order + FEWEST]
    return min((float(np.std(np.diff(marks, order))) / math.sqrt(math.comb(2 * order, order)) for order in orders), default=0.0)


def along_marks(marks: np.ndarray, turn: np.ndarray, period: float) -> np.ndarray:
    """Times (s) at revolutions `turn` from the first mark, on a cubic spline through the marks; beyond them at `period` (s).

    Straight lines between them would be late by an eighth of what a revolution's duration changes by from one to the next.
    """
    turns = turns_of(marks)
    smooth = len(turns) > 3 and (np.diff(turns) > 0).all()  # false marks fall on their neighbours
    course = make_interp_spline(turns, marks, k=3) if smooth else lambda at: np.interp(at, turns, marks)
    inside = np.clip(turn, 0.0, turns[-1])
    return np.asarray(course(inside)) + (turn - inside) * period


def samples_to_rise(recording: Any) -> float:
    """How many samples an edge of a recording's tachometer takes, by how steep it is at its marks; 1 where no line is kept."""
    line, marks = recording.channels.get("tachometer"), np.asarray(recording.marks)
    if line is None or len(marks) == 0:
        return 1.0
    below = np.clip(np.floor((marks - recording.start) * recording.sampling_rate).astype(int), 0, len(line) - 2)
    low, high = np.quantile(line, [0.002, 0.998])
    step = float(np.median(np.abs(line[below + 1] - line[below])))
    return max(1.0, float(high - low) / step) if step > 0.0 else 1.0


def clock_error(marks: np.ndarray, period: float, anchor: float, rate: float, *, halfway: bool = False,
                rise: float = 1.0) -> tuple[float, float]:  # fmt: skip
    """Standard deviations of (angle at the first mark in rad, relative speed) that the marks leave.

    The scatter of the marks says how well their mean is known; what all marks of a record have in common (where the pulse
    crosses its threshold between two samples) it cannot say: a share of a sample (1 / rate, s) stands for that. Edges of a
    digital line (`halfway`) may err alike where a revolution is a whole number of samples, or drift by one over the record.
    An edge that takes more than two samples to `rise` has been through a filter, which makes it late by about half of that.
    """
    rest = (marks - anchor) / period
    rest = rest - np.round(rest)
    scatter = max(1.4826 * float(np.median(np.abs(rest))), 1e-7)
    edge = (DIGITAL_SHARE if halfway else max(MARK_SHARE, FILTERED * (rise - SHARP))) / (rate * period)
    share = math.hypot(2.0 * scatter / math.sqrt(len(marks)), edge)
    drifting = edge / len(marks) if halfway else 0.0
    return 2 * math.pi * share, math.hypot(math.sqrt(12.0) * scatter / len(marks) ** 1.5, drifting)
