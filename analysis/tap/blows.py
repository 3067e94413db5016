"""Hammer blows in a record: where each begins and ends, and which of them are no use: double hits, overloads, no room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_BLOW = 0.1  # of the largest force, from which a pulse is a blow
_SECOND = 0.04  # of a blow's force, from which a later pulse of the same blow is a second hit
_PULSE = 0.1  # of its peak, down to which a pulse reaches
_CLEAR = 8.0  # rms of the force's noise, that a pulse rises above
_SOON = 0.1  # of the longest time between blows, within which a pulse is a second hit
_DIED = 0.25  # of the response's first swing, that is left when a next blow is a blow of its own
_BEFORE = 0.02  # of a blow's stretch, that it may begin before the pulse
_ROOM = 0.5  # of the usual stretch, that a blow needs at the least
_REPEATS = 4  # samples at one extreme value: the converter's end
_LEAST_PULSE = 3.0  # samples of a pulse above half of its peak
_HEARD, _AGAIN, _SHORTEST = 1.5, 1.5, 256  # times the noise that is heard; how much longer a stretch lasts; samples
_ENVELOPE = 40  # parts of a stretch that its decay is looked at in


@dataclass(frozen=True)
class Blow:
    """Samples [start, stop) of one blow, its pulse's peak place and force (N); left_out: why it is no use, "" where it is."""

    start: int
    stop: int
    peak: int
    force: float
    left_out: str = ""


def find_blows(force: np.ndarray, response: np.ndarray, bridged: Sequence[int] | np.ndarray = ()) -> tuple[Blow, ...]:
    """Every blow of a record, those of no use among them. bridged: samples that were not measured, as where it overloaded."""
    level = np.abs(force - np.median(force))
    noise = 1.4826 * float(np.median(level))
    top = float(level.max(initial=0.0))
    if top <= _CLEAR * noise or top == 0.0:
        return ()
    pulses = _pulses(level, np.maximum(_BLOW * top, _CLEAR * noise))
    pulses = _own(pulses, level, response)
    ends = [first for first, _ in pulses[1:]] + [len(force)]
    stretch = float(np.median([end - first for (first, _), end in zip(pulses, ends, strict=True)]))
    lead = round(_BEFORE * stretch)
    found: list[Blow] = []
    for place, ((first, last), end) in enumerate(zip(pulses, ends, strict=True)):
        start = max(0 if place == 0 else found[-1].stop, first - lead)
        stop = end if place == len(pulses) - 1 else max(end - lead, last + 1)
        peak = first + int(np.argmax(level[first : last + 1]))
        why = _why_not(force, response, level, (start, stop, first, peak), noise, np.asarray(bridged, dtype=int))
        if not why and stop - first < _ROOM * stretch:
            why = "the record ends too soon after it" if place == len(pulses) - 1 else "the next blow comes too soon"
        found.append(Blow(start, stop, peak, float(force[peak]), why))
    return tuple(found)


def _pulses(level: np.ndarray, least: float) -> list[tuple[int, int]]:
    """First and last sample of each pulse that rises above `least`, down to where it has all but ended."""
    high = np.flatnonzero(level > least)
    if not len(high):
        return []
    width = max(1, round(_width(level, int(np.argmax(level)))))
    groups = np.split(high, np.flatnonzero(np.diff(high) > width) + 1)
    found = []
    for group in groups:
        first, last = int(group[0]), int(group[-1])
        floor = max(_PULSE * float(level[first : last + 1].max()), 0.0)
        while first > 0 and level[first - 1] > floor and level[first - 1] <= level[first]:
            first -= 1
        found.append((max(0, first - width), last))
    return found


def _width(level: np.ndarray, peak: int) -> float:
    """Samples over which a pulse is above half of its peak."""
    half = 0.5 * level[peak]
    first, last = peak, peak
    while first > 0 and level[first - 1] > half:
        first -= 1
    while last < len(level) - 1 and level[last + 1] > half:
        last += 1
    return float(last - first + 1)


def _own(pulses: list[tuple[int, int]], level: np.ndarray, response: np.ndarray) -> list[tuple[int, int]]:
    """Pulses that are blows of their own: one that comes soon, or while the response still rings, is a second hit."""
    motion = np.abs(response - np.median(response))
    starts = np.array([first for first, _ in pulses] + [len(level)])
    longest = int(np.diff(starts).max())
    own: list[tuple[int, int]] = []
    for first, last in pulses:
        if own:
            begin = own[-1][0]
            width = max(4, (first - begin) // 4)
            rung = float(motion[begin : begin + max(width, last - first + 4)].max(initial=0.0))
            left = float(motion[max(begin, first - width) : first].max(initial=0.0))
            if first - begin < _SOON * longest or left > _DIED * rung and first - begin < 2.0 * _SOON * longest:
                continue
        own.append((first, last))
    return own


def _why_not(force: np.ndarray, response: np.ndarray, level: np.ndarray, where: tuple[int, int, int, int], noise: float,
             bridged: np.ndarray) -> str:
    start, stop, first, peak = where
    for said, values in (("force", force), ("response", response)):
        if _overloaded(values, start, stop) or np.any((bridged >= start) & (bridged < stop)):
            return f"the {said} was overloaded"
    width = round(_width(level, peak))
    rest = level[min(stop, peak + 3 * width) : stop]
    limit = max(_SECOND * float(level[peak]), _CLEAR * noise)
    if len(rest) and float(rest.max()) > limit:
        return "it hit twice"
    return ""


def _overloaded(values: np.ndarray, start: int, stop: int) -> bool:
    """Whether a stretch stays at the extreme value of the whole record, or of its own, for several samples."""
    part = values[start:stop]
    for sign in (1.0, -1.0):
        top = float((sign * part).max(initial=-np.inf))
        span = float(np.ptp(part)) or 1.0
        if np.count_nonzero(sign * part >= top - 1e-9 * span) >= _REPEATS and top > 0.25 * span:
            return True
    return False


def pulse_samples(force: np.ndarray, blow: Blow) -> float:
    """Samples over which a blow's pulse is above half of its peak."""
    level = np.abs(force - np.median(force))
    return _width(level, blow.peak)


def too_short(force: np.ndarray, blow: Blow) -> bool:
    """Whether a pulse has too few samples to be known: what it did between them would be guessed."""
    return pulse_samples(force, blow) < _LEAST_PULSE


def _parts(response: np.ndarray, parts: int) -> tuple[np.ndarray, int]:
    """rms of each part of a stretch about its mean, and the samples of a part."""
    size = max(8, len(response) // parts)
    return np.array([np.std(response[place : place + size]) for place in range(0, len(response) - size + 1, size)]), size


def left_at_end(response: np.ndarray, noise: float) -> float:
    """What is left of a response at the end of its stretch, over its largest swing, without its noise."""
    parts, _ = _parts(response, _ENVELOPE)
    last = float(np.median(parts[-3:]))
    return float(np.sqrt(max(last**2 - noise**2, 0.0)) / max(float(parts.max()), 1e-300))


def lasting(response: np.ndarray, before: int, noise: float) -> int:
    """Samples of a stretch until its response has died away in its noise, and half as many again."""
    parts, size = _parts(response, 4 * _ENVELOPE)
    loud = np.flatnonzero(parts > _HEARD * max(noise, 1e-4 * float(parts.max())))
    rung = (int(loud[-1]) + 1) * size - before if len(loud) else len(response)
    return min(len(response), before + max(round(_AGAIN * rung), _SHORTEST))


