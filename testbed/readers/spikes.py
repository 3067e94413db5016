"""Lone spikes: samples that stand alone off a smooth curve through their neighbours, as wrong digits and bit errors do."""

from __future__ import annotations

import numpy as np

_SPIKE = np.array([1 / 6, -2 / 3, 1.0, -2 / 3, 1 / 6])  # what the four neighbours of each sample leave of a lone spike
_KINK = np.array([0.0, -1 / 2, 1.0, -1 / 2, 0.0])  # and of the sample at which a quiet signal begins to move or ends
_ROUNDED = 4 / 3  # steps of the converter, that rounding alone may leave: half a step in each of the five samples
_ON_GRID = 0.98  # share of samples on a grid of equal steps, that shows the converter's


def spikes(values: np.ndarray) -> list[int]:
    """Indices of lone spikes of a channel, shape (samples,).

    A spike leaves 1, -2/3 and 1/6 of itself at its place, beside it and two away, of what its neighbours predict. It is none
    where the beginning or end of a blow explains that better, where the samples a few away are off as well, and where
    rounding to the steps of the converter does as much.
    """
    if len(values) < 32:
        return []
    rest = np.zeros(len(values))
    rest[2:-2] = values[2:-2] - (4 * (values[1:-3] + values[3:-1]) - values[:-4] - values[4:]) / 6
    size = np.abs(rest)
    usual = 1.4826 * float(np.median(size[2:-2]))
    limit = max(12 * usual, 1e-3 * float(np.ptp(values)), 1.5 * _ROUNDED * quantum(values))
    places = [int(place) for place in np.flatnonzero(size > limit) if 4 <= place < len(values) - 4]
    return [place for place in places if _stands_alone(rest, place, usual)]


def _stands_alone(rest: np.ndarray, place: int, usual: float) -> bool:
    """Whether what is left around a place is a spike's, and nothing like it follows or precedes it closely."""
    near, here = rest[place - 2 : place + 3], rest[place]
    off = np.abs(near - here * _SPIKE).max()
    as_kink = near - _KINK * (near @ _KINK) / (_KINK @ _KINK)
    as_spike = near - _SPIKE * (near @ _SPIKE) / (_SPIKE @ _SPIKE)
    around = np.concatenate([rest[max(place - 6, 0) : place - 2], rest[place + 3 : place + 7]])
    return bool(
        off < 0.2 * abs(here) + 3 * usual
        and as_spike @ as_spike < 0.25 * (as_kink @ as_kink)
        and np.median(np.abs(around)) < 0.15 * abs(here) + 3 * usual
    )


def most_spikes(samples: int) -> int:
    """Lone spikes among so many samples beyond which they are the signal's own."""
    return max(20, samples // 500)


def quantum(values: np.ndarray) -> float:
    """The step of the converter (or of the printed digits) that nearly all samples are multiples of apart; 0 without one."""
    levels = np.unique(values)
    if len(levels) < 3 or len(levels) > len(values) / 2 and len(levels) > 1000:
        return 0.0
    steps = np.round(np.diff(levels) / (levels[-1] - levels[0]), 9)
    found, counts = np.unique(steps[steps > 0], return_counts=True)
    if not len(found):
        return 0.0
    step = float(found[np.argmax(counts)]) * float(levels[-1] - levels[0])
    places = (values - np.sort(values)[len(values) // 2]) / step
    off = np.abs(places - np.round(places))
    return step if float(np.mean(off < 0.01)) >= _ON_GRID else 0.0
