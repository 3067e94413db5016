"""Poles of measured receptances by sdypy-EMA (LSCF), and which of them hold from order to order."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbed.analysis.tap.frequency_response import FrequencyResponse
from testbed.problem import InputProblem

TAP_EXTRA = 'pip install "machining-testbed[tap]"'
HIGHEST_ORDER = 40  # of the polynomials, in modes: several times what a band holds
NEAR = 0.01  # of a pole's modulus, within which poles of other orders are the same
HOLDS = 4  # orders at the least that a stable pole comes back in
_NARROWEST = 0.25  # of the step of the lines, that half a peak's width must have: a narrower one is a line of noise
_MOST_DAMPING = 0.3  # beyond it, a pole is a polynomial's way to follow the residual terms


@dataclass(frozen=True)
class Stabilisation:
    """order, frequency (Hz) and damping_ratio of every pole found; stable: (n, 3) frequency, damping ratio, and in how many
    orders it held."""

    order: np.ndarray
    frequency: np.ndarray
    damping_ratio: np.ndarray
    stable: np.ndarray


def poles(responses: Sequence[FrequencyResponse], masks: Sequence[np.ndarray]) -> Stabilisation:
    """Poles of all responses together; those of one frequency axis are one polynomial's."""
    found = np.empty((0, 3))
    axes: dict[tuple[float, float, int], list[int]] = {}
    for place, one in enumerate(responses):
        axes.setdefault((one.frequency[0], one.frequency[1], len(one.frequency)), []).append(place)
    for places in axes.values():
        common = np.logical_or.reduce([masks[place] for place in places])
        found = np.concatenate([found, _lscf([responses[place] for place in places], common)])
    return Stabilisation(found[:, 0], found[:, 1], found[:, 2], _stable(found))


def _lscf(responses: Sequence[FrequencyResponse], mask: np.ndarray) -> np.ndarray:
    """(n, 3): order, frequency, damping ratio of the poles within the band."""
    try:
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import sdypy.EMA as ema
    except ImportError:
        raise InputProblem("testbed tap", "needs the package sdypy-EMA", TAP_EXTRA) from None
    lines = np.flatnonzero(mask)
    first, last = int(lines[0]), int(lines[-1])
    step = responses[0].frequency[1] - responses[0].frequency[0]
    lead = int(round(responses[0].frequency[0] / step))  # lines that its axis lacks down to 0
    order = min(HIGHEST_ORDER, max(2, len(lines) // 8))
    axis = np.arange(lead + last + 2) * step
    rows = np.zeros((len(responses), len(axis)), dtype=complex)
    for row, one in zip(rows, responses, strict=True):
        speed = one.receptance[first : last + 1] * one.laplace[first : last + 1]  # a mobility is the evenest of the three
        row[lead + first : lead + last + 1] = speed / max(float(np.sqrt(np.mean(np.abs(speed) ** 2))), 1e-300)
    low, high = axis[lead + first], axis[lead + last]
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        model = ema.Model(frf=rows, freq=axis, lower=low, upper=axis[-1], pol_order_high=order)
        model.get_poles(method="lscf", show_progress=False)
    decay = responses[0].decay
    found = []
    for place, (frequency, damping) in enumerate(zip(model.pole_freq, model.pole_xi, strict=True), 1):
        natural, ratio = np.asarray(frequency), np.asarray(damping)
        turning = natural * np.sqrt(np.maximum(1.0 - ratio**2, 0.0))
        falling = ratio * natural - decay / (2.0 * np.pi)
        natural = np.hypot(turning, falling)
        ratio = falling / np.maximum(natural, 1e-300)
        kept = (frequency > 0) & (natural > low) & (natural < high) & (ratio > 0) & (ratio < _MOST_DAMPING)
        kept &= ratio * natural + decay / (2.0 * np.pi) > _NARROWEST * step
        found += [(place, one, other) for one, other in zip(natural[kept], ratio[kept], strict=True)]
    return np.array(found).reshape(-1, 3)


def _stable(found: np.ndarray) -> np.ndarray:
    """Poles that come back, the densest first: the median of each cluster, and how many orders it holds in."""
    order = found[:, 0]
    turning = found[:, 1] * np.sqrt(1.0 - found[:, 2] ** 2)
    place = turning + 1j * found[:, 1] * found[:, 2]
    free = np.ones(len(found), dtype=bool)
    clusters = []
    near = np.abs(place[:, None] - place[None, :]) < NEAR * np.abs(place)[:, None]
    while free.any():
        counts = (near & free[None, :]).sum(axis=1) * free
        best = int(np.argmax(counts))
        members = near[best] & free
        orders = len(np.unique(order[members]))
        if counts[best] < HOLDS:
            break
        if orders >= HOLDS:
            clusters.append((float(np.median(found[members, 1])), float(np.median(found[members, 2])), orders))
        free &= ~members
    return np.array(clusters).reshape(-1, 3)
