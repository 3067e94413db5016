"""Lines in a record's spectrum told apart: mains hum, spindle and tooth passing, the structure's own, and the rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from testbed.analysis.records.hum import MAINS

LineKind = Literal["hum", "spindle", "tooth-passing", "half tooth-passing", "natural", "chatter", "other"]
_HARMONICS_OF_HUM = 40
FARTHEST = 0.6, 1.7  # of the nominal speed: between one half and twice it, which explain the lines of it as well
CLEARLY = 1.25  # times the score, by which a spacing far from the nominal one must explain more
FAR_LINES, FAR_SHARE = 6, 0.6  # lines, and share of their amplitude, that such a one explains where it is told
MOST_LINES = 40
ALONE = 4.0  # times its surroundings that a line stands at the least
BY_CHANCE = 0.1  # lines in a record of white noise; a padded spectrum has about as many peaks as the record has samples
ANY_LENGTH = 1 << 20  # points up to which a transform has any length: one with a large prime factor takes twenty times its size
FINE = 0.1  # of the spindle frequency: width of a line up to which half orders are told from what lies between them


@dataclass(frozen=True)
class SpectralLine:
    """A line: frequency (Hz), amplitude (the channel's unit), what it is, and its order of the base it belongs to."""

    frequency: float
    amplitude: float
    kind: LineKind
    order: int = 0


@dataclass(frozen=True)
class CombSpeed:
    """A spindle speed (rad/s) from the spacing of spectral lines, and why."""

    spindle_speed: float
    basis: Literal["tooth-passing lines", "side bands"]


def amplitude_spectrum(values: np.ndarray, rate: float, padded: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (Hz) and amplitudes of a Hann-windowed record without its straight line, `padded` times as long or more."""
    from scipy.fft import next_fast_len

    time = np.linspace(-1, 1, len(values))
    flat = values - np.polynomial.Polynomial.fit(time, values, 1)(time)
    window = np.hanning(len(values))
    flat *= window
    size = padded * len(values)
    size = size if size <= ANY_LENGTH else next_fast_len(size, real=True)
    amplitude = np.abs(np.fft.rfft(flat, size))
    amplitude *= 2 / window.sum()
    return np.fft.rfftfreq(size, 1 / rate), amplitude


def find_peaks(values: np.ndarray, rate: float, count: int = MOST_LINES, above: float = 0.0) -> list[tuple[float, float]]:
    """(frequency, amplitude) of the strongest lines, loudest first. above: see `standing_out`."""
    return [(frequency, amplitude) for frequency, amplitude, _ in standing_out(values, rate, count, above)]


def standing_out(values: np.ndarray, rate: float, count: int = MOST_LINES,
                 above: float = 0.0) -> list[tuple[float, float, float]]:  # fmt: skip
    """The strongest lines as (frequency, amplitude, amplitude over that of their surroundings), loudest first.

    above: the least ratio, for who looks for a pattern; 0: ALONE, or so much that white noise shows BY_CHANCE lines."""
    from scipy.ndimage import median_filter

    frequencies, amplitude = amplitude_spectrum(values, rate)
    above = above or max(ALONE, math.sqrt(math.log(len(values) / BY_CHANCE) / math.log(2.0)))
    width = min(len(amplitude) // 4 * 2 + 1, 401)
    floor = median_filter(amplitude, size=width, mode="mirror")  # as the spectrum of a real signal goes on
    inner = amplitude[1:-1]
    tops = np.flatnonzero((inner >= amplitude[:-2]) & (inner > amplitude[2:]) & (inner > above * floor[1:-1])) + 1
    slow = int(np.argmax(amplitude[frequencies <= 3 * rate / len(values)]))  # no line, but its side lobes are none either
    tops = tops[frequencies[tops] > 3 * rate / len(values)]
    louder, chosen = [(frequencies[slow], amplitude[slow])], list[tuple[float, float, float]]()
    for top in tops[np.argsort(-amplitude[tops])]:
        before, here, after = amplitude[top - 1 : top + 2]
        curve = before - 2 * here + after
        shift = 0.5 * (before - after) / curve if curve else 0.0
        frequency = float((top + shift) * frequencies[1])
        if not any(side_lobe(abs(frequency - one) * len(values) / rate, here / loud) for one, loud in louder if loud >= here):
            louder.append((frequency, here))
            chosen.append((frequency, float(here), float(here / max(floor[top], 1e-300))))
        if len(chosen) == count:
            break
    return chosen


def side_lobe(bins: float, ratio: float) -> bool:
    """Whether a peak so far from a louder one, and so much smaller, is but a side lobe of the Hann window."""
    return bins < 2 or (bins < 4 and ratio < 0.04) or (bins < 12 and ratio < 0.01)


def spectral_lines(values: np.ndarray, rate: float, *, spindle_speed: float | None = None, flutes: int = 1,
                   natural_frequencies: Sequence[float] = (), idle: np.ndarray | None = None,
                   count: int = MOST_LINES) -> tuple[SpectralLine, ...]:  # fmt: skip
    """The lines of a record, strongest first.

    A multiple of 50 or 60 Hz is hum only where the idling (`idle`, samples) has it too or the spindle cannot make it; a
    line of the idling is never tooth passing. natural_frequencies in Hz, spindle_speed in rad/s. Odd multiples of half the
    tooth-passing frequency, of a motion that repeats every other pass, are told where no multiple of the spindle's is as near.
    """
    width = 1.5 * rate / len(values)
    quiet = find_peaks(idle, rate) if idle is not None and len(idle) > 256 else []
    quiet_width = 1.5 * rate / len(idle) if idle is not None and len(idle) else 0.0
    peaks = find_peaks(values, rate, max(count, MOST_LINES))
    mains = _mains([frequency for frequency, _ in quiet], quiet_width) or _mains([f for f, _ in peaks[:MOST_LINES]], width)
    turning = spindle_speed / (2 * np.pi) if spindle_speed else None
    lines = []
    for frequency, amplitude in peaks[:count]:
        in_idle = any(
            abs(frequency - other) < max(width, quiet_width) and level > 0.3 * amplitude for other, level in quiet
        )
        kind, order = _of_the_spindle(frequency, turning, flutes, width)
        natural = any(abs(frequency - one) < max(width, 0.02 * one) for one in natural_frequencies)
        if natural and kind == "other" and not in_idle:  # hum does not die away
            kind = "natural"
        elif mains and _on_comb(frequency, mains, max(width, 0.1)) and (kind == "other" or in_idle):
            kind, order = "hum", round(frequency / mains)
        elif kind == "other" and natural:
            kind = "natural"
        lines.append(SpectralLine(frequency, amplitude, kind, order))
    return tuple(lines)


def fed_by_the_cut(
    lines: Sequence[SpectralLine], chatter: float, spindle_speed: float | None, flutes: int, near: float = 5e-3
) -> tuple[SpectralLine, ...]:
    """The lines with the chatter line (Hz) and its side bands at the tooth passing named so; spindle_speed in rad/s.

    A line of the spindle keeps its name, of the mains only where it is no side band. near: relative, how far they may drift.
    """
    passing = spindle_speed * flutes / (2 * np.pi) if spindle_speed else 1e6 * chatter  # no side bands are known
    named = []
    for line in lines:
        away = [abs(line.frequency - sign * chatter) for sign in (1.0, -1.0)]
        off = min(abs(one - round(one / passing) * passing) for one in away)
        own = off < near * chatter and line.kind not in ("spindle", "tooth-passing", "half tooth-passing")
        named.append(replace(line, kind="chatter", order=0) if own else line)
    return tuple(named)


def _of_the_spindle(frequency: float, turning: float | None, flutes: int, width: float) -> tuple[LineKind, int]:
    """What a line is to a spindle that turns at `turning` (Hz), and its order; ("other", 0) where it is nothing to it."""
    if turning is None:
        return "other", 0

    def order_of(base: float) -> int:
        order = round(frequency / base)
        return order if abs(frequency - order * base) < width + 1e-3 * frequency else 0

    order = order_of(turning)
    if order:
        return ("spindle", order) if order % flutes else ("tooth-passing", order // flutes)
    halves = order_of(0.5 * flutes * turning) if width < FINE * turning else 0
    return ("half tooth-passing", halves) if halves % 2 else ("other", 0)


def _on_comb(frequency: float, base: float, width: float) -> bool:
    order = round(frequency / base)
    return 1 <= order <= _HARMONICS_OF_HUM and abs(frequency - order * base) < width


def _mains(frequencies: Sequence[float], width: float) -> float | None:
    """50 or 60 Hz, where several lines are its multiples; None where neither explains any."""
    hits = {
        mains: sum(_on_comb(frequency, mains, max(width, 0.1)) for frequency in frequencies) for mains in MAINS
    }
    best = max(hits, key=lambda mains: hits[mains])
    return best if hits[best] >= 1 and hits[best] != hits[110.0 - best] else None


def comb_speed(
    values: np.ndarray, rate: float, nominal: float, flutes: int = 1, span: float = 0.15, idle: np.ndarray | None = None
) -> CombSpeed | None:
    """Spindle speed (rad/s) within `span` of the nominal one, from multiples of the tooth-passing frequency or, in
    chatter, from the spacing of the side bands of the strongest other line; None where nothing stands out.

    Lines that the idling has as well are hum and do not count. Where a spacing far from the nominal one explains clearly
    more, as where the speed of another test was written down, the nominal one is wrong: that spacing, or None, is told.
    """
    quiet = find_peaks(idle, rate, 80) if idle is not None and len(idle) > 256 else []
    width = 1.5 * rate / len(values) + (1.5 * rate / len(idle) if idle is not None and len(idle) else 0.0)
    lines = [
        line
        for line in find_peaks(values, rate, 80, 3.0)
        if not any(abs(line[0] - other) < width and level > 0.3 * line[1] for other, level in quiet)
    ]
    if len(lines) < 2:
        return None
    passing, resolution = nominal * flutes / (2 * np.pi), rate / len(values)
    candidates: list[tuple[float, CombSpeed]] = []
    for centre in (0.0, lines[0][0]):
        if centre and abs(centre / passing - round(centre / passing)) < 0.02:
            continue  # the strongest line is one of tooth passing itself
        found = _spacing(lines, centre, passing, (1 - span, 1 + span), resolution, rate / 2)
        far = None if centre else _far_spacing(lines, passing, span, resolution, rate / 2)
        if far is not None and (found is None or far.score > CLEARLY * found.score):
            if far.lines < FAR_LINES:
                continue  # else its lines are no side bands of the nominal one
            return CombSpeed(2 * np.pi * far.spacing / flutes, "tooth-passing lines") if far.share > FAR_SHARE else None
        if found is None:
            continue
        order = centre / found.spacing
        teeth = abs(order - round(order)) < 0.03 * max(1.0, 0.2 * order)
        # in noise alone the lines that happen to fit carry up to 0.37 of the amplitude, the lead is up to 1.9
        strong = found.share > 0.5 and found.even_share > 0.4 or found.lead > 4 and found.lines >= 6
        sure = strong if teeth else found.share > 0.2 and found.lead > 1.95
        if sure:
            basis: Literal["tooth-passing lines", "side bands"] = "tooth-passing lines" if teeth else "side bands"
            candidates.append((found.even_share, CombSpeed(2 * np.pi * found.spacing / flutes, basis)))
    return max(candidates, key=lambda candidate: candidate[0], default=(0.0, None))[1]


class _Spacing(NamedTuple):
    """A spacing (Hz), its score and the lead of that over the second best, how many lines it explains, and what share of
    them, by amplitude and by the root of amplitude (which lets no single line decide)."""

    spacing: float
    score: float
    lead: float
    lines: int
    share: float
    even_share: float


def _far_spacing(
    lines: Sequence[tuple[float, float]], passing: float, span: float, resolution: float, top: float
) -> _Spacing | None:
    """The spacing of a comb from 0 that explains most beyond `span`; the wider of two that explain as much."""
    low, high = FARTHEST
    sides = ((low, 1 - span), (1 + span, high))
    found = [one for side in sides if (one := _spacing(lines, 0.0, passing, side, resolution, top)) is not None]
    best = max((one.score for one in found), default=0.0)
    return max((one for one in found if one.score > 0.9 * best), default=None, key=lambda one: one.spacing)


def _spacing(
    lines: Sequence[tuple[float, float]], centre: float, passing: float, reach: tuple[float, float], resolution: float,
    top: float
) -> _Spacing | None:
    """The spacing (Hz) about `centre`, of this range in units of `passing`, that carries most of the lines' strength."""
    frequency = np.array([line[0] for line in lines])
    weight = np.sqrt(np.array([line[1] for line in lines]))
    orders = max(4, top / passing)
    grid = np.arange(reach[0] * passing, reach[1] * passing, 0.05 * resolution)
    near = _near(frequency - centre, grid, resolution, orders)
    score = near @ weight
    best = int(np.argmax(score))
    if (near[best] > 0.3).sum() < 2:
        return None
    apart = np.abs(grid - grid[best]) > 3 * resolution
    second = float(score[apart].max(initial=1e-30))
    hit, others = near[best] > 0.3, np.abs(frequency - centre) > 2 * resolution
    shares = [float((weight**power)[hit].sum() / (weight**power)[others].sum()) for power in (2, 1)]
    fine = grid[best] + np.arange(-0.5, 0.5, 0.25 / orders) * resolution  # high orders fall between the places of the grid
    exact = _near(frequency - centre, fine, resolution, orders) @ weight
    peak = int(np.argmax(exact))
    return _Spacing(float(fine[peak]), float(exact[peak]), float(score[best]) / second, int(hit.sum()), *shares)


def _near(away: np.ndarray, spacings: np.ndarray, resolution: float, orders: float) -> np.ndarray:
    """How nearly (0 to 1) lines `away` (n,) Hz from a comb's centre are of one with each of the spacings (m,) Hz: (m, n)."""
    order = np.round(away[None, :] / spacings[:, None])
    off = away - order * spacings[:, None]
    return np.exp(-0.5 * (off / (0.5 * resolution)) ** 2) * (order != 0) * (np.abs(order) <= orders)


def follow_line(
    values: np.ndarray,
    rate: float,
    start_frequency: float,
    *,
    reach: float = 0.03,
    window: float | None = None,
    start: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A line that drifts: times (s), frequencies (Hz) and amplitudes, each (windows,).

    In each window of length `window` (s; 60 periods of the line where None) the strongest line within `reach`
    (relative) of the last place is taken, an accepted step at a time.
    """
    length = int((window or 60.0 / start_frequency) * rate)
    hop = max(1, length // 4)
    times, found, size = [], [], []
    place = start_frequency
    for first in range(0, len(values) - length + 1, hop):
        frequencies, amplitude = amplitude_spectrum(values[first : first + length], rate)
        area = np.flatnonzero(np.abs(frequencies - place) <= reach * place)
        top = int(area[np.argmax(amplitude[area])])
        inside = 0 < top < len(amplitude) - 1 and amplitude[top] >= max(amplitude[top - 1], amplitude[top + 1])
        place = float(frequencies[top]) if inside else place
        times.append(start + (first + 0.5 * length) / rate)
        found.append(place)
        size.append(float(amplitude[top]))
    return np.array(times), np.array(found), np.array(size)
