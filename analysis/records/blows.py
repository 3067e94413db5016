"""Blows in a record of free decays: where the structure was struck, and whether what follows dies away or grows.

A structure that nobody touches loses energy: its swings may beat, but not rise above all of the last ones at once. Where they
do, and die away after, it was struck.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from testbed.analysis.records.white_noise import white_noise

_BEFORE, _AFTER = 10, 10  # swings before a blow that it rises above, longer than most beats, and after it, to die away in
_LAST = 2  # swings that a blow rises above where beats are ruled out otherwise
_AT_ONCE = 2  # swings within which a blow is at its largest
_RISE, _DIES = 1.5, 1.3  # times the largest swing before; by how much it may still rise, as by a beat
_ORDER, _PER_SWING = 12, 12  # samples that foretell the next one of a free decay, of so many to a swing
_UNFORETOLD = 8.0  # times what usual samples differ from what is foretold
_STANDS_OUT = 12.0  # rms of the noise, from top to bottom of a swing
_LOUD = 8.0  # rms of the noise: noise alone is less from top to bottom
_UNSURE = 1.5  # swings by which a blow may be placed late
_FAINT = 0.1  # of the largest swing: fainter blows are not looked for
_LEAST_SAMPLES = 64  # of a decay that a fit can use
_OFFSET_CYCLES = 1.5  # of a record: slower motions are offset and drift
_GROWN = 1.5  # times the level at first, by which a record has grown
_SETTLED = 0.7  # of the largest level, that a record which grew still has at its end


def main_frequency(values: np.ndarray) -> float:
    """Frequency (cycles a sample) of the strongest motion anywhere in a record, but for offset and slow drift."""
    place = np.linspace(-1.0, 1.0, len(values))
    flat = values - np.polynomial.Polynomial.fit(place, values, 2)(place)
    power = np.abs(np.fft.rfft(flat)) ** 2
    power[: int(np.ceil(_OFFSET_CYCLES))] = 0.0
    return max(1, int(np.argmax(power))) / len(values)


def swing_length(values: np.ndarray) -> int:
    """Samples of one swing of the strongest motion, 4 at the least."""
    return max(4, round(1.0 / main_frequency(values)))


def find_blows(values: np.ndarray) -> tuple[int, ...]:
    """Samples at which a structure that rings was struck, the record's beginning among them where it rings from there on."""
    swing = swing_length(values)
    if len(values) < _LEAST_SAMPLES or len(values) < 4 * swing:
        return ()
    sizes, noise = _sizes(values, swing), white_noise(values)
    least = max(_STANDS_OUT * noise, _FAINT * float(sizes.max()))
    blows = [_onset(values, place, swing) for place in _rises(values, sizes, swing, least)]
    first = min(blows, default=len(values))
    if first > max(_LEAST_SAMPLES, 4 * swing):
        opening = sizes[: first - swing]
        if opening[0] > least and opening[0] > opening[len(opening) // 2 :].max():
            blows.insert(0, 0)
    return tuple(blows)


def _sizes(values: np.ndarray, swing: int) -> np.ndarray:
    """From top to bottom of the swing that begins at each sample, (samples - swing + 1,)."""
    half = (swing - 1) // 2
    lowest = minimum_filter1d(values, swing, origin=-half)
    return (_largest(values, swing, ahead=True) - lowest)[: len(values) - swing + 1]


def _rises(values: np.ndarray, sizes: np.ndarray, swing: int, least: float) -> list[int]:
    """Samples from which the swing that begins is larger than all that ended within the last ones, and none later is.

    Beside a beat only: then the samples before do not foretell the blow.
    """
    ended = np.concatenate([np.full(swing, sizes[0]), sizes])[: len(sizes)]  # the swing that ends here
    again = np.concatenate([sizes[swing:], np.zeros(swing)])[: len(sizes)]  # a spike is no second swing
    soon, after = (_largest(sizes, swing * count, ahead=True) for count in (_AT_ONCE, _AFTER))
    may_be = (soon > least) & (after < _DIES * soon) & (np.arange(len(sizes)) >= swing)
    found: dict[int, list[int]] = {}
    for memory in (_BEFORE, _LAST):
        past = _RISE * _largest(ended, swing * memory, ahead=False)
        places = np.flatnonzero(may_be & (sizes > past) & (again > past))
        groups = np.split(places, np.flatnonzero(np.diff(places) > swing) + 1) if len(places) else []
        found[memory] = [int(group[0]) for group in groups]
    sure, others = found[_BEFORE], found[_LAST]
    new = [place for place in others if all(abs(place - other) > _BEFORE * swing for other in sure)]
    if new:
        jumps = _unforetold(values, swing)
        new = [place for place in new if jumps[max(0, place - swing) : place + _AT_ONCE * swing].any()]
    return sorted([*sure, *new])


def _largest(sizes: np.ndarray, width: int, ahead: bool) -> np.ndarray:
    """The largest of the `width` sizes from each on, or up to each."""
    half = (width - 1) // 2
    return maximum_filter1d(sizes, width, origin=-half if ahead else half, mode="nearest")


def _unforetold(values: np.ndarray, swing: int) -> np.ndarray:
    """Which samples (samples,), bool, those before do not foretell as they do the others: a few modes foretell themselves."""
    width = max(1, swing // _PER_SWING)
    means = values[: len(values) // width * width].reshape(-1, width).mean(axis=1)
    rows = np.lib.stride_tricks.sliding_window_view(means, _ORDER + 1)
    known, next_one, weight = np.column_stack([rows[:, :-1], np.ones(len(rows))]), rows[:, -1], np.ones(len(rows))
    for _ in range(4):  # blows must not teach
        rest = next_one - known @ np.linalg.lstsq(known * weight[:, None], next_one * weight, rcond=None)[0]
        usual = 1.4826 * float(np.median(np.abs(rest))) or 1e-300
        weight = 1.0 / np.maximum(1.0, np.abs(rest) / (3.0 * usual))
    jumps = np.concatenate([np.zeros(_ORDER, dtype=bool), np.abs(rest) > _UNFORETOLD * usual])
    return np.repeat(jumps, width)


def _onset(values: np.ndarray, place: int, swing: int) -> int:
    """The sample at which a swing that begins at `place` and is first a blow's by its last sample leaves the swings before."""
    stop = min(place + swing, len(values) - 1)
    if place <= swing:  # it came in one of the first two swings, of which the first samples alone are quiet
        quiet = values[: max(4, swing // 4)]
        return int(np.argmax(np.abs(values[: stop + 1] - quiet.mean()) > 4.0 * float(np.ptp(quiet)))) or stop
    quiet = values[max(0, stop - _LAST * swing) : max(1, stop - swing // 2)]
    inside = np.flatnonzero((values[:stop] <= quiet.max()) & (values[:stop] >= quiet.min()))
    return int(inside[-1]) + 1 if len(inside) else stop


def grows(values: np.ndarray) -> float | None:
    """By how much the swings of a record grow from its first tenth to its last; None where they do not."""
    swing = swing_length(values)
    sizes = _sizes(values, swing)
    part = max(1, len(sizes) // 10)
    first, last = float(np.median(sizes[:part])), float(np.median(sizes[-part:]))
    grown = last > max(_GROWN * first, _SETTLED * float(np.quantile(sizes, 0.98)), _LOUD * white_noise(values))
    if len(sizes) < _LEAST_SAMPLES or not grown or find_blows(values):
        return None
    return last / max(first, 1e-300)


def decays(values: np.ndarray) -> list[tuple[int, int]]:
    """(first sample, one past the last) of each blow's record: what is before the first blow is its own, too."""
    blows = find_blows(values)
    if len(blows) < 2:
        return [(0, len(values))]
    before = round(_UNSURE * swing_length(values))  # a blow begins before it is the largest
    ends = [max(place - before, first + 1) for first, place in zip((0, *blows[1:-1]), blows[1:], strict=True)]
    return list(zip((0, *blows[1:]), (*ends, len(values)), strict=True))
