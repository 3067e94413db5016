"""What shifts a record in time is asked in full where another of its kind explains most and not all."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from campaign_files import BELIEVED, TRUE
from synthetic_campaign import synthetic_campaign

from analysis.fit.observed import observe
from analysis.search import candidate_round as cr
from analysis.search.begun_anew import from_believed
from testbed.catalogue import catalogue
from testbed.cli._fitting import plant_of
from testbed.engines import fast

KNOWN = catalogue()
# costs after the first step, in that of the base fit: the droop's is the least telling of all
FIRST = {"speed_variation": 0.6, "entry_ramp": 0.7, "edge_force": 0.75, "helix": 0.8, "chip_force_exponent": 0.85,
         "speed_droop": 0.97}


@pytest.fixture(scope="module")
def base():
    """A model without a force that is there, fitted to one cut."""
    bent = TRUE.with_effect("edge_force", tangential=6e4, normal=3e4)
    records = synthetic_campaign(partial(fast.simulate, steps=61), bent, seed=4, rate=6400.0, tests=((3500, 1.2),))
    return from_believed(plant_of(KNOWN), [observe(one, BELIEVED) for one in records], BELIEVED, (), KNOWN)


def _round(base, full, monkeypatch):
    """Candidates of a round whose full fits leave these shares of the cost, by effect; and the effects that were fitted."""
    asked = []

    def refitted(current, entry, known, say, iterations=40, goal=np.inf):
        asked.append(entry.name)
        share = full.get(entry.name, 0.9)
        error, fit = current.error_held_out * share**0.5, replace(current.fit, cost=share * current.fit.cost)
        return replace(current, effects=(entry.name,), error_fit=error, error_held_out=error, fit=fit, errors=())

    monkeypatch.setattr(cr, "_first_steps", lambda current, *_, **__: [
        cr._Entry(name, share * current.fit.cost, current.fit.state, current.fitter) for name, share in FIRST.items()])
    monkeypatch.setattr(cr, "_refitted", refitted)
    monkeypatch.setattr(cr, "_try_from_far", lambda *_, **__: None)
    monkeypatch.setattr(cr, "_from_far", lambda *_, **__: None)
    monkeypatch.setattr(cr, "no_swing", lambda *_: False)
    return cr.try_candidates(base, KNOWN, [], lambda text: None), asked


def test_a_droop_that_no_first_step_showed_is_fitted_where_a_swing_leaves_more_than_noise(base, monkeypatch):
    assert base.error_held_out > 2.0 * np.sqrt(0.4) * base.errors[0].noise_floor
    found, asked = _round(base, {"speed_variation": 0.4, "speed_droop": 0.2}, monkeypatch)
    assert "speed_droop" in asked[cr.LEADERS:] and found[0].effects == ("speed_droop",)
    assert len({one.effects for one in found}) == len(found) == len(FIRST)


def test_a_droop_is_not_fitted_where_a_force_explains_most(base, monkeypatch):
    found, asked = _round(base, {"edge_force": 0.3}, monkeypatch)
    assert found[0].effects == ("edge_force",) and "speed_droop" not in asked
    assert {one.effects: one.fit is None for one in found}["speed_droop",]


def test_a_droop_is_not_fitted_where_a_swing_explains_everything(base, monkeypatch):
    found, asked = _round(base, {"speed_variation": 1e-6}, monkeypatch)
    assert found[0].effects == ("speed_variation",) and "speed_droop" not in asked
