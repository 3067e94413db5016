"""Does the diagnosis name what was hidden, and nothing where nothing was? The data come from another step size than the fit."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.fit.effect_start import all_free
from testbed.analysis.fit.fit_state import FreeParameter
from testbed.analysis.fit.free_parameters import at_a_bound
from testbed.analysis.fit.held_out import RecordError, pooled
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.answer import as_json
from testbed.analysis.search.candidate import Candidate, Tried
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.diagnose import diagnose
from testbed.analysis.search.diagnosis import never_nothing, told_of_base, verdict_of
from testbed.analysis.search.gates import below_a_guess, certain_ones, likeliest, vanishes, worth_naming
from testbed.analysis.search.refit_from_prior import refit_from_prior
from testbed.analysis.search.rules import rules_of
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.campaign_files import BELIEVED
from tests.support.synthetic_campaign import synthetic_campaign

TRUE = Model(Structure(2.573, 146.42, 0.0032), Cutter(), Cutting())
CANDIDATES = {name: catalogue()[name] for name in ("process_damping", "edge_force", "tool_wear")}
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=catalogue()),
                        predict_driven=partial(predict.predict_driven, catalogue=catalogue()))


def verdict(true):
    records = synthetic_campaign(partial(fast.simulate, steps=37), true, seed=4, rate=6400.0)
    return diagnose(ENGINE, [observe(record, BELIEVED) for record in records[:5]], BELIEVED, CANDIDATES)


def test_nothing_hidden_is_called_adequate():
    found = verdict(TRUE)
    assert found.verdict == "adequate" and found.effects == ()
    assert [one.met for one in rules_of(found) if not one.effects][:2] == [True, True]
    assert found.baseline == pytest.approx(found.noise_floor, rel=0.02)


def test_a_hidden_effect_is_named_and_its_strength_found():
    name, parameter, value = "process_damping", "coefficient", 2.0e5
    found = verdict(TRUE.with_effect(name, **{parameter: value}))
    assert found.verdict == "missing_effect" and found.effects == (name,)
    rules = rules_of(found)
    assert [one.met for one in rules if not one.effects] == [True, False, False]  # signal, and neither adequate nor nearly
    own = [one for one in rules if one.effects == (name,)]
    assert len(own) >= 4 and all(one.met for one in own)
    answer = as_json(found, BELIEVED)
    assert answer["error"]["baseline"] > 1.1 * answer["error"]["noise_floor"]
    assert answer["error"]["with_effects"] < 1.03 * answer["error"]["noise_floor"]
    best = next(one for one in answer["candidates"] if one["effects"] == [name])
    assert best["parameters"][f"{name}.{parameter}"] == pytest.approx(value, rel=0.03)


def test_an_effect_too_faint_for_the_error_is_named_where_many_samples_make_it_certain():
    name, value = "process_damping", 2.5e4
    found = verdict(TRUE.with_effect(name, coefficient=value))
    assert found.base.error_held_out < 1.02 * found.noise_floor
    assert found.verdict == "missing_effect" and found.effects == (name,) and "faint" in found.sentence
    assert found.best.parameters[f"{name}.coefficient"] == pytest.approx(value, rel=0.2)


def test_an_effect_led_astray_by_what_the_base_model_made_up_for_is_fitted_anew():
    """An immersion 45 % off: the base fit shifts angle and coefficients so far that no descent from there finds it."""
    name, known = "immersion_error", catalogue()
    records = synthetic_campaign(partial(fast.simulate, steps=37), TRUE.with_effect(name, error=0.45), seed=6,
                                 tests=((3500, 0.8), (2850, 2.9), (3900, 2.2)), course=(10, 30, 10), rate=6400.0)
    observed = [observe(record, BELIEVED) for record in records]
    _, base = base_fit(ENGINE, observed, BELIEVED)
    fitter = Fitter(ENGINE, observed, all_free(observed, BELIEVED.with_effect(name, error=0.1), known))
    fit = fitter.fit(replace(base.state, model=base.state.model.with_effect(name, error=0.1)))
    astray = candidate_of(fitter, fit, (name,), None, 1.0)
    noise = pooled(astray.errors)[1]
    assert astray.error_held_out > 5 * noise

    found = refit_from_prior(astray, BELIEVED, known, noise, lambda line: None)
    assert found.error_held_out < 1.05 * noise
    assert found.fit.state.model.value(f"{name}.error") == pytest.approx(0.45, abs=0.005)
    assert refit_from_prior(found, BELIEVED, known, found.error_held_out, pytest.fail) is found  # noise alone is left


@pytest.mark.parametrize(("names", "left", "verdict"), [
    (("edge_force", "helix"), 1.05, "missing_effect"),
    (("edge_force", "helix", "tool_wear"), 1.05, "unexplained"),  # as an unknown law, made up of what lies near it
    (("edge_force", "helix", "tool_wear"), 1.01, "missing_effect"),
])
def test_three_effects_are_missing_only_where_they_leave_nothing(names, left, verdict):
    base, best = (Tried(effects, {}, error, error, 0.0, True) for effects, error in (((), 3.0), (names, left)))
    found = verdict_of(base, best, [base, best], (), 1.0, ())
    assert found.verdict == verdict and found.effects == names


@pytest.mark.parametrize(("before", "first", "second", "worth"), [
    (9.0, 1.04, 1.025, False),  # the form of a strong law is not the same everywhere: another one may make up for a part,
    (9.0, 1.04, 1.005, True),  # but takes away what is left where it is the one that is missing
    (78.0, 1.113, 1.036, False),  # though not all of it where it makes up for the law's last per cent
    (1.5, 1.04, 1.025, True),  # of a weak first effect, the rest is no matter of its form
    (9.24, 1.52, 1.09, True),  # less is left than the share asked of the whole: most of it is enough,
    (9.24, 1.52, 1.30, False),  # half of it is not
])
def test_of_the_faint_rest_of_a_strong_effect_another_must_take_most(before, first, second, worth):
    base, current, other = (Tried(effects, {}, error, error, 75.0, True)
                            for effects, error in (((), before), (("edge_force",), first), (("edge_force", "helix"), second)))
    assert worth_naming(other, current, base, 1.0) is worth


@pytest.mark.parametrize(("names", "baseline", "left", "verdict"), [
    (("cubic_stiffness",), 100.0, 6.0, "missing_effect"),  # one law that takes nearly all of a real machine's misfit
    (("cubic_stiffness", "helix"), 100.0, 6.0, "unexplained"),  # of several that leave much, any law is soon made up
    (("cubic_stiffness", "helix"), 100.0, 1.12, "missing_effect"),
    (("cubic_stiffness",), 1.18, 1.09, "unexplained"),  # half of a little is no name for it
    (("cubic_stiffness",), 1.18, 1.03, "missing_effect"),
])
def test_an_effect_is_named_by_what_it_leaves_and_by_what_it_takes(names, baseline, left, verdict):
    base, best = (Tried(one, {}, error, error, 50.0, True) for one, error in (((), baseline), (names, left)))
    found = verdict_of(base, best, [base, best], (), 1.0, ())
    assert (found.verdict, found.effects) == (verdict, names)
    assert "100%" not in found.sentence


def test_where_the_model_is_adequate_no_set_that_is_not_named_is_told():
    base, best = (Tried(names, {}, error, error, 20.0, True) for names, error in (((), 1.034), (("helix",), 1.021)))
    told = verdict_of(base, best, [base, best], (best,), 1.0, ())
    assert told.verdict == "adequate" and told.with_effects == 1.021
    told = told_of_base(told)
    assert told.with_effects == told.baseline == 1.034 and told.best is base and told.steps == (base,)
    named = verdict_of(base, replace(best, error_held_out=1.0), [base, best], (best,), 1.0, ())
    assert named.verdict == "missing_effect" and told_of_base(named) is named


@pytest.mark.parametrize(("second", "gain", "chosen"), [
    (1.002, 68.0, 1),  # of two that leave but noise the one that all samples together prefer
    (1.002, -68.0, 0),
    (1.200, 68.0, 0),  # more than noise is left: it foretells worse
])
def test_of_candidates_that_leave_but_noise_the_likeliest_is_chosen(second, gain, chosen):
    def fitted(cost):
        rest = np.random.default_rng(1).normal(size=2000) * np.sqrt(cost / 1000.0)
        return SimpleNamespace(residuals=(rest,), squares=float(rest @ rest), names=("a", "b"), parts=())

    first, other = (Candidate((name,), {}, error, error, 100.0, True, fit=fitted(cost), fitter=None)
                    for name, error, cost in (("a", 1.0, 1000.0), ("b", second, 1000.0 * np.exp(-gain / 2000.0))))
    assert likeliest([first, other], 1.0) is (first, other)[chosen]


@pytest.mark.parametrize(("extent", "nothing"), [(0.0, True), (0.4, False)])
def test_an_effect_that_ended_where_it_vanishes_is_none(extent, nothing):
    model = BELIEVED.with_effect("entry_ramp", extent=extent)
    one = Candidate(("entry_ramp",), {}, 1.0, 1.0, 1476.0, True, fitter=None,
                    fit=SimpleNamespace(state=SimpleNamespace(model=model)))
    assert vanishes(one, catalogue()) is nothing


@pytest.mark.parametrize(("left", "worth"), [(1.031, False), (1.005, True)])
def test_of_the_little_that_two_effects_leave_a_third_must_take_half(left, worth):
    two = ("contact_loss", "runout")
    base, current, other = (Tried(effects, {}, error, error, 75.0, True)
                            for effects, error in (((), 2.2), (two, 1.036), ((*two, "entry_ramp"), left)))
    assert worth_naming(other, current, base, 1.0) is worth


@pytest.mark.parametrize(("left", "basis", "below"), [
    (0.33, "high-frequency residual", True),  # no idling: the noise was guessed, and guessed too high
    (0.33, "idle", False),  # idling holds what else is there, an ambient vibration that is explained now
    (0.98, "high-frequency residual", False),
])
def test_below_a_noise_that_was_only_guessed_no_gain_makes_a_further_effect_certain(left, basis, below):
    fitter = SimpleNamespace(records=[SimpleNamespace(noise_basis=basis)] * 2)
    assert below_a_guess(Candidate(("cubic_stiffness",), {}, left, left, 75.0, True, fit=None, fitter=fitter), 1.0) is below


@pytest.mark.parametrize(("gain", "beside", "certain"), [(127.0, 0.0, True), (127.0, 3e5, False), (900.0, 3e5, True)])
def test_beside_a_strong_effect_a_small_gain_may_be_the_form_of_its_law(gain, beside, certain):
    named = ("speed_droop",) if beside else ()
    base, current, other = (Tried(effects, {}, error, error, delta, True) for effects, error, delta in
                            (((), 9.0, 0.0), (named, 1.003, beside), ((*named, "process_damping"), 1.0, gain)))
    assert bool(certain_ones([other], current, base, 1.0)) is certain


@pytest.mark.parametrize(("doubt", "verdict"), [
    (0.005, "missing_effect"),  # what is left is noise, as well as the noise is known
    (0.0005, "undecided"),  # a part of what is left is known: that is never called nothing
])
def test_a_weak_effect_that_is_certain_is_never_called_nothing(doubt, verdict):
    noise = 0.1
    known = RecordError("cut", 0.1, noise, np.zeros((1, 9)), 0.01, 1.0, noise**2, doubt)
    base, weak = (Tried(names, {}, error, error, gain, True, errors=(replace(known, squares=error**2),))
                  for names, error, gain in (((), 0.10067, 0.0), (("helix",), 0.10062, 182.0)))
    passing = certain_ones([weak], base, base, noise)
    assert bool(passing) is (verdict == "missing_effect")
    end = weak if passing else base
    found = never_nothing(verdict_of(base, end, [base, *passing], (weak,), noise, ()))
    assert (found.verdict, found.effects) == (verdict, ("helix",))
    astray = replace(weak, error_fit=0.1)  # explains ten times what it foretells: a part of something else
    assert not certain_ones([astray], base, base, noise)
    assert never_nothing(verdict_of(base, base, [base], (astray,), noise, ())).verdict == "undecided"
    chance = replace(weak, delta_bic=12.0)
    assert never_nothing(verdict_of(base, base, [base], (chance,), noise, ())).verdict == "adequate"


@pytest.mark.parametrize(("value", "bound"), [(5.5e8, False), (5.5e5, True)])
def test_a_machine_at_the_bound_of_what_is_searched_is_noticed(value, bound):
    free = [FreeParameter("tangential_coefficient", 1e7, (5.5e5, 5.5e11)), FreeParameter("edge_force.normal", 1e4, (0.0, 1e6))]
    model = TRUE.with_values({"tangential_coefficient": value}).with_effect("edge_force", tangential=1e4, normal=0.0)
    assert at_a_bound(free, model) is bound
