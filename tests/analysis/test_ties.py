"""Two candidates that explain as much: told as tied where they explain it, and tried for each other where more was found."""

from functools import partial
from types import SimpleNamespace

import pytest

from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.candidate import Candidate, Tried
from testbed.analysis.search.diagnosis import verdict_of
from testbed.analysis.search.refit_from_prior import from_believed
from testbed.analysis.search.swap import exchanged
from testbed.analysis.search.ties import with_rivals
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign
from tests.validation.hard_pairs import DEEP, SMALL_LAG, Case, cuts, part_of, told

KNOWN = catalogue()
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=KNOWN),
                        predict_driven=partial(predict.predict_driven, catalogue=KNOWN))


def candidate(effects, error):
    return Tried(effects, {}, error, error, 50.0, True)


@pytest.mark.parametrize(("baseline", "left", "verdict"), [
    (3.0, 1.03, "undecided"),
    (3.0, 2.6, "unexplained"),  # neither explains much: that they are alike is no answer
])
def test_a_tie_is_an_answer_only_where_it_explains_the_records(baseline, left, verdict):
    base, best = candidate((), baseline), candidate(("helix",), left)
    found = verdict_of(base, best, [base, best], (), 1.0, ("helix", "sensor_lag"))
    assert found.verdict == verdict
    assert found.effects == (("helix", "sensor_lag") if verdict == "undecided" else ())


def test_what_a_tie_stands_beside_is_told():
    base, best = candidate((), 3.0), candidate(("helix", "runout"), 1.01)
    found = verdict_of(base, best, [base, best], (), 1.0, ("helix", "sensor_lag"))
    assert found.verdict == "undecided" and "each beside runout" in found.sentence


def test_records_of_noise_alone_tell_nothing():
    base = candidate((), 1.001)
    assert verdict_of(base, base, [base], (), 0.99, ()).verdict == "undecided"
    assert verdict_of(base, base, [base], (), 0.9, ()).verdict != "undecided"


@pytest.fixture(scope="module")
def observed():
    true = TRUE.with_effect("process_damping", coefficient=2e5).with_effect("edge_force", tangential=9e3, normal=12e3)
    records = synthetic_campaign(partial(fast.simulate, steps=37), true, seed=6, course=(10, 30, 15), rate=6400.0)
    return [observe(record, BELIEVED) for record in records[:4]]


@pytest.mark.long
def test_a_rival_that_does_better_with_what_was_found_since_takes_the_place_of_the_first(observed):
    def fitted(*names):
        return from_believed(ENGINE, observed, BELIEVED, names, KNOWN)

    base, wrong, rival = fitted(), fitted("chip_force_exponent"), fitted("process_damping")
    noise = pooled(base.errors)[1]
    found = fitted("chip_force_exponent", "edge_force")
    assert found.error_held_out > 1.1 * noise
    better, tied = with_rivals(found, [wrong, rival], base, noise, KNOWN, lambda text: None)
    assert set(better.effects) == {"process_damping", "edge_force"} and tied == ()
    assert better.error_held_out < 1.05 * noise
    kept, tied = with_rivals(better, [rival, wrong], base, noise, KNOWN, lambda text: None)
    assert kept is better and tied == ()


@pytest.mark.long
def test_what_was_named_first_is_exchanged_for_one_of_its_kind_that_explains_more(observed):
    def fitted(*names):
        return from_believed(ENGINE, observed, BELIEVED, names, KNOWN)

    base, found = fitted(), fitted("chip_force_exponent", "edge_force")
    noise = pooled(base.errors)[1]
    better, tied = exchanged(found, base, BELIEVED, KNOWN, noise, lambda text: None)
    assert better.effects == ("process_damping", "edge_force") and tied == ()
    assert better.error_held_out < 1.05 * noise
    kept, tied = exchanged(better, base, BELIEVED, KNOWN, noise, lambda text: None)
    assert kept is better and tied == ()


@pytest.mark.parametrize(("hidden", "values"), [SMALL_LAG[:2], SMALL_LAG[2:]], ids=["helix", "sensor_lag"])
def test_what_the_largest_start_does_not_lead_to_is_a_rival_all_the_same(hidden, values):
    """A seventh of a second of one cut: eight iterations from the largest helix lead nowhere, from a smaller one they do."""
    records = part_of(cuts(DEEP, noise=0.7e-6), 1.0, 0.85)
    found = told(Case(("helix", "sensor_lag"), hidden, dict(values), records, False, ""))
    assert found.verdict == "undecided" and set(found.effects) == {"helix", "sensor_lag"}


def test_an_effect_takes_no_place_of_one_that_it_can_only_stand_beside():
    found, base = candidate(("second_mode", "chip_force_exponent"), 1.0), candidate((), 4.0)
    rivals = [candidate(("second_mode",), 1.6), candidate(("third_mode",), 1.6)]
    assert with_rivals(found, rivals, base, 1.0, KNOWN, pytest.fail) == (found, ())


def test_a_second_mode_is_not_exchanged_for_the_third_that_needs_it():
    names = ("second_mode", "chip_force_exponent")
    known = {name: KNOWN[name] for name in (*names, "third_mode")}
    model = SimpleNamespace(effects=dict.fromkeys(names))
    found = Candidate(names, {}, 1.0, 1.0, 50.0, True, fit=SimpleNamespace(state=SimpleNamespace(model=model)),
                      fitter=SimpleNamespace(records=()))  # fmt: skip
    assert exchanged(found, candidate((), 4.0), BELIEVED, known, 1.0, pytest.fail) == (found, ())
