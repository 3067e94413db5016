"""The records of a blind campaign: cut by the MuJoCo engine and measured with nuisances nobody tells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbed.campaign import Record
from testbed.engines import mujoco_engine
from tests.synthetic_campaign import synthetic_record
from tests.validation.blind.draw import Truth

FAR = 5e-3  # m, beyond which no flexure moves: the law that was drawn lets the machine run away


def records_of(truth: Truth, catalogue: Mapping) -> list[Record]:
    """Every test as a record. ValueError where one diverged or ran away."""

    def simulate(model, cut, sampling):
        return mujoco_engine.simulate(model, cut, sampling, catalogue=catalogue)

    found = []
    for number, (rpm, depth, feed) in enumerate(truth.tests):
        record = synthetic_record(simulate, truth.model, rpm, depth * 1e-3, 1000 * truth.seed + number, noise=truth.noise,
                                  feed=feed)
        if not np.isfinite(record.recording.channels["displacement"]).all() or len(record.recording) < 5000:
            raise ValueError("a test diverged")
        if np.abs(record.recording.channels["displacement"]).max() > FAR:
            raise ValueError("a test ran away")
        if not truth.tachometer:
            record = replace(record, recording=replace(record.recording, marks=np.empty(0)))
        found.append(replace(record, name=f"{number + 1}_{record.name}"))
    return found
