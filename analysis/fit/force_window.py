"""The force of a hammer outside its blows is its sensor's noise, and no force: it is taken away before a prediction.

A model driven by the noise of the force sensor vibrates, and the misfit that this leaves would be taken for an effect; what
the noise adds to the blow bends the modal mass. Modal testing applies a force window for the same reason (D. J. Ewins, Modal
Testing, 2nd ed., 2000, chapter 3). A shaker's force, which is there all the time, is left as measured.
"""

from __future__ import annotations

import numpy as np

BLOW = 8.0  # a blow stands out from the quiet force by so many times its spread
PEAK = 30.0  # and the strongest by so many: less is no hammer
EDGE = 2.0  # a blow ends where the force is within so many times the spread,
MARGIN = 3  # and so many samples later, or as many as the blow itself has: what the filter before the converter adds
MOST = 0.1  # blows take at most this share of a record


def windowed(force: np.ndarray) -> np.ndarray:
    """The measured force (samples,), N, with nothing outside a hammer's blows; as it is where it shows no blows."""
    quiet = float(np.median(force))
    away = np.abs(force - quiet)
    spread = 1.4826 * float(np.median(away))
    if away.max() <= PEAK * spread:
        return force
    inside = np.zeros(len(force), dtype=bool)
    for first, last in _runs(away > EDGE * spread):
        if away[first:last].max() > BLOW * spread:
            margin = max(MARGIN, last - first)
            inside[max(0, first - margin) : last + margin] = True
    return force if np.mean(inside) > MOST else np.where(inside, force - quiet, 0.0)


def _runs(marked: np.ndarray) -> list[tuple[int, int]]:
    """First sample, and the one after the last, of every run of marked samples."""
    steps = np.flatnonzero(np.diff(np.concatenate([[0], marked.astype(np.int8), [0]])))
    return list(zip(steps[::2].tolist(), steps[1::2].tolist(), strict=True))
