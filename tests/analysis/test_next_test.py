"""The cut that would tell two models apart."""

import math

import numpy as np
import pytest

from testbed.analysis.fit.observe import observe
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.temporal_elements import characteristic_multipliers
from testbed.analysis.search.next_test import STABLE, next_test
from testbed.cut import Cut
from testbed.engines import fast, predict
from tests.support.campaign_files import TRUE
from tests.support.synthetic_campaign import synthetic_campaign


@pytest.fixture(scope="module")
def records():
    made = synthetic_campaign(fast.simulate, TRUE, seed=3, tests=((3810, 1.5), (2850, 1.0)))
    return [observe(record, TRUE) for record in made]


def test_a_stable_cut_within_reach_is_proposed(records):
    found = next_test(predict, records, TRUE, TRUE.with_effect("process_damping", coefficient=1e5))
    assert found is not None and found.difference > 1.0
    cut = Cut(found.spindle_speed, found.depth_of_cut)
    assert np.abs(characteristic_multipliers(milling_equation(TRUE, cut), 10)).max() < STABLE + 0.01
    assert 2000 < found.spindle_speed * 30 / math.pi < 4700 and found.depth_of_cut <= 1.9e-3


def test_depth_tells_what_grows_with_depth(records):
    """Process damping grows with b / V, so the deepest stable cut tells it best; twice as much tells twice as well."""
    once = next_test(predict, records, TRUE, TRUE.with_effect("process_damping", coefficient=2e4))
    twice = next_test(predict, records, TRUE, TRUE.with_effect("process_damping", coefficient=4e4))
    assert once.depth_of_cut > 1.2e-3
    assert twice.difference == pytest.approx(2 * once.difference, rel=0.15)


def test_equal_models_differ_nowhere(records):
    assert next_test(predict, records, TRUE, TRUE).difference == pytest.approx(0.0, abs=1e-9)


def test_without_a_cut_there_is_none(records):
    assert next_test(predict, [], TRUE, TRUE) is None
