"""Laws with kinks: finer steps for the last fit, and intervals that hold what other scales explain as well."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.fit import scale_profile
from testbed.analysis.fit.effect_start import effect_parameters, far_step
from testbed.analysis.fit.estimates import estimates
from testbed.analysis.fit.fine_steps import fine, finely, has_kinks, times_finer
from testbed.analysis.fit.free_parameters import free_parameters
from testbed.analysis.fit.held_out import RecordError, pooled_doubt
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.pass_search import begun_otherwise
from testbed.analysis.fit.scale_profile import ALIKE, SAME, along_scales
from testbed.analysis.fit.solve import Goal, solve
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.candidate import Tried
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.diagnosis import verdict_of
from testbed.analysis.search.refit_from_prior import refit_from_prior
from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling
from testbed.engines import fast, predict
from testbed.workshop import RPM
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

ENGINE = SimpleNamespace(predict_cuts=predict.predict_cuts, predict_driven=predict.predict_driven)
RUBBING = TRUE.with_effect("dry_friction", force=1.0, presliding_displacement=2e-7)


@pytest.fixture(scope="module")
def rubbing():
    """Two cuts with dry friction by an engine with fine steps, fitted from the truth with steps as the engine chooses."""
    simulate = partial(fast.simulate, steps=400)
    records = synthetic_campaign(simulate, RUBBING, seed=2, noise=5e-7, tests=((3500, 0.8), (2600, 1.5)))
    observed = [observe(record, BELIEVED) for record in records]
    fitter, fit = base_fit(ENGINE, observed, RUBBING, free=[])
    free = [*free_parameters(observed, RUBBING), *effect_parameters(catalogue()["dry_friction"], observed)]
    wider = Fitter(ENGINE, observed, free)
    return wider, wider.fit(fit.state, iterations=15)


def test_finer_steps_predict_a_law_with_a_kink_closer():
    cut = Cut(3500 * RPM, 0.8e-3, 1e-4, 15, 40, 30)
    sampling = Sampling(12800.0, 12000)
    true = fast.simulate(RUBBING, cut, sampling, steps=3200).channels["displacement"]
    coarse, finer, finest = (one.predict_cuts([RUBBING], [cut], [sampling], ("displacement",))[0, 0]
                             for one in (ENGINE, fine(ENGINE, 2), fine(ENGINE)))
    assert np.std(finest - true) < 0.15 * np.std(coarse - true)
    assert np.std(finer - true) < 0.4 * np.std(coarse - true)


def test_steps_are_less_fine_where_flights_are_exact():
    known = catalogue()
    assert times_finer(["dry_friction"], known) == times_finer(["dry_friction", "edge_force", "runout"], known) == 2
    for others in (["cubic_stiffness"], ["speed_droop"], ["contact_loss"]):
        assert times_finer(["dry_friction", *others], known) == 4, others
    assert times_finer(["contact_loss"], known) == 4


def test_from_far_only_a_law_with_a_kink_is_given_up_before_its_last_step(rubbing, monkeypatch):
    """What shifts the record in time is slow at first: a drooping speed reached the noise from where it had been given up."""
    fitter, fit = rubbing
    goals = []
    descend = Fitter.descend

    def noted(*given, **more):
        goals.append(more.get("cost_limit"))
        return descend(*given, **more)

    monkeypatch.setattr(Fitter, "descend", noted)
    for name in ("sensor_lag", "quadratic_damping"):
        far_step(fitter, catalogue()[name], fit, 0.1)
    assert goals == [None, 0.1]


def test_the_last_fit_is_no_worse_with_finer_steps(rubbing):
    fitter, coarse = rubbing
    finer, settled = finely(fitter, coarse, {})
    assert settled.cost <= finer.cost(coarse.state)
    place = settled.names.index("natural_frequency")
    error = settled.covariance[place, place] ** 0.5
    assert abs(settled.state.model.structure.natural_frequency - TRUE.structure.natural_frequency) < 4 * error


def test_a_cut_bent_by_what_the_base_model_lacked_is_looked_for_anew_from_what_is_believed_of_it(rubbing):
    fitter, right = rubbing
    model, cutting = right.state.model, right.state.model.cutting
    wrong = model.with_values({"tangential_coefficient": 1.5 * cutting.tangential_coefficient,
                               "normal_coefficient": -4.0 * cutting.normal_coefficient})
    bent = fitter.fit(replace(right.state, model=wrong, angle=right.state.angle + 0.3), iterations=15)
    assert bent.cost > 1.01 * right.cost  # on its way back, and slow
    named = candidate_of(fitter, bent, ("dry_friction",), None, 1.0)
    said = []
    found = refit_from_prior(named, BELIEVED, catalogue(), named.error_held_out / 1.2, said.append)
    assert found.fit.cost < 1.02 * right.cost and found.fit.state.angle == pytest.approx(right.state.angle, abs=2e-3)
    assert said == ["fitting dry_friction anew with the cutting coefficients as believed"]
    clean = candidate_of(fitter, right, ("dry_friction",), None, 1.0)
    assert refit_from_prior(clean, BELIEVED, catalogue(), clean.error_held_out, pytest.fail) is clean


def test_a_scale_that_other_values_explain_as_well_has_an_interval_that_holds_them(rubbing, monkeypatch):
    monkeypatch.setattr(scale_profile, "FURTHEST", 2)
    fitter, fit = rubbing
    path, known = "dry_friction.presliding_displacement", catalogue()
    found = along_scales(fitter, [known["dry_friction"]], fit)
    assert found.cost <= fit.cost and found.alike
    for state in found.alike:
        assert fitter.cost(state) <= found.cost + max(1.1 * ALIKE, SAME * found.cost)
        assert state.model.value(path) != found.state.model.value(path)
    one = estimates(fitter, found, known)[path]
    assert all(one.low < state.model.value(path) < one.high for state in found.alike)
    alone = estimates(fitter, replace(found, alike=()), known)[path]
    assert one.high - one.low > alone.high - alone.low


def test_no_interval_reaches_beyond_what_is_possible(rubbing):
    fitter, fit = rubbing
    blurred = estimates(fitter, replace(fit, covariance=1e12 * fit.covariance), catalogue())
    for one in fitter.free:
        assert one.bounds[0] <= blurred[one.path].low <= blurred[one.path].value <= blurred[one.path].high <= one.bounds[1]
    assert blurred["natural_frequency"].low > 0.0 and blurred["damping_ratio"].high < 1.0


def test_a_start_that_only_a_model_without_friction_needed_is_given_up(rubbing):
    fitter, fit = rubbing
    shaken = [replace(one, displacement=-6e-5, velocity=0.06) for one in fit.state.nuisances]
    state = replace(fit.state, nuisances=tuple(shaken))
    found, moved = begun_otherwise(fitter, state)
    assert fitter.cost(state) > 1.05 * fit.cost
    assert moved and fitter.cost(found) < 1.001 * fit.cost
    assert begun_otherwise(fitter, fit.state)[0].nuisances[0].displacement in (0.0, fit.state.nuisances[0].displacement)


def test_in_another_valley_the_exits_are_looked_for_anew(rubbing):
    fitter, fit = rubbing
    true = [one.exit for one in fit.state.nuisances]
    early = tuple(replace(one, exit=one.exit - away) for one, away in zip(fit.state.nuisances, (20, 0), strict=True))
    model = fit.state.model.with_values({"dry_friction.presliding_displacement": 8e-7})
    astray = fitter.fit(replace(fit.state, model=model, nuisances=early), iterations=8)
    assert astray.cost > 1.5 * fit.cost
    _, found = solve(fitter, astray, ("basin_hopping",), Goal((catalogue()["dry_friction"],)))
    assert [one.exit for one in found.state.nuisances] == true
    assert found.cost < 1.05 * fit.cost


def test_a_model_with_friction_is_fitted_from_far_as_well_as_from_the_truth(rubbing):
    """From a friction a third of the true one that breaks away four times as late: no descent from there finds the scale."""
    fitter, fit = rubbing
    believed = BELIEVED.with_effect("dry_friction", force=0.3, presliding_displacement=8e-7)
    _, found = model_fit(ENGINE, fitter.records, believed, catalogue())
    assert found.cost < 1.02 * fit.cost
    assert found.state.model.value("dry_friction.force") == pytest.approx(1.0, rel=0.02)


def test_records_begun_with_a_vibration_are_begun_again_at_rest(rubbing):
    fitter, fit = rubbing
    shaken = tuple(replace(one, displacement=-6e-5, velocity=0.06) for one in fit.state.nuisances)
    astray = fitter.fit(replace(fit.state, nuisances=shaken), iterations=2)
    assert 0.9 * astray.cost > 1.05 * fit.cost > solve(fitter, astray, ("other_beginnings",))[1].cost
    assert solve(fitter, fit, ("other_beginnings",))[1].cost <= fit.cost


def test_slopes_lent_from_near_by_lead_to_the_same_place(rubbing):
    fitter, fit = rubbing
    value = 1.01 * fit.state.model.value("tangential_coefficient")
    moved = replace(fit.state, model=fit.state.model.with_values({"tangential_coefficient": value}))
    assert fitter.cost(moved) > fit.cost + 10.0
    lent = fitter.descend(moved, near=fit)
    assert lent.cost == pytest.approx(fitter.descend(moved).cost, rel=1e-4)
    assert lent.cost == pytest.approx(fitter.cost(lent.state))
    own = fitter.descend(moved, iterations=0)
    assert own.anew and own.state is moved
    again = fitter.fit(moved, near=own, iterations=0)
    assert again.parts is own.parts


def test_a_law_without_kinks_is_left_as_it_is(rubbing):
    fitter, fit = rubbing
    assert along_scales(fitter, [catalogue()["speed_droop"]], fit) is fit


def test_kinks_are_told_by_the_catalogue():
    known = catalogue()
    assert has_kinks(["runout", "dry_friction"], known) and not has_kinks(["runout", "helix"], known)


def _error(doubt):
    return RecordError("one", 0.107, 0.1, np.zeros(1), 1.145, 100.0, 1.0, doubt)


@pytest.mark.parametrize(("doubt", "verdict"), [(0.0, "unexplained"), (0.02, "adequate")])
def test_a_noise_floor_of_few_samples_widens_the_verdict(doubt, verdict):
    base = Tried((), {}, 0.107, 0.107, 0.0, True, errors=(_error(doubt),))
    assert verdict_of(base, base, [base], (), 0.1, ()).verdict == verdict


def test_the_doubt_of_many_records_is_less_than_that_of_one():
    assert pooled_doubt([_error(0.02)]) == pytest.approx(0.02)
    assert pooled_doubt([_error(0.02)] * 4) == pytest.approx(0.01)
    assert pooled_doubt([replace(_error(0.02), noise_squares=0.0), _error(0.0)]) == 0.0
