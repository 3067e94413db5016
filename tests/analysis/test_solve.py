"""The loop of the fit on a cheap stand-in: a cost with several valleys, and moves that lead from one to the next."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testbed.analysis.fit import moves
from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.moves import BASE, LAWS, NAMED, QUICK, TOLD, WORTH_HOPPING, WORTH_PARTS, Step, every_move, steps_of
from testbed.analysis.fit.solve import Goal, Move, Trial, accepted, solve

BEGIN = 1000.0


class Valleys:
    """A fitter whose fits cost what their state says, and converge where a fit is asked to finish."""

    def fit(self, state, *, iterations, near):
        """The state, half a unit deeper, after as many iterations as were asked for."""
        return fit_of(state - 0.5, iterations=iterations)


def fit_of(cost, *, converged=True, iterations=0, variance=1.0):
    """A fit of this cost and mean square residual."""
    rest = np.full(round(2.0 * cost / variance), math.sqrt(variance))
    return WaveformFit(state=cost, cost=cost, parts=(), converged=converged, iterations=iterations, residuals=(rest,), names=(),
                       covariance=np.zeros((0, 0)))


def downhill(by, **how):
    """A move that proposes a fit which costs less by so much."""
    return Move(lambda fitter, fit, goal: [Trial(fitter, fit_of(fit.cost - by))], **how)


@pytest.fixture
def run(monkeypatch):
    """What `solve` comes to from a cost of 1000 with these moves alone, tried in this order: (cost, names of what helped)."""

    def solved(goal=None, scheme=None, fit=None, **known):
        monkeypatch.setattr(moves, "every_move", lambda: known)
        fitter, found = solve(Valleys(), fit or fit_of(BEGIN), scheme or tuple(known), goal or Goal())
        assert isinstance(fitter, Valleys)
        return found.cost, found.helped

    return solved


def test_what_costs_less_is_kept_and_its_name_written_down(run):
    assert run(first=downhill(100.0), up=downhill(-50.0), last=downhill(30.0)) == (870.0, ("first", "last"))


def test_what_a_converged_fit_may_still_gain_is_no_other_valley(run):
    assert run(little=downhill(1.0 + 1e-5 * BEGIN)) == (BEGIN, ())
    assert run(more=downhill(1.01 + 1e-5 * BEGIN))[1] == ("more",)


def test_without_a_gain_the_very_fit_comes_back(monkeypatch):
    monkeypatch.setattr(moves, "every_move", lambda: {"up": downhill(-1.0)})
    fit = fit_of(BEGIN)
    assert solve(Valleys(), fit, ("up",))[1] is fit


def test_a_departure_must_save_what_the_move_says_and_the_plainer_may_cost_as_much(run):
    assert run(dear=downhill(15.0, worth=20.0))[1] == () and run(dear=downhill(25.0, worth=20.0))[1] == ("dear",)

    def plainer(cost):
        return Move(lambda fitter, fit, goal: [Trial(fitter, fit_of(fit.cost + cost), -1)], worth=20.0)

    assert run(plain=plainer(19.9)) == (BEGIN + 19.9, ("plain",)) and run(plain=plainer(20.1))[1] == ()


@pytest.mark.parametrize(("before", "after", "kept"), [(4.0, 1.0, True), (4.0, 2.0, False), (0.5, 0.5, True)])
def test_the_worth_is_in_units_of_the_noise_that_is_left_of_the_better_one(before, after, kept):
    fit, trial = fit_of(BEGIN, variance=before), Trial(Valleys(), fit_of(BEGIN - 25.0, variance=after))
    assert accepted(downhill(0.0, worth=20.0), trial, fit) is kept


def test_the_first_trial_that_is_kept_is_the_last_that_is_made(run):
    made = []

    def propose(fitter, fit, goal):
        for cost in (1100.0, 900.0, 500.0):
            made.append(cost)
            yield Trial(fitter, fit_of(cost))

    assert run(one=Move(propose))[0] == 900.0 and made == [1100.0, 900.0]


def test_a_move_is_asked_again_while_it_helps(run):
    assert run(often=downhill(100.0, repeats=3)) == (700.0, ("often",) * 3)
    assert run(never=downhill(-1.0, repeats=3)) == (BEGIN, ())


def test_a_short_trial_that_is_kept_is_finished(run):
    short = Move(lambda fitter, fit, goal: [Trial(fitter, fit_of(900.0, converged=False))], finish=7)
    assert run(short=short)[0] == 899.5
    assert run(short=replace(short, finish=0))[0] == 900.0


def test_what_counts_other_values_is_kept_whatever_it_costs(run):
    assert run(mask=downhill(-500.0, incomparable=True)) == (BEGIN + 500.0, ("mask",))


def test_above_its_limit_a_fit_is_left_alone_unless_a_move_rescues_it_and_is_given_the_patience(run):
    known = {"plain": downhill(10.0), "growing": downhill(300.0, rescues=True), "after": downhill(20.0)}
    assert run(Goal(cost_limit=800.0), **known) == (BEGIN, ())
    assert run(Goal(cost_limit=800.0, patient=True), **known) == (680.0, ("growing", "after"))


def test_where_a_fit_begins_in_a_known_valley_nothing_is_tried(run):
    known = {"first": downhill(100.0), "second": downhill(100.0)}
    assert run(Goal(known=1000.05), **known) == (1000.0, ())
    assert run(Goal(known=900.05), **known) == (800.0, ("first", "second"))  # one that comes by goes on
    assert run(Goal(known=950.0), **known) == (800.0, ("first", "second"))


def test_a_step_goes_on_where_its_move_helped_and_is_tried_when_it_is_worth_it(run):
    known = {"hides": downhill(100.0), "hidden": downhill(10.0), "up": downhill(-1.0)}
    assert run(scheme=(Step("hides", ("hidden",)), Step("up", ("hidden",))), **known)[1] == ("hides", "hidden")
    worth_it = (Step("hides", when=lambda fitter, fit, goal: fit.cost < goal.before),)
    assert run(scheme=worth_it, **known)[1] == ("hides",) and run(Goal(before=BEGIN), scheme=worth_it, **known)[1] == ()


def test_every_move_of_a_scheme_is_a_file_and_every_file_has_its_place():
    named = set()

    def walk(scheme):
        for step, _ in steps_of(scheme):
            named.add(step.move)
            walk(step.then)

    for scheme in (BASE, LAWS, QUICK, WORTH_PARTS, WORTH_HOPPING, NAMED, TOLD):
        walk(scheme)
    assert named == set(every_move()) and named >= moves.NAMES
    table = (Path(__file__).parents[2] / "docs" / "how_the_fit_works.md").read_text("utf-8")
    assert [name for name in sorted(named) if f"`{name}`" not in table] == []


def test_a_new_move_is_one_file(tmp_path, monkeypatch):
    (tmp_path / "brand_new.py").write_text('''"""A valley next door."""
from testbed.analysis.fit.solve import Move, Trial

def propose(fitter, fit, goal):
    yield Trial(fitter, fitter.fit(fit.cost - 99.5, iterations=1, near=fit))

MOVE = Move(propose, quick=True)
''')
    monkeypatch.setattr(moves, "__path__", [*moves.__path__, str(tmp_path)])
    every_move.cache_clear()
    try:
        known = every_move()
        assert "brand_new" in known
        for scheme in (BASE, QUICK):
            assert [step.move for step, _ in steps_of(scheme)].count("brand_new") == 1
        for name in set(known) - {"brand_new"}:
            monkeypatch.delitem(known, name)
        for scheme in (BASE, QUICK):
            assert solve(Valleys(), fit_of(BEGIN), scheme)[1].helped == ("brand_new",)
    finally:
        every_move.cache_clear()
