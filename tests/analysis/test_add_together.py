"""Two effects added at once: what both do to the error, from the fit without either."""

from functools import partial

import pytest

from testbed.analysis.fit.observe import observe
from testbed.analysis.search.add_effect import add_effect, add_effects, as_json
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

KNOWN = catalogue()
PLANT = plant_of(KNOWN)
PAIR = ("edge_force", "quadratic_damping")
TRUTH = {"edge_force.tangential": 9e3, "edge_force.normal": 6e3, "quadratic_damping.coefficient": 60.0}


@pytest.fixture(scope="module")
def records():
    true = TRUE.with_effect("edge_force", tangential=9e3, normal=6e3).with_effect("quadratic_damping", coefficient=60.0)
    made = synthetic_campaign(partial(fast.simulate, steps=61), true, seed=3, noise=5e-7, rate=6400.0, course=(12, 45, 20),
                              tests=((3810, 2.9), (2850, 2.9), (3500, 0.8)))
    return [observe(one, BELIEVED) for one in made]


@pytest.fixture(scope="module")
def together(records):
    return add_effects(PLANT, records, BELIEVED, [KNOWN[name] for name in PAIR], KNOWN)


@pytest.mark.long
def test_the_error_falls_to_the_noise_and_every_parameter_is_found(together):
    assert together.before > 1.5 * together.noise_floor
    assert together.after == pytest.approx(together.noise_floor, rel=0.05)  # of three conditions
    assert set(together.model.effects) == set(PAIR) and not together.unheard
    for path, true in TRUTH.items():
        found = together.parameters[path]
        assert abs(found.value - true) < found.high - found.low, path


def test_it_is_told_from_the_fit_without_either(records, together):
    one = add_effect(PLANT, records, BELIEVED, KNOWN[PAIR[0]], KNOWN)
    assert together.before == pytest.approx(one.before, rel=1e-6) and together.after < 0.9 * one.after
    said = as_json(together)
    assert said["effect"] == "edge_force + quadratic_damping" and said["effects"] == list(PAIR)
    assert as_json(one)["effects"] == ["edge_force"]


def test_of_one_it_is_the_same(records):
    some = records[:1]
    alone = add_effects(PLANT, some, BELIEVED, [KNOWN["edge_force"]], KNOWN)
    assert as_json(alone) == as_json(add_effect(PLANT, some, BELIEVED, KNOWN["edge_force"], KNOWN))
