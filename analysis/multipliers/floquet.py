"""Empirical characteristic multipliers of a measured transient (Mann and Young 2006, section 2).

The motion is sampled once a delay period at many phases, y_n(k) = x(t0 + (n + k/d) tau), where
y_{n+1} - y* = J (y_n - y*). Truncated singular vectors give first multipliers; a maximum likelihood fit of the modes
refines them and gives their covariance. Rules, each stated in the result:

- period: regression of the tachometer's marks; the unknown angle of the mark shifts all phases alike and drops out;
- rank: modes are added while each removes more of the misfit than noise would (by 7 standard deviations, for a mode
  is the best of many);
- first period: moved on while the first period used is fitted worse than the others (fast modes still alive);
- last period: before the residual grows (contact lost, or a motion too large to be linear);
- belief: a multiplier must not move when the first period, the number of periods or the rank is changed; one that
  does is left out, and if it is the strongest mode nothing is believed. What goes on beside the cut (hum, drift, a
  pattern that unequal teeth repeat once a revolution) and harmonics of stronger modes are no multipliers of a cut.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from testbed.analysis.information import Z_95
from testbed.analysis.multipliers.belief import foreign_modes, held_modes, mode_columns, mode_strength, significant, verdict
from testbed.analysis.multipliers.multiplier_fit import MultiplierFit, best_fit, delay_embedding_multipliers, fit_multipliers
from testbed.analysis.records.spindle_clock import turns_of
from testbed.recording import Recording

__all__ = ["EmpiricalMultipliers", "TooFewPeriods", "delay_embedding_multipliers", "empirical_multipliers",
           "once_per_period_samples", "revolution_period", "tooth_period"]

_MOST_PERIODS, _LEAST_PERIODS, _MOST_RANK, _MOST_SKIPPED = 60, 6, 5, 4
_SPLINE_POWER = 0.87  # white noise left by cubic spline interpolation, mean over positions between samples
RICH, RICHER = 4, 6  # modes of a fit that tells where the linear record ends, and of one asked where that is
SOON = 12  # periods
_DRIFT_PERIODS = 12  # in fewer periods a drift cannot be told from a slow mode


class TooFewPeriods(ValueError):
    """A cut too short for any multiplier."""


@dataclass(frozen=True)
class EmpiricalMultipliers:
    """Multipliers found in one transient.

    multipliers (rank,) complex, largest first; covariance (2 rank, 2 rank) of [real parts, imaginary parts];
    modulus_low, modulus_high: 95 % interval of |mu| of each; noise (the channel's unit): rms of the residual;
    fixed_point (delays,): the periodic motion; samples (periods, delays); period s; first: delay periods left out
    after the start; drift per period; believed: whether the largest may be used, and the reason in words.
    """

    multipliers: np.ndarray
    covariance: np.ndarray
    modulus_low: np.ndarray
    modulus_high: np.ndarray
    noise: float
    fixed_point: np.ndarray
    samples: np.ndarray
    period: float
    first: int
    drift: float
    believed: bool
    reason: str

    @classmethod
    def none(cls, period: float, reason: str) -> EmpiricalMultipliers:
        """No multipliers, and in words why."""
        empty = np.zeros(0)
        return cls(empty.astype(complex), np.zeros((0, 0)), empty, empty, math.nan, empty, np.zeros((0, 0)), period, 0, 0.0,
                   False, reason)

    @property
    def rank(self) -> int:
        """Number of multipliers."""
        return self.multipliers.size

    @property
    def periods(self) -> int:
        """Number of delay periods used."""
        return self.samples.shape[0]

    @property
    def standard_errors(self) -> np.ndarray:
        """Root of the summed variances of real and imaginary part, (rank,)."""
        variance = np.diag(self.covariance)
        return np.sqrt(variance[:self.rank] + variance[self.rank:])


def revolution_period(marks: np.ndarray) -> float:
    """Spindle period (s) by regression of the times (s) of at least three marks; missing marks are allowed for."""
    marks = np.asarray(marks, float)
    if marks.size < 3:
        raise ValueError("at least three tachometer marks are needed for the period")
    return float(np.polyfit(turns_of(marks), marks, 1)[0])


def tooth_period(recording: Recording, flutes: int = 1) -> float:
    """Tooth passing period (s) from the recording's marks."""
    return revolution_period(recording.marks) / flutes


def passing_period(recording: Recording, spindle_speed: float, flutes: int) -> float:
    """Tooth passing period (s) from the recording's marks, or at the stated speed (rad/s) where they are too few."""
    return tooth_period(recording, flutes) if recording.marks.size >= 3 else 2.0 * math.pi / (flutes * spindle_speed)


def once_per_period_samples(recording: Recording, period: float, start: float, stop: float, delays: int,
                            channel: str = "displacement") -> np.ndarray:
    """x(start + (n + k / delays) period) for all whole periods up to `stop` (s), shape (periods, delays).

    By cubic spline: strobing the nearest sample instead adds multipliers near 1 in modulus that do not exist.
    """
    # at the record's very end the spline has no neighbours beyond and its error is several times larger
    stop = min(stop, recording.start + (len(recording) - 4) / recording.sampling_rate)
    periods = int(math.floor((stop - start) / period * (1 + 1e-9)))
    if periods < 1 or start < recording.start:
        return np.empty((0, delays))
    times = start + (np.arange(periods)[:, None] + np.arange(delays) / delays) * period
    return CubicSpline(recording.time, recording.channels[channel])(times)


def _bounds(recording: Recording, start: float | None, stop: float | None) -> tuple[float, float]:
    known = recording.conditions
    last = recording.start + len(recording) / recording.sampling_rate
    return (float(known.get("entry_time", recording.start)) if start is None else start,
            float(known.get("exit_time", last)) if stop is None else stop)


def _select_rank(samples: np.ndarray, drift: bool) -> MultiplierFit:
    """The smallest rank that neither one nor two more modes improve on significantly."""
    most = min(_MOST_RANK, samples.shape[0] - 5)
    fits: dict[int, MultiplierFit] = {}

    def fit(rank: int) -> MultiplierFit:
        if rank not in fits:
            fits[rank] = best_fit(samples, rank, drift)
        return fits[rank]

    rank = 0
    while rank < most:
        better = [more for more in (rank + 1, rank + 2)
                  if more <= most and significant(fit(rank).misfit - fit(more).misfit, fit(more).noise, more - rank,
                                                   samples.shape[1])]
        if not better:
            break
        rank = better[0]
    return fit(rank)


def _usable_periods(samples: np.ndarray, drift: bool) -> int:
    """Periods before the residual of a rich fit grows: contact loss and large motion end the linear record.

    Where that seems to be soon, a richer one is asked: hum, or a pattern that goes on, takes two modes for itself.
    """
    usable = _linear_periods(samples, drift, RICH)
    return usable if usable >= SOON else max(usable, _linear_periods(samples, drift, RICHER))


def _linear_periods(samples: np.ndarray, drift: bool, rank: int) -> int:
    total = min(samples.shape[0], _MOST_PERIODS)
    floor = 1e-3 * float(np.sqrt(np.mean((samples[:_LEAST_PERIODS] - samples[:_LEAST_PERIODS].mean(axis=0)) ** 2)))
    lengths = sorted({min(total, int(_LEAST_PERIODS * 1.15**k)) for k in range(18)} | {total})
    quietest, usable = math.inf, min(total, _LEAST_PERIODS)
    for length in lengths:
        if length < _LEAST_PERIODS:
            continue
        fit = best_fit(samples[:length], min(rank, length - 4), drift and length >= _DRIFT_PERIODS)
        certain = 5.0 / math.sqrt(2.0 * samples.shape[1] * max(1, length - 5))
        late = fit.rows[-3:].max() > (1.3 + certain) * max(float(np.median(fit.rows)), floor)
        if length > 8 and fit.noise > (1.1 + certain) * max(quietest, floor) or (late and length > 8):
            break
        quietest, usable = min(quietest, fit.noise), length
    return usable


def empirical_multipliers(recording: Recording, *, flutes: int = 1, period: float | None = None,
                          start: float | None = None, stop: float | None = None, delays: int | None = None,
                          channel: str = "displacement", drift: bool = True, bootstrap: int = 0,
                          seed: int = 0) -> EmpiricalMultipliers:
    """Multipliers of the entry transient in `recording`.

    period: delay (s), by default from the marks; start, stop (s): the cut, by default the recording's conditions
    `entry_time` and `exit_time`, or all of it. delays: phases per period; by default as many as there are samples (the
    more, the better: 32 double the error). drift: allow for a slow drift of the sensor. bootstrap: replicates of a
    parametric bootstrap for the covariance instead of its linearisation, seeded. The covariance is widened by what a
    later first period changes. Raises TooFewPeriods, a ValueError, when fewer than 6 periods are in the cut.
    """
    period = tooth_period(recording, flutes) if period is None else period
    start, stop = _bounds(recording, start, stop)
    count = max(4, int(round(recording.sampling_rate * period))) if delays is None else delays
    whole = once_per_period_samples(recording, period, start, stop, count, channel)
    if whole.shape[0] < _LEAST_PERIODS:
        raise TooFewPeriods(f"{whole.shape[0]} tooth periods in the cut; at least {_LEAST_PERIODS} are needed")
    usable = whole[:_usable_periods(whole, drift)]
    fit, first = None, 0
    for first in range(_MOST_SKIPPED + 1):
        samples = usable[first:]
        if samples.shape[0] < _LEAST_PERIODS and fit is not None:
            break
        sloped = drift and samples.shape[0] >= _DRIFT_PERIODS
        fit = _select_rank(samples, sloped)
        rest = np.sqrt(np.mean(fit.rows[2:] ** 2))
        if fit.rows[0] <= rest * (1.0 + 4.0 / math.sqrt(2.0 * count)):
            break
    assert fit is not None
    covariance = _bootstrap(samples, fit, sloped, bootstrap, seed) if bootstrap and fit.rank else fit.covariance
    strength = mode_strength(samples, fit) if fit.rank else np.zeros(0)
    foreign = foreign_modes(fit.multipliers, strength, flutes)
    held, why, shift = held_modes(samples, fit, sloped, strength, foreign) if fit.rank else \
        (np.zeros(0, bool), {}, np.zeros(0))
    # resampling by spline takes power from the noise, but not where the slow motion of the modes lies
    dense = count > 0.7 * recording.sampling_rate * period
    covariance = covariance / (_SPLINE_POWER if dense else 1.0) + np.diag(shift**2)
    believed, reason = verdict(fit, strength, held, why, foreign)
    kept = np.nonzero(held)[0] if believed else np.arange(fit.rank)
    both = np.concatenate([kept, kept + fit.rank])
    values, covariance = fit.multipliers[kept], covariance[np.ix_(both, both)]
    low, high = _modulus_interval(values, covariance)
    return EmpiricalMultipliers(values, covariance, low, high, fit.noise, _fixed_point(samples, fit), samples,
                                period, first, fit.drift, believed, reason)


def _fixed_point(samples: np.ndarray, fit: MultiplierFit) -> np.ndarray:
    rows = samples - fit.drift * np.arange(samples.shape[0])[:, None]
    return np.linalg.lstsq(mode_columns(fit, samples.shape[0]), rows.astype(complex), rcond=None)[0][0].real


def _modulus_interval(multipliers: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    modulus, rank = np.abs(multipliers), multipliers.size
    spread = np.zeros(rank)
    for i in range(rank):
        part = covariance[np.ix_([i, i + rank], [i, i + rank])]
        towards = np.array([multipliers[i].real, multipliers[i].imag]) / max(modulus[i], 1e-12)
        spread[i] = math.sqrt(max(towards @ part @ towards, 0.0))
    return modulus - Z_95 * spread, modulus + Z_95 * spread


def _bootstrap(samples: np.ndarray, fit: MultiplierFit, drift: bool, count: int, seed: int) -> np.ndarray:
    """Covariance over refits of the fitted motion with fresh noise of the residual's size."""
    columns = mode_columns(fit, samples.shape[0])
    ramp = fit.drift * np.arange(samples.shape[0])[:, None]
    motion = (columns @ np.linalg.lstsq(columns, (samples - ramp).astype(complex), rcond=None)[0]).real + ramp
    random = np.random.default_rng(seed)
    draws = np.empty((count, 2 * fit.rank))
    for i in range(count):
        again = fit_multipliers(motion + fit.noise * random.standard_normal(motion.shape), fit.multipliers, drift)
        rest, matched = list(again.multipliers), []
        for mu in fit.multipliers:
            matched.append(rest.pop(int(np.argmin(np.abs(np.array(rest) - mu)))))
        draws[i] = np.concatenate([np.real(matched), np.imag(matched)])
    deviation = draws - np.concatenate([fit.multipliers.real, fit.multipliers.imag])
    return deviation.T @ deviation / count
