"""A record that starts shortly after its cut began, while the vibration of the entry still dies away."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.moves import lost_records
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.pass_search import recently_entered, settle_passes
from testbed.analysis.fit.record_restart import own_course
from testbed.analysis.search.diagnose import diagnose
from testbed.api.fitting import engine_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import begun_later, synthetic_record

TESTS = ((3500, 0.8), (2850, 2.9), (3900, 2.2))
LAST = TESTS[-1][0], TESTS[-1][1] * 1e-3  # rpm, m
IDLE, SINCE = 8, 7  # revolutions before the entry, and from the entry to the last record's start
FITTED = partial(model_fit, engine_of(catalogue()), model=BELIEVED, catalogue=catalogue())


@pytest.fixture(scope="module")
def observed():
    records = [synthetic_record(partial(fast.simulate, steps=61), TRUE, rpm, depth * 1e-3, 80 + number, course=(IDLE, 50, 15))
               for number, (rpm, depth) in enumerate(TESTS)]
    whole = observe(records[-1], BELIEVED)
    return [*(observe(record, BELIEVED) for record in (*records[:-1], begun_later(records[-1], IDLE + SINCE))), whole]


@pytest.fixture(scope="module")
def fitted(observed):
    return FITTED(records=observed[:-1])


def test_its_cut_is_begun_where_it_began(observed, fitted, monkeypatch):
    fitter, fit = fitted
    record, own = fitter.records[-1], fit.state.nuisances[-1]
    assert record.starts_in_cut and fit.mean_squares.max() < 1.05
    began, entered = record.pass_start(own.entry, fit.state.angle, own), observed[-1].segments[0].stop
    assert entered < record.start - 6 * record.period and began == pytest.approx(entered, abs=0.1 * record.period)
    for name, error in zip(fit.names, np.sqrt(np.diag(fit.covariance)), strict=True):
        assert name == "mark_angle" or abs(fit.state.model.value(name) - TRUE.value(name)) < 4 * error
    for module in ("starts", "record_restart", "moves.pass_count"):
        monkeypatch.setattr(f"testbed.analysis.fit.{module}.recently_entered", lambda fitter, state: state)
    assert FITTED(records=observed[:-1])[1].mean_squares.max() > 1.05


def test_what_still_swung_at_its_entry_is_found_with_it(fitted):
    """Loud before the entry, some of it is left where the record starts; a machine that other records show tells it."""
    rung = synthetic_record(partial(fast.simulate, steps=61), TRUE, *LAST, 82, course=(IDLE, 50, 15), state=(3e-5, 0.0))
    late = replace(observe(begun_later(rung, IDLE + SINCE), BELIEVED), starts_in_cut=True)  # as one seems whose cut is louder
    fitter = fitted[0].on([*fitted[0].records[:-1], late])
    state = own_course(fitter, 2, replace(fitted[1].state, nuisances=fitted[1].state.nuisances[-1:]))
    single, own = fitter.of_records([2]), state.nuisances[0]
    assert own.entry > late.first_simulated and 2.0 * single.cost(state) < 1.05 * late.size
    assert 2.0 * single.cost(state.with_record(0, own.with_fields(displacement=0.0, velocity=0.0))) > 1.5 * late.size


def test_a_cut_that_was_steady_began_long_ago_again(fitted):
    """Settling its passes, a beginning that explains nothing is given up; one that was never asked for is not looked for."""
    fitter, fit = fitted
    record, own = fitter.records[-1], fit.state.nuisances[-1]
    late = fitter.on([*fitter.records[:-1], record.part(record.samples // 2, record.samples // 4)])
    ended = own.with_fields(exit=own.exit + 10**6)
    steady = fit.state.with_record(2, ended.with_fields(entry=late.records[-1].first_simulated))
    assert settle_passes(late, steady)[0].nuisances[-1].entry == late.records[-1].first_simulated
    assert recently_entered(fitter, fit.state).nuisances[-1].entry == own.entry
    undamped = fit.state.with_value("damping_ratio", 0.0)  # as a model may believe
    assert recently_entered(fitter, undamped).nuisances[-1].entry > record.first_simulated


@pytest.mark.long
@pytest.mark.parametrize("refit_from_prior", [True, False])
def test_a_late_record_that_leads_the_search_astray_is_left_out_at_first(refit_from_prior, monkeypatch):
    """What swung at an entry that no record shows bends the fit of a wrong model; the others name what is missing.

    Here the record is found in the first fit, if it may be begun anew there.
    """
    if not refit_from_prior:
        monkeypatch.setattr(lost_records, "LATE", math.inf)
    true = TRUE.with_values({"damping_ratio": 0.002}).with_effect("quadratic_damping", coefficient=50.0)
    made, said = partial(synthetic_record, partial(fast.simulate, steps=61), true, course=(IDLE, 50, 15)), []
    records = [observe(made(rpm, depth, number), BELIEVED)
               for number, (rpm, depth) in enumerate([(3500, 0.8e-3), (2850, 2.9e-3), (2600, 0.8e-3)], 80)]
    late = observe(begun_later(made(*LAST, 83, state=(1e-4, 0.0)), IDLE + SINCE), BELIEVED)
    known = {name: catalogue()[name] for name in ("quadratic_damping", "process_damping", "sensor_lag")}
    found = diagnose(engine_of(known), [*records, replace(late, starts_in_cut=True)], BELIEVED, known, progress=said.append)
    assert any(text.startswith("without ") for text in said) is not refit_from_prior
    assert found.verdict == "missing_effect" and found.effects == ("quadratic_damping",)
    assert found.best.error_held_out < 1.02 * found.noise_floor and found.best.fit.mean_squares.max() < 1.15
