"""What a cut did, read from its once-per-tooth samples as in the paper's experiments, without any model.

The displacement is looked at once a tooth; in another channel of motion or force, where a sample may fall on a jump, the
part of PHASES samples a tooth that changes most from tooth to tooth. Two windows of up to 60 teeth, the last and the one
before, are compared:

- stable: the samples have settled, to within four times the noise or 2 % of how far they swung before; or their
  spread has at least halved from window to window;
- flip: every other sample agrees, to a third of the step between neighbours (period two);
- neimark_sacker: in the plane of neighbouring samples (y_n, y_n+1), made round by their covariance, they lie on a
  closed curve about the middle (none closer than 0.4 of the mean radius), each turned by much the same angle
  against the one before;
- undecided: none of these; or a step, or a curve, that is a tenth smaller than it was and may be dying; or fewer than
  40 teeth.

Source: B. P. Mann and K. A. Young (2006), Proc. R. Soc. A 462, 2145-2160, section 4; the numbers are choices.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from testbed.analysis.multipliers.floquet import once_per_period_samples, tooth_period
from testbed.recording import Recording

Observed = Literal["stable", "flip", "neimark_sacker", "undecided"]
WINDOW, LEAST = 60, 20  # teeth
PHASES = 24  # samples a tooth
SETTLED, NOISES = 0.02, 4.0
HALVED, KEPT = 0.5, 0.9
ALTERNATES = 1.0 / 3.0
HOLLOW, EVEN_TURNS = 0.4, 0.7


@dataclass(frozen=True)
class SampleVerdict:
    """What the samples show, why in words, and the numbers: spread (m, rms of the last window about its mean),
    alternation (m, mean step between odd and even samples), rotation (rad a tooth, NaN where there is no curve)."""

    outcome: Observed
    reason: str
    spread: float
    alternation: float
    rotation: float


def once_per_tooth_samples(recording: Recording, flutes: int = 1, channel: str = "displacement") -> np.ndarray:
    """One sample a tooth from the first tachometer mark in the cut on, by the marks' own period; shape (teeth,).

    The cut is that of the conditions `entry_time` and `exit_time`, or the whole recording. ValueError for fewer than
    three marks.
    """
    period = tooth_period(recording, flutes)
    begin = float(recording.conditions.get("entry_time", recording.start))
    end = float(recording.conditions.get("exit_time", recording.start + len(recording) / recording.sampling_rate))
    first = float(recording.marks[recording.marks >= begin][0])
    return once_per_period_samples(recording, period, first, end, 1, channel)[:, 0]


def changing_part(recording: Recording, flutes: int, channel: str) -> np.ndarray:
    """One number a tooth (teeth,), in the channel's unit, with the noise of one sample: the first principal component of
    PHASES samples a tooth over the cut, whose cut is as in `once_per_tooth_samples`."""
    period = tooth_period(recording, flutes)
    begin, end = (float(recording.conditions[name]) for name in ("entry_time", "exit_time"))
    rows = once_per_period_samples(recording, period, begin, end, PHASES, channel)
    late = rows[-min(WINDOW, len(rows)) :]
    calm = np.argsort(late.std(axis=0))[: PHASES // 2]  # a sample beside a jump scatters by when it was taken
    rows, late = rows[:, calm], late[:, calm]
    direction = np.linalg.svd(late - late.mean(axis=0), full_matrices=False)[2][0]
    return np.asarray(rows @ direction)


def simulated_verdict(samples: np.ndarray, noise: float = 0.0) -> SampleVerdict:
    """The verdict on once-per-tooth samples (teeth,), entry first, with white noise of that rms (the samples' unit)."""
    samples = np.asarray(samples, float)
    nothing = math.nan
    if samples.size < 2 * LEAST or not np.all(np.isfinite(samples)):
        return SampleVerdict("undecided", f"{np.count_nonzero(np.isfinite(samples))} samples are too few",
                             nothing, nothing, nothing)
    length = min(WINDOW, samples.size // 2) // 2 * 2
    late, before = samples[-length:], samples[-2 * length:-length]
    spread, earlier = float(late.std()), float(before.std())
    even, odd = late[::2], late[1::2]
    step, step_before = (abs(float(part[::2].mean() - part[1::2].mean())) for part in (late, before))
    floor = max(NOISES * noise, SETTLED * float(samples.std()), 1e-9 * float(np.abs(samples).max()))
    if spread <= floor:
        return SampleVerdict("stable", "settles to one value", spread, step, nothing)
    if spread < HALVED * earlier:
        return SampleVerdict("stable", f"dies, to {spread / earlier:.2f} in {length} teeth", spread, step, nothing)
    if max(even.std(), odd.std()) < ALTERNATES * step and step >= KEPT * step_before:
        return SampleVerdict("flip", "alternates between two values", spread, step, math.pi)
    hollow, even_turns, rotation = _curve(late)
    if hollow >= HOLLOW and even_turns >= EVEN_TURNS and spread >= KEPT * earlier:
        return SampleVerdict("neimark_sacker", "runs round a closed curve", spread, step, rotation)
    return SampleVerdict("undecided", "neither settles, alternates nor runs round a closed curve", spread, step,
                         rotation)


def _curve(samples: np.ndarray) -> tuple[float, float, float]:
    """Least radius over the mean one, evenness of the turns (1: all alike, 0: at random), and the turn itself (rad)."""
    pairs = np.column_stack([samples[:-1], samples[1:]])
    pairs = pairs - 0.5 * (pairs.max(axis=0) + pairs.min(axis=0))
    values, vectors = np.linalg.eigh(np.cov(pairs.T))
    if values[0] <= 1e-12 * values[1]:
        return 0.0, 0.0, math.nan  # on a line: no area for a curve to go round
    plane = pairs @ vectors / np.sqrt(values)
    point = plane[:, 0] + 1j * plane[:, 1]
    radius = np.abs(point)
    turns = np.angle(point[1:] / point[:-1])
    mean = np.mean(np.exp(1j * turns))
    return float(radius.min() / radius.mean()), float(np.abs(mean)), float(abs(np.angle(mean)))
