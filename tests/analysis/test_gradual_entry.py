"""Is an entry that is not sudden found when the base fit has bent the coefficients to make up for it?"""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest

from testbed.analysis.fit.effect_start import gradual_entry, state_without
from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.starts import anchored_states, base_fit
from testbed.analysis.search.backward import nesting_guard
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.refit_from_prior import from_believed
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.workshop import RPM
from tests.support.campaign_files import BELIEVED
from tests.support.synthetic_campaign import synthetic_campaign

TRUE = Model(Structure(2.573, 146.42, 0.0032), Cutter(), Cutting()).with_effect("entry_ramp", extent=0.4)
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=catalogue()),
                        predict_driven=partial(predict.predict_driven, catalogue=catalogue()))


def test_a_gradual_entry_is_found_from_bent_coefficients():
    records = synthetic_campaign(partial(fast.simulate, steps=37), TRUE, seed=6, rate=6400.0,
                                 tests=((3500, 1.2), (2600, 1.5), (3900, 2.2)))
    fitter, fit = base_fit(ENGINE, [observe(record, BELIEVED) for record in records], BELIEVED)
    count = sum(rest.size for rest in fit.residuals)
    assert fit.squares > 4 * count
    scanned, _ = anchored_states(ENGINE, fitter.records, BELIEVED, fitter.unknowns)
    _, state, wider = gradual_entry(fitter, catalogue()["entry_ramp"], fit, scanned)
    found = alternate_fit_and_passes(wider, state, rounds=3)
    assert found.squares < 1.1 * count
    assert found.state.model.value("entry_ramp.extent") == pytest.approx(0.4, rel=0.03)
    assert found.state.model.value("tangential_coefficient") == pytest.approx(TRUE.value("tangential_coefficient"), rel=0.1)


def test_the_first_touch_within_a_pass_is_found_record_by_record():
    late = {3500: 0.3, 2600: 0.68, 3900: 0.9}

    def simulate(model, cut, sampling):
        touched = min(late.items(), key=lambda pair: abs(pair[0] * RPM - cut.spindle_speed))[1]
        return fast.simulate(model, replace(cut, late_entry=touched), sampling, steps=61)

    records = synthetic_campaign(simulate, TRUE, seed=6, tests=((3500, 1.2), (2600, 1.5), (3900, 2.2)), noise=3e-7, rate=6400.0)
    found = from_believed(ENGINE, [observe(record, BELIEVED) for record in records], BELIEVED, ["entry_ramp"], catalogue())
    state = found.fit.state
    assert found.error_where_known < 1.03 * pooled(found.errors)[1]
    assert state.model.value("entry_ramp.extent") == pytest.approx(0.4, rel=0.005)
    assert state.model.value("normal_coefficient") == pytest.approx(TRUE.value("normal_coefficient"), rel=0.05)
    assert [own.late_entry for own in state.nuisances] == pytest.approx(list(late.values()), abs=0.05)
    whole = state_without(state, "entry_ramp", catalogue())
    assert all(own.late_entry == 0.0 for own in whole.nuisances)


def test_a_ramp_of_no_extent_shows_the_set_without_it_where_its_cuts_begin():
    """The set without it enters three passes off. The ramp touches the work behind a pass's arc: so the next is the first."""
    records = synthetic_campaign(partial(fast.simulate, steps=37), TRUE.without_effect("entry_ramp"), seed=4, rate=6400.0,
                                 tests=((3500, 0.8), (2600, 1.5)), course=(12, 30, 10))
    known = catalogue()
    fitter, fit = base_fit(ENGINE, [observe(record, BELIEVED) for record in records], BELIEVED)
    touched = tuple(replace(own, entry=own.entry - 1, late_entry=0.6) for own in fit.state.nuisances)
    ramp = replace(fit.state, model=fit.state.model.with_effect("entry_ramp", extent=0.0), nuisances=touched)
    larger = candidate_of(fitter, replace(fit, state=ramp), ("entry_ramp",), None, 1.0)
    own = fit.state.nuisances[1]
    wrong = fitter.fit(fit.state.with_record(1, replace(own, entry=own.entry - 3)), iterations=5)
    current = candidate_of(fitter, wrong, (), None, 1.0)
    assert wrong.cost > 1.05 * fit.cost
    assert nesting_guard(current, [larger], known).fit.cost == pytest.approx(fit.cost, rel=1e-4)
