"""What shifts a record in time is asked in full where another of its kind explains most and not all."""

import numpy as np
import pytest

from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.candidate_round import LEADERS
from tests.support.short_round import fitted, round_of

# costs after the first step, in that of the base fit: the droop's is the least telling of all
FIRST = {"speed_variation": 0.6, "entry_ramp": 0.7, "edge_force": 0.75, "helix": 0.8, "chip_force_exponent": 0.85,
         "speed_droop": 0.97}


@pytest.fixture(scope="module")
def base():
    """A model without a force that is there, fitted to one cut."""
    return fitted()


def _round(base, full, monkeypatch):
    """Candidates of a round whose full fits leave these shares of the cost, by effect; and the effects that were fitted."""
    found, goals = round_of(base, FIRST, full, monkeypatch)
    return found, list(goals)


def test_a_droop_that_no_first_step_showed_is_fitted_where_a_swing_leaves_more_than_noise(base, monkeypatch):
    assert base.error_held_out > 2.0 * np.sqrt(0.4) * base.errors[0].noise_floor
    found, asked = _round(base, {"speed_variation": 0.4, "speed_droop": 0.2}, monkeypatch)
    assert "speed_droop" in asked[LEADERS:] and found[0].effects == ("speed_droop",)
    assert len({one.effects for one in found}) == len(found) == len(FIRST)


def test_a_droop_is_not_fitted_where_a_force_explains_most(base, monkeypatch):
    found, asked = _round(base, {"edge_force": 0.3}, monkeypatch)
    assert found[0].effects == ("edge_force",) and "speed_droop" not in asked
    assert {one.effects: not isinstance(one, Candidate) for one in found}["speed_droop",]


def test_a_droop_is_not_fitted_where_a_swing_explains_everything(base, monkeypatch):
    found, asked = _round(base, {"speed_variation": 1e-6}, monkeypatch)
    assert found[0].effects == ("speed_variation",) and "speed_droop" not in asked
