"""The cut to make next: what every cut is expected to tell, about parameters and about which explanation is right.

With a normal distribution of what is known, and a record that goes with it as its slopes say, a cut tells
1/2 log det(I + S S^T) of the parameters, S its slopes in units of the noise by steps of one standard deviation (Lindley 1956,
Ann. Math. Statist. 27, 986). Of which of several explanations is right it tells at least -sum w_i log sum w_j exp(-B_ij), B the
Bhattacharyya distance of what they foretell (Kolchinsky and Tracey 2017, Entropy 19, 361). Both are in nats.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.probable.chance import safe
from testbed.analysis.probable.draws import Known
from testbed.analysis.search.next_test import proposed, seen, without
from testbed.cut import Cut, Sampling
from testbed.machine import Model
from testbed.recording import motion_channel

STEP = 0.1  # standard deviations, for slopes
REACH = 2.0  # standard deviations that a vibration is expected to stay below
TELLS = 4.65  # standard errors apart: one record then names the wrong one of two in 1 of 100


@dataclass(frozen=True)
class Explanation:
    """One way in which the records may have come about: its name, what is then known; wider: times the noise that counts."""

    name: str
    known: Known
    wider: float = 1.0


@dataclass(frozen=True)
class Planned:
    """A cut: spindle_speed (rad/s), axial_depth_of_cut (m), time in the cut (min).

    information: expected, nats, of which `of_explanations` say which explanation is right. separates: names of those that it
    would tell from another. difference: between the two furthest apart, in standard errors. expects: by explanation and channel
    the peak to peak while it cuts. vibration: the same (m) of the displacement, where it is largest, as large as any
    explanation leaves open.
    """

    spindle_speed: float
    axial_depth_of_cut: float
    minutes: float
    information: float
    of_explanations: float
    stable_probability: float
    separates: tuple[str, ...]
    difference: float
    expects: Mapping[str, Mapping[str, float]]
    vibration: float

    @property
    def information_per_minute(self) -> float:
        """What the cuts are ranked by."""
        return self.information / self.minutes

    def as_json(self) -> dict[str, Any]:
        """Its row of the answer of `testbed plan --json`."""
        return vars(self) | {"information_per_minute": self.information_per_minute}


def safe_cuts(probability: np.ndarray, speeds: Iterable[float], depths: Iterable[float], draws: int, risk: float
              ) -> list[tuple[float, float, float]]:  # fmt: skip
    """Cuts (rad/s, m, chance of being stable) of a grid of chances (B, S) from so many draws that are safe at a risk."""
    enough = safe(probability, draws, risk)
    return [(float(speed), float(depth), float(probability[row, column])) for row, depth in enumerate(depths)
            for column, speed in enumerate(speeds) if depth > 0.0 and enough[row, column]]


def plan(engine: Engine, like: Observed, explanations: Sequence[Explanation], cuts: Sequence[tuple[float, float, float]],
         show: Callable[[int, int], None] = lambda done, total: None) -> list[Planned]:  # fmt: skip
    """All cuts, given as (rad/s, m, chance of being stable), by what they tell a minute; those of no prediction are left out.

    like: a record of a cut whose sensors, noise, feed and engagement the next one will have.
    """
    found = []
    for number, (speed, depth, stable) in enumerate(cuts):
        one = _told(engine, like, explanations, speed, depth, stable)
        found += [one] if one is not None else []
        show(number + 1, len(cuts))
    return sorted(found, key=lambda one: -one.information_per_minute)


def information(slopes: np.ndarray) -> float:
    """1/2 log det(I + S S^T), nats, of slopes (k, values) in units of the noise by steps of one standard deviation."""
    return 0.5 * float(np.linalg.slogdet(np.eye(len(slopes)) + slopes @ slopes.T)[1])


def _told(engine: Engine, like: Observed, explanations: Sequence[Explanation], speed: float, depth: float,
          stable: float) -> Planned | None:  # fmt: skip
    middles, slopes, expects, vibration = [], [], {}, 0.0
    cut = proposed(like, speed, depth)
    for one in explanations:
        steps = _steps(one.known)
        models = [one.known.model, *(one.known.at(one.known.middle + step) for step in steps)]
        looked = seen(engine, like, models, speed, depth)
        if looked is None:
            return None
        channels, scaled, unknown = looked
        middles.append((scaled[0] / one.wider, unknown))
        slopes.append(without(scaled[1:] - scaled[0], unknown) / (STEP * one.wider))
        idle, last = (round(passes * cut.tooth_passing_period(like.flutes) * like.rate)
                      for passes in (cut.idle_passes, cut.idle_passes + cut.passes))
        expects[one.name] = dict(zip(like.channels, np.ptp(channels[0][:, idle:last], axis=1).tolist(), strict=True))
        swings = _swings(engine, models, cut, Sampling(like.rate, last, 0.0))
        vibration = max(vibration, float(swings[0] + REACH * np.linalg.norm(swings[1:] - swings[0]) / STEP))
    apart = _apart(middles, slopes)
    weight = np.full(len(explanations), 1.0 / len(explanations))
    which = max(0.0, -float(weight @ np.log(np.exp(-(apart**2) / 8.0) @ weight)))
    told = float(weight @ np.array([information(one) for one in slopes])) + which
    names = tuple(one.name for one, far in zip(explanations, apart.max(axis=1), strict=True) if far >= TELLS)
    minutes = cut.passes * cut.tooth_passing_period(like.flutes) / 60.0
    return Planned(speed, depth, minutes, told, which, stable, names, float(apart.max()), expects, vibration)


def _swings(engine: Engine, models: Sequence[Model], cut: Cut, sampling: Sampling) -> np.ndarray:
    """Peak to peak (models,) of the displacement (m) up to the end of a cut, of what moves most."""
    channels = ["displacement"]
    if models[0].structure.planar:
        carriers = dict.fromkeys(mode.on for mode in models[0].structure.modes)
        channels = [motion_channel(f"displacement_{axis}", on) for on in carriers for axis in "xy"]
    moved = engine.predict_cuts(models, [cut] * len(models), [sampling] * len(models), channels)
    return np.ptp(moved, axis=2).max(axis=1)


def _steps(known: Known) -> np.ndarray:
    """Small steps along the axes of what is known, to the side on which a machine is."""
    steps = STEP * known.axes()
    inside = known.possible(known.middle + steps)
    return np.where(inside[:, None], steps, -steps)


def _apart(middles: Sequence[tuple[np.ndarray, np.ndarray]], slopes: Sequence[np.ndarray]) -> np.ndarray:
    """Distances (k, k) of what explanations foretell, in standard errors: less what nobody knows of the record could take, and
    with what is not known of either's parameters."""
    apart = np.zeros((len(middles),) * 2)
    for i, (one, unknown) in enumerate(middles):
        for j, (other, _) in enumerate(middles[:i]):
            gap = without(one - other, unknown)
            loose = np.vstack([slopes[i], slopes[j]]) / math.sqrt(2.0)
            taken = loose @ gap
            square = gap @ gap - taken @ np.linalg.solve(np.eye(len(loose)) + loose @ loose.T, taken)
            apart[i, j] = apart[j, i] = math.sqrt(max(float(square), 0.0))
    return apart
