"""The records of a blind campaign: cut by the MuJoCo engine and measured with nuisances nobody tells."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from testbed.engines import mujoco_engine
from testbed.files.campaign import Record
from tests.support.synthetic_campaign import synthetic_record
from tests.validation.blind.draw import Truth

FAR = 5e-3  # m, beyond which no flexure moves: the law that was drawn lets the machine run away
LEAST = 0.9  # of a record's length, that is left where the run did not diverge


def records_of(truth: Truth, catalogue: Mapping) -> list[Record]:
    """Every test as a record. ValueError where one diverged or ran away."""

    def simulate(model, cut, sampling):
        return mujoco_engine.simulate(model, cut, sampling, catalogue=catalogue)

    found = []
    for number, (rpm, depth, feed) in enumerate(truth.tests):
        record = _measured(simulate, truth, rpm, depth * 1e-3, feed, 1000 * truth.seed + number)
        motion = record.recording.channels["displacement"]
        if not np.isfinite(motion).all() or len(motion) < LEAST * _whole(truth, rpm):
            raise ValueError("a test diverged")
        if np.abs(motion).max() > FAR:
            raise ValueError("a test ran away")
        if not truth.tachometer:
            record = replace(record, recording=replace(record.recording, marks=np.empty(0)))
        found.append(replace(record, name=f"{number + 1}_{record.name}"))
    return found


def _whole(truth: Truth, rpm: float) -> float:
    """Samples of a record to its end."""
    return sum(truth.setting.course) * 60.0 / rpm * truth.setting.rate


def _measured(simulate: Callable, truth: Truth, rpm: float, depth: float, feed: float, seed: int) -> Record:
    """One test (depth m, feed m a tooth) as the campaign's setting has it measured."""
    setting, random = truth.setting, np.random.default_rng([seed, 1])
    phase, omega = random.uniform(0, 2 * math.pi), truth.model.structure.natural_frequency_rad
    return synthetic_record(simulate, truth.model, rpm, depth, seed, noise=truth.noise, rate=setting.rate,
                            speed_error=setting.speed_error, feed=feed, course=setting.course, mark_angle=setting.mark_angle,
                            state=(setting.ringing * math.cos(phase), setting.ringing * omega * math.sin(phase)))
