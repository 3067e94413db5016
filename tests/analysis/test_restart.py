"""A search that began with the wrong effect is begun again; one that left only noise is not. The data have other steps."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest

from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.backward import backward
from testbed.analysis.search.candidate import ADEQUATE
from testbed.analysis.search.forward_search import forward
from testbed.analysis.search.prior_screening import PriorScreening
from testbed.analysis.search.refit_from_prior import from_believed
from testbed.analysis.search.restart import CLEARLY, begun_with, restarted
from testbed.analysis.search.score_test import shifts_in_time
from testbed.analysis.search.selection_trace import SelectionTrace
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

KNOWN = {name: catalogue()[name] for name in ("edge_force", "immersion_error", "tool_wear")}
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=catalogue()),
                        predict_driven=partial(predict.predict_driven, catalogue=catalogue()))


@pytest.fixture(scope="module")
def observed():
    records = synthetic_campaign(partial(fast.simulate, steps=37), TRUE.with_effect("immersion_error", error=0.45), seed=6,
                                 tests=((3500, 0.8), (2850, 2.9), (3900, 2.2)), course=(10, 30, 10), rate=6400.0)
    return [observe(record, BELIEVED) for record in records]


def fitted(observed, *names):
    return from_believed(ENGINE, observed, BELIEVED, names, KNOWN)


@pytest.mark.long
def test_a_search_that_began_with_the_wrong_effect_is_begun_again(observed):
    base, wrong = fitted(observed), fitted(observed, "edge_force")
    noise = pooled(base.errors)[1]
    assert wrong.error_held_out > 1.5 * noise
    screening = PriorScreening(base, BELIEVED, KNOWN, lambda line: None)
    found = restarted(SelectionTrace((base, wrong), (wrong,), ()), screening, noise, 3)
    assert found.end.effects == ("immersion_error",) and found.steps[0] is base
    assert found.end.error_held_out < 1.05 * noise
    assert found.end.parameters["immersion_error.error"] == pytest.approx(0.45, abs=0.005)
    assert {one.effects for one in found.seen} >= {("edge_force",), ("immersion_error",)}  # what was tried first is told, too


def test_an_effect_that_a_later_one_makes_needless_is_dropped(observed):
    both = fitted(observed, "edge_force", "immersion_error")
    kept = backward(both, KNOWN, lambda line: None)
    assert kept.effects == ("immersion_error",) and kept.parameters.keys() == {"immersion_error.error"}
    assert kept.parameters["immersion_error.error"] == pytest.approx(0.45, abs=0.005)
    needed = fitted(observed, "immersion_error", "edge_force")
    assert "immersion_error" in backward(needed, KNOWN, lambda line: None).effects


@pytest.mark.long
def test_where_no_first_step_leads_to_much_the_believed_machine_is_asked(observed):
    base, said = fitted(observed), []
    noise = pooled(base.errors)[1]
    look = PriorScreening(base, BELIEVED, KNOWN, said.append)
    found = forward([base], BELIEVED, KNOWN, 3, said.append, look)
    assert found.end.effects == ("immersion_error",) and found.end.error_held_out < 1.05 * noise
    assert look.gave(("immersion_error",)) and said.count("fitting immersion_error from the believed machine") == 1
    assert not any("anew" in line for line in said)  # it is from there already
    complete = look.alone()[0].error_where_known <= ADEQUATE * noise
    assert complete != any(line.endswith("from far") for line in said)  # only what leaves nothing spares the others' trials


@pytest.mark.long
def test_an_effect_is_looked_for_on_both_sides_of_neutral_and_though_a_cut_ends_within_an_arc():
    """The believed immersion is too large; its example is too small. A fit from the beginning takes all passes for whole."""
    def simulate(model, cut, sampling):
        ended = replace(cut, early_exit=0.93) if cut.axial_depth_of_cut > 2.5e-3 else cut
        return fast.simulate(model, ended, sampling, steps=370)

    records = synthetic_campaign(simulate, TRUE.with_effect("immersion_error", error=-0.25), seed=6, noise=1e-6,
                                 tests=((3500, 0.8), (2850, 2.9), (3900, 2.2), (2600, 1.2)), course=(10, 40, 15), rate=6400.0)
    known = {name: KNOWN[name] for name in ("edge_force", "immersion_error")}
    base = fitted([observe(record, BELIEVED) for record in records])
    look = PriorScreening(base, BELIEVED, known, lambda line: None)
    assert look.leader == "immersion_error" and [one.effects for one in look.alone()] == [("immersion_error",)]
    assert look.alone()[0].parameters["immersion_error.error"] == pytest.approx(-0.25, abs=0.015)


@pytest.mark.long
def test_what_the_believed_machine_cannot_explain_is_asked_once(observed):
    base, said = fitted(observed), []
    look = PriorScreening(base, BELIEVED, {name: KNOWN[name] for name in ("edge_force", "tool_wear")}, said.append)
    assert look.leader in ("edge_force", "tool_wear")
    assert look.alone() == () and look.alone() == ()
    assert sum(line.startswith("fitting") for line in said) == 1 and not look.gave((look.leader,))


@pytest.mark.long
def test_a_search_that_left_only_noise_is_not_begun_again(observed):
    right = fitted(observed, "immersion_error")
    base = fitted(observed)
    path = SelectionTrace((base, right), (), ())
    assert restarted(path, PriorScreening(base, BELIEVED, KNOWN, pytest.fail), pooled(right.errors)[1], 3) is path


@pytest.mark.long
def test_two_effects_neither_of_which_explains_anything_alone_are_found_together():
    known = {name: catalogue()[name] for name in ("cubic_stiffness", "edge_force", "process_damping")}
    hidden = {"cubic_stiffness": {"coefficient": 8e13}, "edge_force": {"tangential": 1e4, "normal": 1.4e4}}
    true = TRUE
    for name, values in hidden.items():
        true = true.with_effect(name, **values)
    records = synthetic_campaign(partial(fast.simulate, steps=37), true, seed=8, course=(8, 25, 12), rate=6400.0,
                                 tests=((3500, 0.8), (2850, 1.5), (3900, 1.8)))
    base = from_believed(ENGINE, [observe(record, BELIEVED) for record in records], BELIEVED, (), known)
    noise = pooled(base.errors)[1]
    assert base.error_held_out > 10.0 * noise
    look = PriorScreening(base, BELIEVED, known, lambda line: None)
    pairs = {other: look.opened("cubic_stiffness", other) for other in ("edge_force", "process_damping")}
    assert pairs["edge_force"] < CLEARLY * min(pairs["process_damping"], look.opened("cubic_stiffness"))
    found = begun_with(SelectionTrace((base,), (), ()), ["cubic_stiffness", "edge_force"], look, noise, 2)
    assert set(found.end.effects) == set(hidden) and found.end.error_where_known < 1.05 * noise
    assert found.end.parameters["cubic_stiffness.coefficient"] == pytest.approx(8e13, rel=0.02)


def test_what_a_sensor_says_of_the_motion_moves_nothing():
    names = ("cubic_stiffness", "edge_force", "sensor_lag", "speed_droop")
    assert [name for name in names if not shifts_in_time(catalogue()[name])] == ["cubic_stiffness", "edge_force"]
