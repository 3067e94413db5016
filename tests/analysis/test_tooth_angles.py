"""Records without a tachometer at slow spindles: a kick a swing of the structure too early explains nearly as much."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.own_course import ANGLES, angles_tried, own_course
from testbed.analysis.fit.pass_search import settle_passes
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_record

TESTS = ((640, 0.25), (745, 0.3), (910, 0.25), (1060, 0.3))  # rpm, mm: 8 to 14 swings between two teeth


@pytest.fixture(scope="module")
def records():
    found = []
    for number, (rpm, depth) in enumerate(TESTS):
        record = synthetic_record(partial(fast.simulate, steps=37), TRUE, rpm, depth * 1e-3, 80 + number, noise=1e-7,
                                  rate=6400.0, course=(3, 12, 3))
        found.append(observe(replace(record, recording=replace(record.recording, marks=np.empty(0))), BELIEVED))
    return found


@pytest.fixture(scope="module")
def fitted(records):
    return model_fit(plant_of(catalogue()), records, BELIEVED, catalogue())


def test_each_angle_is_found_among_its_swings(fitted):
    _, fit = fitted
    assert fit.mean_squares.max() < 1.1
    errors = np.sqrt(np.diag(fit.covariance))
    for name, error in zip(fit.names, errors, strict=True):
        assert abs(fit.state.model.value(name) - TRUE.value(name)) < 4.0 * error


def test_a_record_a_swing_off_is_put_right(fitted):
    fitter, fit = fitted
    swing = 2 * math.pi / (fitter.records[1].period * TRUE.structure.natural_frequency)
    own = fit.state.nuisances[1]
    for turns in (1.0, -1.0):
        off = fit.state.with_record(1, replace(own, angle=own.angle + turns * swing))
        assert fitter.cost(off, [1]) > 2.0 * fitter.cost(fit.state, [1])
        moved, _ = settle_passes(fitter, off, places=[1])
        assert fitter.cost(moved, [1]) < 1.05 * fitter.cost(fit.state, [1])
    third = fit.state.with_record(1, replace(own, angle=own.angle + 3.3 * swing)).of_records([1])
    found = own_course(fitter, 1, third)
    assert fitter.of_records([1]).cost(found) < 1.05 * fitter.cost(fit.state, [1])


def test_as_many_angles_are_tried_as_swings_ask_for(records):
    assert angles_tried(records[0], BELIEVED) == math.ceil(4 * BELIEVED.structure.natural_frequency * records[0].period)
    fast_one = replace(records[0], period=records[0].period / 10.0)
    assert angles_tried(fast_one, BELIEVED) == ANGLES
    stiff = BELIEVED.with_values({"natural_frequency": 1e5})
    assert angles_tried(records[0], stiff) == 160
