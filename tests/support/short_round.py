"""A base fit to short cuts with something hidden, and a round of a diagnosis whose fits come to given costs."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from testbed.analysis.fit.observe import observe
from testbed.analysis.search import candidate_round as cr
from testbed.analysis.search.begun_anew import from_believed
from testbed.analysis.search.first_looks import Entry
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

KNOWN = catalogue()
BENT = {"edge_force": {"tangential": 6e4, "normal": 3e4}}


def quiet(text):
    """Nothing is told."""


def fitted(*names, tests=((3500, 1.2),), noise=1e-6, hidden: Mapping[str, Mapping[str, float]] = BENT):
    """The believed model with the effects of these names, fitted to cuts under those hidden."""
    true = TRUE
    for name, values in hidden.items():
        true = true.with_effect(name, **values)
    records = synthetic_campaign(partial(fast.simulate, steps=61), true, seed=4, rate=6400.0, tests=tests, noise=noise)
    return from_believed(plant_of(KNOWN), [observe(one, BELIEVED) for one in records], BELIEVED, names, KNOWN)


def round_of(base, first, full, monkeypatch, **asked):
    """(candidates, goals of the full fits in the order asked) of a round.

    first: costs after the first steps, in that of the base fit, by effect; full: of the full fits, 0.9 where none is given.
    asked: what the round may ask beside.
    """
    goals = {}

    def refitted(current, entry, known, say, iterations=40, goal=np.inf, **_):
        goals[entry.name] = goal
        share = full.get(entry.name, 0.9)
        error, fit = current.error_held_out * share**0.5, replace(current.fit, cost=share * current.fit.cost)
        return replace(current, effects=(entry.name,), error_fit=error, error_held_out=error, fit=fit, errors=())

    monkeypatch.setattr(cr, "first_steps", lambda current, *_, **__: [
        Entry(name, share * current.fit.cost, current.fit.state, current.fitter) for name, share in first.items()])
    monkeypatch.setattr(cr, "_refitted", refitted)
    monkeypatch.setattr(cr, "try_from_far", lambda *_, **__: None)
    monkeypatch.setattr(cr, "from_far", lambda *_, **__: None)
    monkeypatch.setattr(cr, "no_swing", lambda *_: False)
    return cr.try_candidates(base, KNOWN, [], quiet, **asked), goals
