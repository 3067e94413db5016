"""Which cut would tell two explanations apart: where their predictions differ most, in units of the noise.

Both models are predicted over a grid of speeds and depths around those measured, at which both are stable; what the unknown
mark angle, offset and drift could absorb of the difference is taken out of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbed.analysis.fit.drift import drift_basis
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.linear.planar_multipliers import cut_multipliers
from testbed.cut import Cut, Sampling
from testbed.machine import Model

SPEEDS, DEPTHS = 9, 5
WIDER = 0.25  # of the measured range, by which the search goes beyond it
STABLE = 0.95  # largest multiplier of a cut that is proposed
COURSE = (6, 40, 14)  # revolutions of idling, cutting, ringing down
TURN = 1e-3  # rad, for the slope by the mark angle;
SWING = 1e-7  # m, by the state before the entry;
SLIP = 1e-5  # of the speed, by that


@dataclass(frozen=True)
class NextTest:
    """A cut to make: spindle_speed (rad/s), depth (m), and the rms difference of the two predictions over the noise."""

    spindle_speed: float
    depth_of_cut: float
    difference: float


def next_test(engine: Engine, records: Sequence[Observed], first: Model, other: Model) -> NextTest | None:
    """The cut within reach that separates two fitted models best; None where no record is a cut or none is stable."""
    cuts = [record for record in records if record.cut is not None]
    if not cuts or first.cutting is None:
        return None
    like = max(cuts, key=lambda record: record.samples)
    found = [
        NextTest(speed, depth, _difference(engine, like, first, other, speed, depth))
        for speed, depth in _grid(cuts)
        if max(_largest(model, like, speed, depth) for model in (first, other)) < STABLE
    ]
    found = [one for one in found if math.isfinite(one.difference)]
    return max(found, key=lambda one: one.difference, default=None)


def _grid(cuts: Sequence[Observed]) -> list[tuple[float, float]]:
    """(rad/s, m) a little beyond what was measured."""
    speeds = np.array([2 * math.pi / record.period for record in cuts])
    depths = np.array([record.cut.axial_depth_of_cut for record in cuts if record.cut is not None])
    room = max(WIDER * float(np.ptp(speeds)), 0.1 * float(speeds.mean()))
    low, high = max(speeds.min() - room, 0.2 * speeds.min()), speeds.max() + room
    deepest = depths.max() * (1 + WIDER)
    places = np.linspace(deepest / DEPTHS, deepest, DEPTHS)
    return [(float(speed), float(depth)) for speed in np.linspace(low, high, SPEEDS) for depth in places]


def _largest(model: Model, like: Observed, speed: float, depth: float) -> float:
    """Modulus of the largest multiplier of the linear base model."""
    assert like.cut is not None
    cut = replace(like.cut, spindle_speed=speed, axial_depth_of_cut=depth)
    try:
        values, _, passes = cut_multipliers(model, cut)
        return float(np.abs(values).max()) ** (1.0 / passes)
    except (ValueError, ArithmeticError):
        return math.inf


def _difference(engine: Engine, like: Observed, first: Model, other: Model, speed: float, depth: float) -> float:
    """rms of the difference of two predictions over the noise, less what angle, offset and drift could absorb."""
    found = seen(engine, like, (first, other), speed, depth)
    if found is None:
        return math.nan
    _, scaled, unknown = found
    gap = without(scaled[1] - scaled[0], unknown[:1])
    return float(np.sqrt(np.mean(gap**2)))


def proposed(like: Observed, speed: float, depth: float) -> Cut:
    """The cut at a speed and depth, with all else as in a record."""
    assert like.cut is not None
    idle, turns, ringing = (part * like.flutes for part in COURSE)
    return Cut(speed, depth, like.cut.feed_per_tooth, idle, turns, ringing)


def seen(engine: Engine, like: Observed, models: Sequence[Model], speed: float, depth: float
         ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:  # fmt: skip
    """What a record's sensors would see of a cut by each of some models; None where a prediction diverged.

    Returned: channels as they are (models, channels, samples); the same over the noise, less offset and drift (models, values);
    slopes of those of the first model by what nobody knows of such a record (unknowns, values): first the angle of the mark,
    then the state before the entry and, without marks, the speed.
    """
    cut, late = proposed(like, speed, depth), TURN / speed
    count = int(sum(COURSE) * 2 * math.pi / speed * like.rate) - 2
    start, slipped = 0.5 / like.rate, replace(cut, spindle_speed=speed * (1.0 + SLIP))
    moved = replace(cut, initial_displacement=SWING), replace(cut, initial_velocity=SWING * like.main_frequency)
    cuts = [cut] * (len(models) + 1) + [*moved, *([slipped] if like.first_mark is None else [])]
    starts = [start] * len(models) + [start + late] + [start] * (len(cuts) - len(models) - 1)
    predicted = engine.predict_cuts([*models, *[models[0]] * (len(cuts) - len(models))], cuts,
                                   [Sampling(like.rate, count, one) for one in starts], like.channels)
    if not np.isfinite(predicted).all():
        return None
    basis = drift_basis(count)
    scaled = predicted / like.noise[:, None]
    scaled = (scaled - (scaled @ basis) @ basis.T).reshape(len(cuts), -1)
    return predicted[: len(models)], scaled[: len(models)], scaled[len(models) :] - scaled[0]


def without(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values (..., values) less what slopes (unknowns, values) can take of them."""
    size = np.sqrt(np.sum(known**2, axis=1))
    basis = np.linalg.qr((known[size > 0] / size[size > 0, None]).T)[0]
    return values - (values @ basis) @ basis.T
