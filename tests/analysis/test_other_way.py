"""A sensor that counts the other way, and a direction of milling written down wrong, are told from missing effects."""

from dataclasses import replace
from functools import lru_cache, partial

import pytest

from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.diagnose import diagnose
from testbed.analysis.search.other_way import _ways, other_way_note
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

KNOWN = catalogue()
PLANT = plant_of(KNOWN)
DOWN_MILLED = replace(TRUE, cutting=replace(TRUE.cutting, direction="down-milling"))


def cuts(true, sign=1.0):
    """Three short cuts."""
    records = synthetic_campaign(partial(fast.simulate, steps=37), true, seed=7, course=(8, 20, 8), rate=6400.0)[:3]
    return [replace(one, data=sign * one.data) for one in (observe(record, BELIEVED) for record in records)]


@lru_cache
def told(true, sign=1.0):
    """Error over noise floor of the comparison with the believed model, and what is noted."""
    found = compare(PLANT, cuts(true, sign), BELIEVED, KNOWN)
    return found.error / found.noise_floor, other_way_note(
        PLANT, cuts(true, sign), BELIEVED, KNOWN, found.error, found.noise_floor)


@pytest.mark.long
def test_a_motion_turned_round_is_said():
    left, note = told(TRUE, -1.0)
    assert left > 3.0 and len(note) == 1 and "scale: -1" in note[0]


@pytest.mark.long
def test_a_direction_written_down_wrong_is_said():
    left, note = told(DOWN_MILLED)
    assert left > 3.0 and len(note) == 1 and note[0].startswith("as down-milling the error is ")


@pytest.mark.long
def test_a_missing_effect_is_no_turned_sign_and_a_complete_model_is_not_asked():
    left, note = told(TRUE.with_effect("edge_force", tangential=2e4, normal=2e4))
    assert left > 3.0 and note == []
    left, note = told(TRUE)
    assert left < 1.1 and note == []


@pytest.mark.long
def test_it_is_told_before_any_effect_is_tried():
    found = diagnose(PLANT, cuts(DOWN_MILLED), BELIEVED, KNOWN)
    assert found.verdict == "unexplained" and found.effects == () and found.candidates == ()
    assert "as down-milling: the model says up-milling" in found.sentence
    assert found.baseline > 3.0 * found.noise_floor


def test_a_slot_has_no_direction():
    slot = replace(BELIEVED, cutting=replace(BELIEVED.cutting, immersion=0.5))
    assert [way.turned for way in _ways(cuts(TRUE), slot)] == ["with the sign of the motion turned"]
