"""Which modes of a multiplier fit may be believed, and in words why the others may not.

Never take the largest |mu| unchecked: a mode must be needed to explain the samples, be determined by them, and stay
where it is when the first period, the number of periods or the rank is changed.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Collection, Mapping

import numpy as np

from testbed.analysis.multipliers.multiplier_fit import MultiplierFit, best_fit, fit_multipliers

LINE = 3e-3  # distance from modulus 1 within which a mode neither dies nor grows,
UNEQUAL = 1.5e-2  # from a root of 1 of the number of teeth, within which it recurs once a revolution,
SLOW = 0.97  # and real modulus from which it creeps: no transient of a cut does
STRONGER = 3.0  # times as strong are modes whose products,
HARMONIC = 0.01  # within this distance, a mode is


def significant(removed: float, noise: float, modes: int, delays: int) -> bool:
    """Whether added modes remove more misfit than noise would: each is worth one number per phase, best of many."""
    freedom = modes * (delays + 1)
    return removed > (freedom + 7.0 * math.sqrt(2.0 * freedom)) * max(noise, 1e-300) ** 2


def mode_columns(fit: MultiplierFit, periods: int) -> np.ndarray:
    """1 and the powers of the multipliers, complex (periods, 1 + rank)."""
    powers = fit.multipliers[None, :] ** np.arange(periods)[:, None]
    return np.hstack([np.ones((periods, 1)), powers])


def mode_strength(samples: np.ndarray, fit: MultiplierFit) -> np.ndarray:
    """Norm of each mode's share of the samples, (rank,)."""
    columns = mode_columns(fit, samples.shape[0])
    rows = samples - fit.drift * np.arange(samples.shape[0])[:, None]
    shapes = np.linalg.lstsq(columns, rows.astype(complex), rcond=None)[0][1:]
    return np.linalg.norm(shapes, axis=1) * np.linalg.norm(columns[:, 1:], axis=0)


def _needed(samples: np.ndarray, fit: MultiplierFit) -> np.ndarray:
    """Whether the misfit grows by more than noise would make it when one mode (with its conjugate) is left out."""
    columns = mode_columns(fit, samples.shape[0])
    rows = (samples - fit.drift * np.arange(samples.shape[0])[:, None]).astype(complex)
    needed = np.ones(fit.rank, dtype=bool)
    for i, mu in enumerate(fit.multipliers):
        without = [0, *(1 + k for k in range(fit.rank) if k != i and abs(fit.multipliers[k] - np.conj(mu)) > 1e-12)]
        left = rows - columns[:, without] @ np.linalg.lstsq(columns[:, without], rows, rcond=None)[0]
        needed[i] = significant(float(np.sum(np.abs(left) ** 2)) - fit.misfit, fit.noise,
                                 columns.shape[1] - len(without), samples.shape[1])
    return needed


def foreign_modes(multipliers: np.ndarray, strength: np.ndarray, flutes: int) -> dict[int, str]:
    """Modes that are not the linear machine's: what goes on beside the cut, and harmonics; what each is, in words."""
    found = {}
    once = [cmath.exp(2j * math.pi * k / flutes) for k in range(1, flutes)]
    for i, mu in enumerate(multipliers):
        strong = multipliers[strength > STRONGER * strength[i]]
        if any(abs(mu - one * other) < HARMONIC for one in strong for other in strong):
            found[i] = "a harmonic of stronger modes: the motion, or the sensor, is not linear"
        elif any(abs(mu - root) < UNEQUAL for root in once):
            found[i] = "recurs once a revolution: unequal teeth, no transient"
        elif abs(mu.imag) < 1e-9 and SLOW < mu.real < 1.0 + LINE:
            found[i] = "a slow drift, no transient"
        elif abs(abs(mu) - 1.0) < LINE:
            found[i] = "neither dies nor grows: a line that goes on beside the cut (hum, another machine), no transient"
    return found


def held_modes(samples: np.ndarray, fit: MultiplierFit, drift: bool, strength: np.ndarray, foreign: Mapping[int, str],
               ) -> tuple[np.ndarray, dict[int, str], np.ndarray]:
    """Which modes but `foreign` ones hold when first period, number of periods or rank are changed, why the others do
    not, and how far each moves with a later first period (real and imaginary parts, (2 rank,))."""
    errors, why, shift, needed = fit.standard_errors, {}, np.zeros(2 * fit.rank), _needed(samples, fit)
    strongest = np.abs(fit.multipliers[0]) if fit.rank else 0.0
    alive = samples.shape[0]
    if 0.0 < strongest < 0.999 and fit.noise > 0:
        size = float(np.max(np.abs(samples[0] - samples[-1])))
        alive = int(math.log(max(size / (2.0 * fit.noise), 2.0)) / -math.log(strongest))
    fewer = max(fit.rank + 4, int(0.75 * min(alive, samples.shape[0])))
    trials = [("a later first period", samples[1:]), ("fewer periods", samples[:fewer])]
    others = [(name, fit_multipliers(part, fit.multipliers, drift)) for name, part in trials
              if part.shape[0] >= fit.rank + 3]
    if samples.shape[0] >= fit.rank + 6:
        others.append(("one more mode", best_fit(samples, fit.rank + 1, drift)))
    for i, mu in enumerate(fit.multipliers):
        if len(others) < 3:
            why[i] = f"{samples.shape[0]} linear periods are too few to check it"
        elif not needed[i]:
            why[i] = "removes no more of the misfit than noise would"
        elif abs(mu) > 1.3 and strength[i] < strength.max():
            why[i] = "a weak mode seen in the last two periods only"
        elif errors[i] > 0.1:
            why[i] = f"standard error {errors[i]:.2f}"
        for name, other in others:
            match = int(np.argmin(np.abs(other.multipliers - mu)))
            moved = float(np.abs(other.multipliers[match] - mu))
            if name == "a later first period":
                shift[[i, i + fit.rank]] = moved / math.sqrt(2.0)
            allowed = max(0.02, min(3.0 * math.hypot(errors[i], other.standard_errors[match]), 9.0 * errors[i], 0.1))
            if moved > allowed and i not in why:
                why[i] = f"moves by {moved:.3f} with {name} (allowed {allowed:.3f})"
    why |= foreign
    conjugate = [int(np.argmin(np.abs(fit.multipliers - np.conj(mu)))) for mu in fit.multipliers]
    held = np.array([i not in why and conjugate[i] not in why for i in range(fit.rank)], dtype=bool)
    return held, why, shift


def verdict(fit: MultiplierFit, strength: np.ndarray, held: np.ndarray, why: dict[int, str],
            foreign: Collection[int]) -> tuple[bool, str]:
    """Whether the strongest mode but for `foreign` ones is among those held, and the reason in words."""
    if fit.rank == 0:
        return False, "no motion above the noise"
    # two modes that nearly coincide are each huge and cancel: neither is determined, neither can lead
    leads = [i not in foreign and fit.standard_errors[i] < 1.0 for i in range(fit.rank)]
    dominant = int(np.argmax(np.where(leads, strength, 0.0)))
    if not held[dominant]:
        return False, f"the strongest mode {fit.multipliers[dominant]:.3f}: {why.get(dominant, 'its conjugate fails')}"
    dropped = [f"{fit.multipliers[i]:.3f} ({reason})" for i, reason in why.items() if fit.multipliers[i].imag >= 0]
    base = "holds against first period, number of periods and rank"
    return True, f"{base}; left out: {', '.join(dropped)}" if dropped else base
