"""A strongly hardening machine: phases run apart within a cut, so the fit grows along it."""

from functools import partial

import numpy as np
import pytest

from testbed.analysis.fit.effect_start import all_free
from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.moves.growing_window import bends_frequency
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.pass_search import SHORTEST, place_entries, place_exits
from testbed.analysis.fit.solve import Goal, alternate_fit_and_passes, solve
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.fit.waveform import Fitter
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.validation.blind.draw import draw
from tests.validation.blind.make import records_of

KNOWN = catalogue()
MARK = 2.785  # rad, near where the campaign's first mark has a tooth


@pytest.fixture(scope="module")
def campaign():
    """A loud record and three quiet ones of two flutes at 83 Hz, whose flexure hardens by 1.5e14 N/m^3."""
    truth = draw(4034, KNOWN, anywhere=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tests.validation.blind.make.mujoco_engine.simulate", partial(fast.simulate, steps=61))
        records = records_of(truth, KNOWN)
    return truth, [observe(record, truth.believed) for record in records]


@pytest.mark.long
def test_where_phases_run_apart_a_fit_grown_along_the_cuts_finds_the_valley_that_no_descent_does(campaign):
    truth, observed = campaign
    off = {"natural_frequency": 0.997, "damping_ratio": 1.14, "tangential_coefficient": 1.01, "normal_coefficient": 0.95}
    true = truth.model.effects["cubic_stiffness"]["coefficient"]
    model = truth.model.with_values({name: share * truth.model.value(name) for name, share in off.items()})
    model = model.with_effect("cubic_stiffness", coefficient=1.1 * true)
    fitter = Fitter(predict, observed, all_free(observed, model, KNOWN))
    state = State(model, MARK, tuple(first_nuisances(record, MARK) for record in observed))
    astray = alternate_fit_and_passes(fitter, place_exits(fitter, state))
    assert astray.mean_squares.max() > 20.0
    goal = Goal((KNOWN["cubic_stiffness"],))
    _, found = solve(fitter, astray, ("growing_window",), goal)
    assert found.mean_squares.max() < 1.1
    assert found.state.model.effects["cubic_stiffness"]["coefficient"] == pytest.approx(true, rel=0.01)
    assert solve(fitter, found, ("growing_window",), goal)[1] is found  # no record stands out


def test_a_model_that_is_wrong_for_a_loud_record_still_has_it_cut(campaign):
    truth, observed = campaign
    fitter, fit = base_fit(predict, observed, truth.believed)
    loud = int(np.argmax([record.data.std() for record in observed]))
    assert fit.mean_squares[loud] > 1000.0
    for state in (fit.state, place_exits(fitter, place_entries(fitter, fit.state))):
        own = state.nuisances[loud]
        assert 15 <= own.entry <= 22 and own.exit - own.entry >= SHORTEST * 80  # 90 passes from the 18th on


def test_only_a_smooth_force_of_the_displacement_bends_the_frequency():
    assert [name for name, law in KNOWN.items() if bends_frequency([law])] == ["cubic_stiffness"]
