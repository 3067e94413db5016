"""What repeats with the spindle, but not with the teeth, at the end of a cut: runout, or chatter locked to the spindle.

A cutter beside its axis makes the orders next to multiples of the flutes, and no others as long as its teeth stay in the work.
A flip makes the odd halves of the tooth passing. Runout stands from the first revolutions on, while chatter grows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from testbed.analysis.records.cut_end import BEFORE, CutEnd

HALF_LEADS = 1.0  # times all other such orders, from which the odd halves of the tooth passing are a flip's
FIRST, STANDS_AT_ONCE = 3, 0.7  # revolutions behind the entry, and share of it that stands by then where it is forced
PLACED = 0.4  # bins within which an order lies on a multiple of the mains
LOUD_ORDER, DOUBTED_ORDER = 0.7, 0.4  # of the feed: what repeats with the spindle only
LOUD_ECCENTRIC = 1.0  # of the feed: the same where a cutter beside its axis can make it, then doubted from LOUD_ORDER on
LOUD_FORCE, DOUBTED_FORCE = 1.5, 0.6  # of the teeth's: the same in a force, where runout itself shows and not what it moves
ONE_TOOTH = 1.0  # times the root of the other teeth: what a force makes where one tooth alone cuts, the most of a runout
PECULIAR, LOUD_PECULIAR, DOUBTED_PECULIAR = 4.0, 0.3, 0.2  # of the orders beside the teeth's, that neither a cutter beside its
# axis nor teeth of any lengths make, but one rhythm does; and how large such a pattern is
DOUBTED_UNMEASURED = 1.0  # of the teeth's: odd halves of the tooth passing in a motion that cannot be measured
ECCENTRIC, NEARLY_ECCENTRIC = 0.6, 0.4  # of the orders beside the teeth's, that others have at the most where runout made them


@dataclass(frozen=True)
class Pattern:
    """What repeats with the spindle only.

    others, half: Fourier coefficients by order, of all of it and of the odd halves. size, most: how large it is, without what
    may be hum, and in all: a motion in feeds, else in what repeats with the teeth. rest: orders that an eccentric cutter does
    not make, over those that it does. at_once: whether it stood behind the entry already; grew: that it did not. Neither is
    told where no idling was recorded.
    """

    others: np.ndarray
    half: np.ndarray
    size: float
    most: float
    rest: float
    flips: bool
    at_once: bool
    grew: bool


def pattern_of(end: CutEnd) -> Pattern:
    """The pattern at the end of a cut."""
    pattern = np.fft.rfft(end.turns.pattern)
    orders, flutes = np.arange(len(pattern)), end.flutes
    before = np.array([end.before(order) > BEFORE * amplitude for order, amplitude in enumerate(end.amplitudes)])
    others = np.where((orders % flutes > 0) & ~before, pattern, 0.0)
    unheard = math.isnan(end.before(1.0))  # nothing tells hum from what repeats with the spindle
    sure = np.where([unheard and end.on_mains(float(order), PLACED) for order in orders], 0.0, others)
    half = others * (orders % flutes == flutes / 2)
    weight = end.from_tooth_to_tooth(orders)
    if end.measured:
        size, most = (float(np.abs(np.fft.irfft(one * weight, len(end.turns.pattern))).max()) for one in (sure, others))
    else:
        teeth = max(float(np.linalg.norm(pattern[orders % flutes == 0])), 1e-300)
        size, most = (float(np.linalg.norm(one)) / teeth for one in ((sure, others) if end.is_force else (half, half)))
    beside = np.minimum(orders % flutes, flutes - orders % flutes) == 1
    eccentric = float(np.linalg.norm(sure * weight * beside))
    rest = float(np.linalg.norm(sure * weight * ~beside)) / max(eccentric, 1e-300) if flutes > 2 else 0.0
    flips = bool(np.linalg.norm(half) > HALF_LEADS * np.linalg.norm(others - half))
    at_once = _at_once(end, others)
    return Pattern(others, half, size, most, rest, flips, at_once, not unheard and not at_once)


def _at_once(end: CutEnd, others: np.ndarray) -> bool:
    """Whether the pattern stood behind the entry as at the end; never where no entry was recorded."""
    power = float(np.sum(np.abs(others) ** 2))
    if math.isnan(end.before(1.0)) or power <= 0.0:
        return False
    first = np.fft.rfft(end.whole.rows[1 : 1 + FIRST].mean(axis=0))
    return float(np.real(np.sum(first * np.conj(others)))) > STANDS_AT_ONCE * power


def limits(end: CutEnd, seen: Pattern) -> tuple[float, float]:
    """(size that is chatter, size that may be) of what repeats with the spindle only."""
    if seen.rest > PECULIAR and not math.isnan(end.before(1.0)):
        return LOUD_PECULIAR, DOUBTED_PECULIAR
    if end.measured:
        eccentric = LOUD_ORDER if seen.grew else LOUD_ECCENTRIC, LOUD_ORDER
        return eccentric if seen.rest < ECCENTRIC else (LOUD_ORDER, DOUBTED_ORDER)
    if not end.is_force:
        return math.inf, DOUBTED_UNMEASURED
    one_tooth = ONE_TOOTH * math.sqrt(max(end.flutes - 1.0, 1.0))
    if end.flutes < 4:
        return LOUD_FORCE, DOUBTED_FORCE if end.flutes == 2 else one_tooth
    if seen.rest > ECCENTRIC:
        return DOUBTED_FORCE, DOUBTED_FORCE
    return 2.0 * one_tooth, DOUBTED_FORCE if seen.rest > NEARLY_ECCENTRIC else one_tooth
