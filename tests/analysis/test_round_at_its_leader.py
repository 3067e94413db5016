"""When a round holds its leader against the believed machine, how far it follows rivals, and what a gradual entry is given."""

from dataclasses import replace

import pytest

from testbed.analysis.fit.effect_start import origins_of
from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.moves import every_move
from testbed.analysis.fit.solve import Move
from testbed.analysis.search import candidate_round as cr
from testbed.analysis.search import score_test as fl
from testbed.analysis.search.candidate import Candidate
from tests.support.campaign_files import BELIEVED
from tests.support.short_round import BENT, KNOWN, fitted, quiet, round_of


@pytest.fixture(scope="module")
def base():
    """A model without an edge force that is there."""
    return fitted()


def _round(base, left, monkeypatch, costs=(0.1, 0.5, 0.6)):
    """(goals of the full fits by effect, how often the believed machine was asked) of a round, if fits leave `left` floors.

    costs: after the first steps, in that of the base fit. As a rule the leader's leaves much less than a third.
    """
    asked, before = [], base.error_held_out / base.errors[0].noise_floor
    first = dict(zip(("chip_force_exponent", "edge_force", "helix"), costs, strict=True))
    full = {name: (floors / before) ** 2 for name, floors in left.items()}
    _, goals = round_of(base, first, full, monkeypatch, alone=lambda: asked.append(1) or ())
    return goals, len(asked)


def test_a_leader_that_leaves_twice_the_noise_is_held_against_the_believed_machine(base, monkeypatch):
    assert base.error_held_out > 5.0 * base.errors[0].noise_floor
    assert _round(base, {"chip_force_exponent": 2.1}, monkeypatch)[1] == 1


def test_a_leader_that_leaves_less_than_twice_the_noise_is_not(base, monkeypatch):
    assert _round(base, {"chip_force_exponent": 1.9}, monkeypatch)[1] == 0


@pytest.mark.parametrize(("floors", "other", "looked"), [(2.1, True, 0), (2.1, False, 1), (1.0, True, 0)])
def test_a_leader_of_another_law_ends_the_round_before_the_believed_machine_is_asked(base, floors, other, looked, monkeypatch):
    asked, before = [], base.error_held_out / base.errors[0].noise_floor
    first, full = {"chip_force_exponent": 0.1, "edge_force": 0.11}, {"chip_force_exponent": (floors / before) ** 2}
    found, goals = round_of(base, first, full, monkeypatch, alone=lambda: asked.append(1) or (), of_other_law=lambda one: other)
    assert len(asked) == looked and {one.effects[-1] for one in found} == {"chip_force_exponent", "edge_force"}
    ended = other and floors > 2.0
    assert (list(goals) == ["chip_force_exponent"]) == ended
    assert [not isinstance(one, Candidate) for one in found if one.effects == ("edge_force",)] == [ended]


def test_another_law_is_asked_for_before_parts_of_passes_are_looked_for(base, monkeypatch):
    said = []
    monkeypatch.setitem(every_move(), "parts_of_passes", Move(lambda fitter, fit, goal: said.append("parts") or ()))
    origins = origins_of(base.fitter.engine, BELIEVED, base.fitter, base.fit, anchored=False)
    entry = fl.begun(base, KNOWN["cubic_stiffness"], origins)
    found = cr._refitted(base, entry, KNOWN, quiet, of_other_law=lambda one: said.append(one.effects) or True)
    assert said == [("cubic_stiffness",)] and found.effects == ("cubic_stiffness",) and isinstance(found, Candidate)


def test_a_rival_is_followed_to_a_share_of_what_the_best_takes_away(base, monkeypatch):
    goals, _ = _round(base, {"chip_force_exponent": 1.0}, monkeypatch)
    noise, cost = base.errors[0].noise_floor, base.fit.cost
    assert goals["edge_force"] == pytest.approx(1.5 * (noise / base.error_held_out) ** 2 * cost)
    goals, _ = _round(replace(base, error_held_out=1.05 * noise), {"chip_force_exponent": 1.0}, monkeypatch, (0.95, 0.96, 0.97))
    best = cost / 1.05**2
    assert goals["edge_force"] == pytest.approx(best + 0.3 * (cost - best))


def test_a_gradual_entry_whose_first_step_costs_more_than_nothing_is_fitted_in_full(monkeypatch):
    ramped = fitted(tests=((3500, 1.2), (2850, 0.8)), noise=2e-6, hidden={"entry_ramp": {"extent": 0.03}})
    assert 1.02 < ramped.error_held_out / pooled(ramped.errors)[1] < 2.0
    origins = origins_of(ramped.fitter.engine, BELIEVED, ramped.fitter, ramped.fit, anchored=False)
    ramp = {"entry_ramp": KNOWN["entry_ramp"]}
    first = fl.first_step

    def led_astray(*given):
        cost, state, wider = first(*given)
        return max(cost, 1.01 * ramped.fit.cost), state, wider

    monkeypatch.setattr(fl, "first_step", led_astray)
    (found,) = fl.first_steps(ramped, ramp, origins, quiet)
    assert found.cost < ramped.fit.cost
    assert found.state.model.effects["entry_ramp"]["extent"] == pytest.approx(0.03, rel=0.3)
    known = replace(ramped, error_held_out=pooled(ramped.errors)[1])  # where nothing is left, nothing is gained
    (found,) = fl.first_steps(known, ramp, origins, quiet)
    assert found.cost == pytest.approx(1.01 * ramped.fit.cost)


@pytest.mark.parametrize(("hidden", "asked"), [(BENT, True), ({}, False)])
def test_it_is_asked_whether_a_cut_was_elsewhere_where_an_effect_explains_something(hidden, asked, monkeypatch):
    known, calls = fitted(hidden=hidden), []
    monkeypatch.setitem(every_move(), "cut_elsewhere", Move(lambda fitter, fit, goal: calls.append(fit) or ()))
    origins = origins_of(known.fitter.engine, BELIEVED, known.fitter, known.fit, anchored=False)
    found = cr.with_effect(known, "edge_force", KNOWN, origins, quiet)
    assert bool(calls) == asked and (found.fit.cost < 0.5 * known.fit.cost) == asked
