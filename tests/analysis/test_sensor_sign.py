"""A sensor that counts the other way is told from a machine that lacks an effect."""

from dataclasses import replace
from functools import partial

from campaign_files import BELIEVED, TRUE
from synthetic_campaign import synthetic_campaign

from analysis.compare import compare
from analysis.observed import observe
from analysis.sensor_sign import sign_note
from testbed.catalogue import catalogue
from testbed.cli._fitting import plant_of
from testbed.engines import fast

KNOWN = catalogue()
PLANT = plant_of(KNOWN)


def told(true, sign):
    records = synthetic_campaign(partial(fast.simulate, steps=37), true, seed=7, course=(10, 30, 10))[:3]
    observed = [replace(one, data=sign * one.data) for one in (observe(record, BELIEVED) for record in records)]
    found = compare(PLANT, observed, BELIEVED, KNOWN)
    return found.error / found.noise_floor, sign_note(PLANT, observed, BELIEVED, KNOWN, found.error, found.noise_floor)


def test_a_motion_turned_round_is_said():
    left, note = told(TRUE, -1.0)
    assert left > 3.0 and len(note) == 1 and "scale: -1" in note[0]


def test_a_missing_effect_is_no_turned_sign_and_a_complete_model_is_not_asked():
    left, note = told(TRUE.with_effect("edge_force", tangential=2e4, normal=2e4), 1.0)
    assert left > 3.0 and note == []
    left, note = told(TRUE, 1.0)
    assert left < 1.1 and note == []
