"""The believed model refitted to campaigns whose entries, exits, angles and speeds nobody tells."""

from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.fit.fit_state import Jacobian
from testbed.analysis.fit.least_squares import covariance, too_slow
from testbed.analysis.fit.moves import every_move
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.pass_search import place_entries
from testbed.analysis.fit.solve import Goal, Move
from testbed.analysis.fit.starts import base_fit
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.validation.blind.draw import draw
from tests.validation.blind.make import records_of

KNOWN = catalogue()


def simulate(model, cut, sampling, catalogue):
    """The fast engine at a step of its own."""
    return fast.simulate(model, cut, sampling, steps=61, catalogue=catalogue)


def fitted(truth, monkeypatch):
    monkeypatch.setattr("tests.validation.blind.make.mujoco_engine.simulate", simulate)
    records = records_of(truth, KNOWN)
    observed = [observe(record, truth.believed) for record in records]
    fitter, fit = base_fit(predict, observed, truth.believed)
    rms = [float(np.sqrt(np.mean(rest**2))) for rest in fit.residuals]
    return observed, fit, rms


@pytest.mark.parametrize("seed", [2, 4, 35])
def test_a_complete_model_leaves_the_noise_and_its_intervals_hold_the_truth(seed, monkeypatch):
    truth = draw(seed, KNOWN, kind="none")
    _, fit, rms = fitted(truth, monkeypatch)
    assert max(rms) < 1.06, rms
    assert len({own.exit - own.entry for own in fit.state.nuisances}) == 1  # every cut had as many passes
    for place, name in enumerate(fit.names):
        true = 1.1 if name == "mark_angle" else truth.model.value(name)
        found = fit.state.angle if name == "mark_angle" else fit.state.model.value(name)
        assert abs(found - true) < 4.0 * np.sqrt(fit.covariance[place, place]), name


def test_without_marks_angle_and_speed_of_every_record_are_found(monkeypatch):
    truth = draw(13, KNOWN, kind="none")
    assert not truth.tachometer
    observed, fit, rms = fitted(truth, monkeypatch)
    assert max(rms) < 1.06, rms
    for record, own in zip(observed, fit.state.nuisances, strict=True):
        assert record.first_mark is None and abs(own.speed - 1.0) < 1e-3


@pytest.mark.long
def test_marks_of_an_uneven_spindle_carry_the_prediction(monkeypatch):
    """A spindle that slows under load, with a tachometer: its marks explain it, and no parameter bends."""
    truth = replace(draw(111, KNOWN, names=("speed_droop",)), tachometer=True)
    observed, fit, rms = fitted(truth, monkeypatch)
    assert all(record.marks is not None for record in observed)
    assert max(rms) < 1.04, rms
    assert fit.state.model.cutting.tangential_coefficient == pytest.approx(truth.model.cutting.tangential_coefficient, rel=0.02)


def test_an_unknown_that_a_records_own_make_up_for_has_a_large_variance_and_no_nan():
    """Rounding may leave less than nothing of its slopes, once what the record's own unknowns explain is taken away."""
    random = np.random.default_rng(0)
    negative = 0
    for _ in range(40):
        own = 1e9 * random.standard_normal((300, 2))
        shared = np.stack([own @ random.standard_normal(2), random.standard_normal(300)], axis=1)
        part = Jacobian(np.zeros(300), shared, own)
        cross = own.T @ shared
        negative += (shared.T @ shared - cross.T @ np.linalg.pinv(own.T @ own) @ cross)[0, 0] < 0.0
        variance = np.diag(covariance([part], np.ones(2)))
        assert np.isfinite(variance).all() and variance[1] == pytest.approx(1 / 300, rel=0.3)
    assert negative > 3


def test_a_combination_that_nothing_tells_is_unknown_however_strong_its_unknowns_are():
    """As offset and angle of a runout of two teeth; what has no part in it is told as well as ever."""
    random = np.random.default_rng(1)
    one, seen = 1e6 * random.standard_normal((2, 300))
    part = Jacobian(np.zeros(300), np.stack([one, 3.0 * one, seen], axis=1), np.empty((300, 0)))
    errors = np.sqrt(np.diag(covariance([part], np.ones(3))))
    assert errors[:2].min() > 1e6 and errors[2] == pytest.approx(1e-6 / np.sqrt(300), rel=0.2)


@pytest.mark.parametrize(("costs", "cost_limit", "given_up"), [
    ([100.0, 90.0, 80.0, 70.0, 60.0], 50.0, False),  # ten a step, thirty-six steps left
    ([100.0, 99.9, 99.8, 99.7, 99.6], 50.0, True),
    ([100.0, 99.9, 99.8, 99.7], 50.0, False),  # too early to say
    ([100.0, 60.0, 60.0, 60.0, 60.0], 50.0, False),  # a step that was not taken may be followed by a long one,
    ([100.0, 60.0, 60.0, 60.0, 60.0, 60.0], 50.0, True),  # so many in a row are not
    ([100.0, 99.9, 99.8, 99.7, 99.6], np.inf, False),
])
def test_a_descent_is_given_up_once_its_pace_would_not_lead_to_its_goal(costs, cost_limit, given_up):
    assert too_slow(costs, 40, cost_limit) is given_up


def test_a_descent_that_comes_to_its_goal_is_the_one_without(monkeypatch):
    truth = draw(13, KNOWN, kind="none")
    monkeypatch.setattr("tests.validation.blind.make.mujoco_engine.simulate", simulate)
    observed = [observe(record, truth.believed) for record in records_of(truth, KNOWN)[:3]]
    fitter, fit = base_fit(predict, observed, truth.believed)
    away = fit.state.with_value("natural_frequency", 1.0005 * fit.state.model.value("natural_frequency"))
    free, bound = fitter.descend(away), fitter.descend(away, cost_limit=2.0 * fit.cost)
    assert bound.cost == free.cost and bound.state == free.state and free.cost < 1.01 * fit.cost


@pytest.fixture(scope="module")
def plain():
    """Three cuts with nothing hidden and their fit."""
    truth = draw(13, KNOWN, kind="none")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tests.validation.blind.make.mujoco_engine.simulate", simulate)
        observed = [observe(record, truth.believed) for record in records_of(truth, KNOWN)[:3]]
    return observed, truth.believed, *base_fit(predict, observed, truth.believed)


@pytest.mark.parametrize(("factor", "followed"), [(1.0, False), (1.01, True), (0.99, True), (float("nan"), True)])
def test_a_fit_that_comes_to_the_cost_of_a_known_one_is_not_followed_further(plain, factor, followed, monkeypatch):
    observed, believed, _, fit = plain
    courses = []
    monkeypatch.setitem(every_move(), "pass_count", Move(lambda fitter, fit, goal: courses.append(fit) or ()))
    _, again = base_fit(predict, observed, believed, goal=Goal(known=factor * fit.cost))
    assert bool(courses) is followed and again.cost == pytest.approx(fit.cost, rel=1e-3)


def test_an_entry_is_put_at_the_best_of_all_places_and_only_in_the_records_asked(plain):
    _, _, fitter, fit = plain
    own = fit.state.nuisances
    moved = replace(fit.state, nuisances=tuple(replace(one, entry=one.entry - 7) for one in own))
    found = place_entries(fitter, moved, [0, 2])
    assert [one.entry for one in found.nuisances] == [own[0].entry, own[1].entry - 7, own[2].entry]
    assert place_entries(fitter, moved).nuisances[1].entry == own[1].entry
