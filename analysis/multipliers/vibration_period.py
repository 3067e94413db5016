"""The tooth passing period of a cut without a tachometer, from its vibration: the delay at which the motion strobes still.

Sampled at a wrong delay, the forced vibration creeps through its pattern and passes for slow modes; one part in a thousand
is enough. The period is searched at which one pair of modes, about a pattern that recurs with every revolution, leaves least
of the once-a-period samples. More modes would take the creeping of a wrong delay for their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from testbed.analysis.multipliers.floquet import once_per_period_samples
from testbed.analysis.multipliers.multiplier_fit import delay_embedding_multipliers, mode_basis
from testbed.analysis.records.lines import comb_speed
from testbed.analysis.records.passing_speed import heard_speed
from testbed.recording import Recording

DELAYS = 64  # phases a period: the slope of a pattern is seen by few
SKIPPED = 2  # periods after the entry: fast modes live there, and the entry is known to a part of one
MOST, FEWEST = 60, 8  # periods looked at; and the fewest, beside one for each tooth
DIRECTIONS = 16  # of the samples that can hold modes; the rest is noise alone
BLOCKS = (1, 2, 3)  # periods stacked in the embeddings that a pair starts from
TRIALS = 30  # of a pair
NEAR = 0.02  # of the stated period, that is searched about it
CLOSE = 0.005  # of the period, that is searched about one which the spectrum shows outside of that
FINER = 0.15  # of a pass over the whole cut, that is searched about the one which the harmonics show
STEP = 0.02  # of a period, by which the last one looked at moves from trial to trial
FINE_STEP = 0.005  # the same about what the harmonics show: a vibration that hardly dies strobes still in a narrow valley
FINE = 1e-3  # of that step: where the search stops
CERTAIN = 6.0  # standard errors of a misfit that it must fall by: at another delay the samples' noise is another, too


def vibration_period(recording: Recording, stated: float, flutes: int, start: float, stop: float,
                     channel: str = "displacement") -> float:
    """Tooth passing period (s) of the cut from `start` to `stop` (s), near the `stated` one (s).

    The stated one where the vibration does not tell, or where the cut is too short. Where the harmonics of the tooth passing
    stand out, that period is only made finer here.
    """
    time, values = recording.time, recording.channels[channel]
    idle = values[time < start]
    start += SKIPPED * stated
    inside, nominal = values[(time >= start) & (time < stop)], 2.0 * math.pi / (flutes * stated)
    speed = heard_speed(inside, recording.sampling_rate, nominal, flutes, idle=idle)
    heard = None if speed is None else nominal / speed
    seen = heard or _by_its_lines(inside, idle, recording.sampling_rate, nominal, flutes)
    count = min(MOST, int((stop - start) / (stated * max(1.0, seen) * (1.0 + 2.0 * NEAR))))  # the same at every trial
    if count < FEWEST + flutes:
        return (heard or 1.0) * stated

    def misfit(scale: float) -> float:
        samples = once_per_period_samples(recording, scale * stated, start, stop, DELAYS, channel)
        return _least_misfit(samples[:count], flutes)

    if heard is not None:
        step = FINE_STEP / count
        near = _trials(heard, FINER * stated / (stop - start), step)
        found, _ = _least(misfit, near, step)
        return (found if near[0] < found < near[-1] else heard) * stated
    step = STEP / count
    trials = [_trials(1.0, NEAR, step)]
    if abs(seen - 1.0) > NEAR:
        trials.append(_trials(seen, CLOSE, step))
    found, left = _least(misfit, np.concatenate(trials), step)
    chance = left * math.sqrt(2.0 / (count * DELAYS))
    return found * stated if misfit(1.0) - left > CERTAIN * chance else stated


def _least_misfit(samples: np.ndarray, flutes: int) -> float:
    """Sum of squares that a pattern of every tooth and one pair of modes leave of samples (periods, delays)."""
    periods = samples.shape[0]
    pattern = np.kron(np.ones(-(-periods // flutes)), np.eye(flutes)).T[:periods]
    pattern /= np.linalg.norm(pattern, axis=0)
    rest = samples - pattern @ (pattern.T @ samples)
    values, right = np.linalg.svd(rest, full_matrices=False)[1:]
    data = rest @ right[:DIRECTIONS].T

    def left(pair: np.ndarray) -> np.ndarray:
        modes = mode_basis(np.clip(pair, -5.0, 5.0), 2, periods)[:, 1:]
        modes = np.linalg.qr(modes - pattern @ (pattern.T @ modes))[0]
        return (data - modes @ (modes.T @ data)).ravel()

    def fitted(blocks: int) -> float:
        start = delay_embedding_multipliers(data, 2, blocks)
        return 2.0 * float(least_squares(left, [start.sum().real, start.prod().real], max_nfev=TRIALS).cost)

    return min(map(fitted, BLOCKS)) + float(np.sum(values[DIRECTIONS:] ** 2))


def _trials(centre: float, reach: float, step: float) -> np.ndarray:
    return centre + step * np.arange(-math.ceil(reach / step), math.ceil(reach / step) + 1)


def _least(misfit: Callable[[float], float], trials: np.ndarray, step: float) -> tuple[float, float]:
    """(place, value) of the least misfit among the trials and between the neighbours of the best."""
    best = float(trials[int(np.argmin([misfit(float(one)) for one in trials]))])
    found = minimize_scalar(misfit, bounds=(best - step, best + step), method="bounded", options={"xatol": FINE * step})
    return float(found.x), float(found.fun)


def _by_its_lines(values: np.ndarray, idle: np.ndarray, rate: float, nominal: float, flutes: int) -> float:
    """The period over the stated one as spectral lines show it; 1 where they do not."""
    comb = comb_speed(values, rate, nominal, flutes, idle=idle)
    return 1.0 if comb is None else nominal / comb.spindle_speed
