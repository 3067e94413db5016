"""A spindle whose speed varies, with a tachometer that shows it: an effect that a model at a constant speed lacks."""

from functools import partial

import numpy as np
import pytest

from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.spindle_speed import at_modelled_speed, speed_swing
from testbed.analysis.records.spindle_clock import along_marks
from testbed.analysis.search.add_effect import add_effect
from testbed.analysis.search.diagnose import diagnose
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

KNOWN = {name: catalogue()[name] for name in ("speed_variation", "edge_force", "process_damping")}
PLANT = plant_of(catalogue())
TESTS = ((3810, 2.9), (2850, 2.5), (3500, 0.8))
AMPLITUDE, FREQUENCY = 0.004, 2.95


@pytest.fixture(scope="module")
def observed():
    true = TRUE.with_effect("speed_variation", amplitude=AMPLITUDE, frequency=FREQUENCY, phase=0.4)
    records = synthetic_campaign(partial(fast.simulate, steps=37), true, seed=4, tests=TESTS, course=(10, 40, 10), rate=6400.0)
    return [observe(record, BELIEVED) for record in records]


def test_a_varying_speed_is_named_although_the_tachometer_shows_it(observed):
    assert all(record.marks is not None for record in observed)
    assert speed_swing(observed) == pytest.approx(AMPLITUDE, rel=0.05)
    found = diagnose(PLANT, observed, BELIEVED, KNOWN)
    assert (found.verdict, found.effects) == ("missing_effect", ("speed_variation",))
    assert "tachometer, too, shows a speed that varies by 0.4" in found.sentence
    assert found.baseline > 3.0 * found.noise_floor and found.with_effects < 1.03 * found.noise_floor


@pytest.mark.long
def test_without_such_an_effect_the_speed_is_the_one_measured(observed):
    found = compare(PLANT, observed, BELIEVED, catalogue())
    constant = compare(PLANT, [record.at_constant_speed() for record in observed], BELIEVED, catalogue())
    assert found.error < 1.4 * found.noise_floor  # within a tooth pass the measured speed is taken as constant
    assert constant.error > 3.0 * found.error
    told = diagnose(PLANT, observed, BELIEVED, {"edge_force": KNOWN["edge_force"]})
    assert told.baseline == pytest.approx(found.error, rel=0.05) and "is the tachometer's" in told.sentence


def test_a_model_that_rules_the_speed_is_not_told_it_twice(observed):
    added = add_effect(PLANT, observed, BELIEVED, KNOWN["speed_variation"], catalogue())
    assert added.parameters["speed_variation.amplitude"].value == pytest.approx(AMPLITUDE, rel=0.02)
    assert added.parameters["speed_variation.frequency"].value == pytest.approx(FREQUENCY, rel=0.01)
    assert added.before > 3.0 * added.after
    told = at_modelled_speed(observed, added.model.effects, catalogue())
    assert all(record.marks is None for record in told)
    assert at_modelled_speed(observed, (), catalogue()) == observed


def test_between_marks_the_time_follows_a_spline():
    def true(turn):
        return 0.3 + 0.016 * turn + 6e-4 * np.sin(2 * np.pi * turn / 15)

    marks, turn = true(np.arange(60.0)), np.linspace(3.0, 56.0, 400)
    assert np.abs(along_marks(marks, turn, 0.016) - true(turn)).max() < 1e-6
    assert np.abs(np.interp(turn, np.arange(60.0), marks) - true(turn)).max() > 1e-5
    beyond = along_marks(marks, np.array([-2.0, 61.0]), 0.016)
    assert beyond == pytest.approx([marks[0] - 0.032, marks[-1] + 0.032])
