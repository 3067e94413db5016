"""How many delays a state needs: rank growth, singular values, false nearest neighbours, average mutual information.

The state of a delayed oscillator is sampled once a delay period, y_n(k) = x((n + k/d) tau), k = 0 .. d-1, and d must hold
the modes that are alive. Without noise the rank of the states stops growing with d; with noise their singular values
level off at the noise. Both ask what is needed here: how many directions the transient moves in (Mann and Young 2006,
Proc. R. Soc. A 462, 2145, section 2).

False nearest neighbours (Kennel, Brown and Abarbanel 1992, Phys. Rev. A 45, 3403) and the first minimum of the average
mutual information (Fraser and Swinney 1986, Phys. Rev. A 33, 1134) ask for the dimension of a recurrent attractor and
for the lag between its coordinates. A transient that dies never comes back to its neighbourhood, and the periodic motion
that is left is a closed curve whatever the dimension of the map about it: they answer another question.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from testbed.analysis.multipliers.floquet import once_per_period_samples, tooth_period
from testbed.analysis.records.white_noise import white_noise
from testbed.recording import Recording


def delay_states(recording: Recording, delays: int, *, period: float | None = None, start: float | None = None,
                 stop: float | None = None, channel: str = "displacement") -> np.ndarray:
    """States once a delay period about their mean over the last quarter, (periods, delays), the channel's unit.

    period (s) by default from the marks; start, stop (s) by default the conditions `entry_time` and `exit_time`, or all.
    ValueError for fewer than four periods.
    """
    period = tooth_period(recording) if period is None else period
    last = recording.start + (len(recording) - 1) / recording.sampling_rate
    start = float(recording.conditions.get("entry_time", recording.start)) if start is None else start
    stop = float(recording.conditions.get("exit_time", last)) if stop is None else stop
    states = once_per_period_samples(recording, period, start, stop, delays, channel)
    if states.shape[0] < 4:
        raise ValueError(f"{states.shape[0]} delay periods; at least 4 are needed")
    return states - states[-max(1, states.shape[0] // 4):].mean(axis=0)


def rank_growth(recording: Recording, delays: Sequence[int] = tuple(range(1, 13)), *, periods: int | None = None,
                tolerance: float = 1e-6, **where: object) -> np.ndarray:
    """Rank of the states for each number of delays, (delays,): directions above `tolerance` of the largest.

    periods: how many of the first states are looked at, all where None. For records without noise; noise fills every
    direction and the rank is then the number of delays. where: as of `delay_states`.
    """
    ranks = []
    for count in delays:
        states = delay_states(recording, count, **where)[:periods]  # type: ignore[arg-type]
        singular = np.linalg.svd(states, compute_uv=False)
        ranks.append(int(np.count_nonzero(singular > tolerance * singular[0])))
    return np.array(ranks)


@dataclass(frozen=True)
class SingularValues:
    """Of the states, over the largest, (delays,); floor: what white noise alone would reach, over the largest; rank:
    how many stand above it."""

    values: np.ndarray
    floor: float
    rank: int


def singular_values(recording: Recording, delays: int = 8, *, periods: int | None = None, noise: float | None = None,
                    channel: str = "displacement", **where: object) -> SingularValues:
    """Normalised singular values of the first `periods` states and how many of them noise cannot explain.

    noise: rms of the white noise, the channel's unit; from the signal's fourth differences where None. The largest
    singular value of periods x delays white numbers stays below noise (sqrt(periods) + sqrt(delays)).
    """
    states = delay_states(recording, delays, channel=channel, **where)[:periods]  # type: ignore[arg-type]
    singular = np.linalg.svd(states, compute_uv=False)
    level = white_noise(np.asarray(recording.channels[channel], float)) if noise is None else noise
    floor = level * (np.sqrt(states.shape[0]) + np.sqrt(delays)) / singular[0]
    values = singular / singular[0]
    return SingularValues(values, float(floor), int(np.count_nonzero(values > floor)))


def false_nearest_neighbours(recording: Recording, dimensions: Sequence[int] = tuple(range(1, 9)), *, lag: int = 1,
                             ratio: float = 15.0, size: float = 2.0, stroboscopic: bool = False,
                             channel: str = "displacement", **where: object) -> np.ndarray:
    """Fraction of nearest neighbours that part when one coordinate is added, for each dimension, (dimensions,).

    Coordinates are `lag` samples apart; with `stroboscopic` the signal is looked at once a delay period and lag counts
    periods. A neighbour is false where the added coordinate takes it further than `ratio` times its distance, or
    further than `size` standard deviations of the signal (both criteria of Kennel et al. 1992).
    """
    if stroboscopic:
        signal = delay_states(recording, 1, channel=channel, **where)[:, 0]  # type: ignore[arg-type]
    else:
        signal = np.asarray(recording.channels[channel], float)
    spread = float(signal.std())
    fractions = []
    for dimension in dimensions:
        count = signal.size - dimension * lag
        if count < 3:
            raise ValueError(f"{signal.size} samples are too few for {dimension} coordinates {lag} apart")
        vectors = np.column_stack([signal[k * lag:k * lag + count] for k in range(dimension)])
        distance, neighbour = cKDTree(vectors).query(vectors, k=2)
        near, other = np.asarray(distance)[:, 1], np.asarray(neighbour)[:, 1]
        added = np.abs(signal[dimension * lag:dimension * lag + count] - signal[other + dimension * lag])
        false = (added > ratio * near) | (np.hypot(near, added) > size * spread)
        fractions.append(float(np.mean(false)))
    return np.array(fractions)


def mutual_information(recording: Recording, lags: Sequence[int] | np.ndarray, *, bins: int = 24,
                       channel: str = "displacement") -> np.ndarray:
    """Average mutual information (bit) between the signal and itself `lags` samples later, (lags,); `bins` of equal count."""
    signal = np.asarray(recording.channels[channel], float)
    if max(lags) >= signal.size // 2:
        raise ValueError(f"a lag of {max(lags)} is too long for {signal.size} samples")
    cells = np.minimum((np.argsort(np.argsort(signal)) * bins) // signal.size, bins - 1)
    information = []
    for lag in lags:
        joint = np.histogram2d(cells[:signal.size - lag], cells[lag:], bins=bins, range=[[-0.5, bins - 0.5]] * 2)[0]
        share = joint / joint.sum()
        apart = share.sum(axis=1)[:, None] * share.sum(axis=0)[None, :]
        full = share > 0
        information.append(float(np.sum(share[full] * np.log2(share[full] / apart[full]))))
    return np.array(information)


def first_minimum(values: np.ndarray) -> int | None:
    """Place of the first interior minimum; None where there is none."""
    inside = np.flatnonzero((values[1:-1] < values[:-2]) & (values[1:-1] <= values[2:]))
    return int(inside[0]) + 1 if inside.size else None
