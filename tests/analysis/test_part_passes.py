"""Cuts that begin and end while a tooth is in the work: by both kernels against a direct integration, and in a campaign."""

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.moves import every_move, parts_of_passes
from testbed.analysis.fit.nuisances import Nuisances, nearly_whole
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.part_search import FINE, PARTS, VALLEYS, _parts, _placed, best_ends, reachable
from testbed.analysis.fit.record_restart import own_course
from testbed.analysis.fit.solve import solve
from testbed.api.fitting import engine_of
from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling, whole_cut_sampling
from testbed.engines import fast, mujoco_engine
from tests.effects.direct import KN, KT, MODEL, WINDOW, cut, error, integrate
from tests.support.campaign_files import BELIEVED
from tests.support.synthetic_campaign import synthetic_record

TESTS = ((3810, 2.0), (2850, 2.5), (4300, 1.5))
MISSING = ((0.07, 0.0), (0.0, 0.93), (0.0, 0.88))  # shares of a pass that are not cut; a tooth cuts 0.162 of one


@pytest.mark.parametrize("general", [False, True])
@pytest.mark.parametrize(("late", "early"), [(0.06, 0.0), (0.0, 0.9), (0.1, 0.95)])
def test_the_first_and_the_last_pass_are_cut_in_part(general, late, early):
    course = cut(late_entry=late, early_exit=early)
    first, last = 2 * math.pi * late, 2 * math.pi * (1 - early)
    h, b = course.feed_per_tooth, course.axial_depth_of_cut

    def force(number, turned, x, v, past):
        if (number == 0 and turned < first) or (number == course.passes - 1 and turned > last):
            return 0.0
        return -b * (h + x - past(number - 1, turned)) * math.sin(turned) * (KT * math.cos(turned) + KN * math.sin(turned))

    expected = integrate(MODEL, course, force, sorted({first, last, WINDOW} - {0.0, 2 * math.pi}))

    def engine(model, steps):
        sampling = whole_cut_sampling(course, 1, 1000.0)
        return fast.simulate_batch([model], [course], [sampling], steps=steps, general=general).pass_states[0]

    assert error(engine(MODEL, 80), expected) < 1e-6
    assert error(engine(MODEL, 320), expected) < 1e-8
    whole = fast.simulate_batch([MODEL], [replace(course, late_entry=0.0, early_exit=0.0)],
                                [whole_cut_sampling(course, 1, 1000.0)]).pass_states[0]
    assert np.abs(whole - expected)[:, 1].max() > 0.05 * np.abs(expected[:, 1]).max()


def test_shares_of_a_pass_are_checked_and_mujoco_says_that_it_has_none():
    with pytest.raises(ValueError, match="late_entry"):
        Cut(400.0, 1e-3, late_entry=1.0)
    with pytest.raises(ValueError, match="early_exit"):
        Cut(400.0, 1e-3, early_exit=-0.1)
    with pytest.raises(ValueError, match="tooth pass"):
        mujoco_engine.simulate(MODEL, Cut(400.0, 1e-3, late_entry=0.1), Sampling(1000.0, 10))


@pytest.fixture(scope="module")
def observed():
    records = []
    for number, ((rpm, depth), (late, early)) in enumerate(zip(TESTS, MISSING, strict=True)):
        def simulate(model, course, sampling, late=late, early=early):
            return fast.simulate(model, replace(course, late_entry=late, early_exit=early), sampling, steps=61)

        records.append(synthetic_record(simulate, TRUE, rpm, depth * 1e-3, 40 + number, course=(10, 40, 20)))
    return [observe(record, BELIEVED) for record in records]


TRUE = MODEL
FITTED = partial(model_fit, engine_of(catalogue()), model=BELIEVED, catalogue=catalogue())


def test_a_campaign_of_such_cuts_is_fitted_down_to_its_noise(observed, monkeypatch):
    _, fit = FITTED(records=observed)
    assert fit.mean_squares.max() < 1.03
    for own, (late, early) in zip(fit.state.nuisances, MISSING, strict=True):
        assert own.late_entry == pytest.approx(late, abs=0.01)
        assert own.early_exit == pytest.approx(early, abs=0.01) or early == 0.0
    found, true = fit.state.model, TRUE
    assert found.structure.damping_ratio == pytest.approx(true.structure.damping_ratio, rel=0.02)
    assert found.cutting.tangential_coefficient == pytest.approx(true.cutting.tangential_coefficient, rel=0.06)
    for move in ("parts_of_passes", "nearly_whole", "beside_whole"):
        monkeypatch.delitem(every_move(), move)
    assert FITTED(records=observed)[1].mean_squares.max() > 2.0


NEARLY_ALL = ((3810, 2.9, 0.0, 0.891), (2850, 2.9, 0.115, 0.915), (4300, 2.5, 0.124, 0.92), (2700, 1.5, 0.149, 0.0),
              (4200, 1.5, 0.0, 0.87))  # rpm, mm, shares of the first and the last pass that are not cut


@pytest.mark.parametrize("marks", [True, False])
@pytest.mark.long
def test_where_nearly_all_cuts_begin_or_end_within_an_arc_each_place_is_found(marks):
    """What each lacks bends the coefficients that all share, and at those the right parts of the others look wrong."""
    records = []
    for number, (rpm, depth, late, early) in enumerate(NEARLY_ALL):
        def simulate(model, course, sampling, late=late, early=early):
            return fast.simulate(model, replace(course, late_entry=late, early_exit=early), sampling, steps=610)

        record = synthetic_record(simulate, TRUE, rpm, depth * 1e-3, 60 + number, course=(10, 40, 20))
        without = replace(record, recording=replace(record.recording, marks=np.empty(0)))
        records.append(observe(record if marks else without, BELIEVED))
    _, fit = FITTED(records=records)
    assert fit.mean_squares.max() < 1.1
    for own, (*_, late, early) in zip(fit.state.nuisances, NEARLY_ALL, strict=True):
        assert own.late_entry == pytest.approx(late, abs=0.004)
        assert own.early_exit == pytest.approx(early, abs=0.004)
    for name, spread in zip(fit.names, np.sqrt(np.diag(fit.covariance)), strict=True):
        if name != "mark_angle":
            assert abs(fit.state.model.value(name) - TRUE.value(name)) < 4 * spread


def test_a_helix_makes_the_arc_longer_in_which_a_cut_may_begin():
    """Begun when the edge's lower end has left the work and its upper end has not entered it yet."""
    wound = replace(TRUE, cutter=replace(TRUE.cutter, helix_angle=0.7))
    records = []
    for number, ((rpm, depth), late) in enumerate(zip(TESTS, (0.0, 0.175, 0.0), strict=True)):
        def simulate(model, course, sampling, late=late):
            return fast.simulate(model, replace(course, late_entry=late), sampling, steps=610)

        records.append(synthetic_record(simulate, wound, rpm, depth * 1e-3, 70 + number, course=(10, 40, 20)))
    believed = replace(BELIEVED, cutter=wound.cutter)
    fitter, fit = model_fit(engine_of(catalogue()), [observe(record, believed) for record in records], believed, catalogue())
    assert 0.162 < 0.175 < fit.state.share_in_arc(fitter.records[1]) < 0.2
    assert fit.mean_squares.max() < 1.05
    assert [own.late_entry for own in fit.state.nuisances] == pytest.approx([0.0, 0.175, 0.0], abs=0.004)


def test_whole_passes_stay_whole():
    records = [observe(synthetic_record(partial(fast.simulate, steps=61), TRUE, rpm, depth * 1e-3, 50 + number,
                                        course=(10, 40, 20)), BELIEVED) for number, (rpm, depth) in enumerate(TESTS)]
    _, fit = FITTED(records=records)
    assert all(own.late_entry == own.early_exit == 0.0 for own in fit.state.nuisances)
    assert np.isfinite(fit.covariance).all()


def test_the_deepest_of_several_valleys_is_found_between_the_places_that_are_tried():
    """A broad shallow valley lies on a place that is tried; a narrow deep one between two that both cost more."""
    def costs_of(tried):
        places = np.array([one.exit - one.early_exit for one in tried])
        return 10.0 - 4.0 * np.exp(-(((places - 20.0) / 0.2) ** 2)) - 9.0 * np.exp(-(((places - 21.19) / 0.03) ** 2))

    own = Nuisances(entry=3, exit=20)
    cost, coarse = _placed(costs_of, (float(costs_of([own])[0]), own), 1.0, "exit", 0, PARTS)
    assert (coarse.exit, coarse.early_exit) == (20, 0.0) and cost == pytest.approx(6.0, abs=1e-3)
    cost, found = _placed(costs_of, (cost, coarse), 1.0, "exit", VALLEYS, PARTS)
    assert found.exit - found.early_exit == pytest.approx(21.19, abs=0.005) and cost < 1.5


def test_a_valley_narrower_than_the_coarse_parts_is_found_among_the_fine_ones():
    def costs_of(tried):
        places = np.array([one.exit - one.early_exit for one in tried])
        return 10.0 - 4.0 * np.exp(-(((places - 20.0) / 0.2) ** 2)) - 9.0 * np.exp(-(((places - 21.19) / 0.008) ** 2))

    own = Nuisances(entry=3, exit=20)
    begun = float(costs_of([own])[0]), own
    assert _placed(costs_of, begun, 1.0, "exit", VALLEYS, PARTS)[0] > 5.0
    cost, found = _placed(costs_of, begun, 1.0, "exit", VALLEYS, FINE)
    assert found.exit - found.early_exit == pytest.approx(21.19, abs=0.002) and cost < 1.5


def test_what_moves_of_the_ends_can_explain_is_told_before_any_place_is_looked_for(observed):
    """Nothing of a record whose ends are right, most of one whose first or last pass is taken for whole."""
    fitter, fit = FITTED(records=observed)
    for index, record in enumerate(fitter.records):
        assert reachable(fitter, fit, index) < 20.0
        own = fit.state.nuisances[index]
        wrong = fitter.fit(fit.state.with_record(index, replace(own, late_entry=0.0, early_exit=0.0)), iterations=0)
        cost = 0.5 * float(np.sum(wrong.residuals[index] ** 2))
        found, _ = best_ends(fitter, index, wrong.state, [wrong.state.nuisances[index]])
        assert found == pytest.approx(0.5 * record.size, rel=0.05) and cost > 2.0 * found
        assert 0.7 < reachable(fitter, wrong, index) / (cost - found) < 1.1


def test_a_course_that_is_lost_is_found_again_with_its_ends_within_arcs(observed, monkeypatch):
    """Without a tachometer, at the right machine: where a tooth stands is as unknown as where the cut begins."""
    fitter, fit = FITTED(records=[replace(one, first_mark=None, clock_error=None) for one in observed])

    def found(index):
        own = fit.state.nuisances[index]
        lost = own.with_fields(angle=own.angle + 1.1, entry=own.entry + 4, exit=own.exit - 3, late_entry=0.0, early_exit=0.0)
        return own_course(fitter, index, fit.state.with_record(index, lost).of_records([index])).nuisances[0]

    for index, (late, early) in enumerate(MISSING):
        assert fitter.cost(fit.state.with_record(index, found(index)), [index]) < 1.05 * fitter.cost(fit.state, [index])
        assert found(index).late_entry == pytest.approx(late, abs=0.01)
        assert found(index).early_exit == pytest.approx(early, abs=0.01) or early == 0.0
    monkeypatch.setattr("testbed.analysis.fit.record_restart.MISFIT", math.inf)
    assert fitter.cost(fit.state.with_record(1, found(1)), [1]) > 2.0 * fitter.cost(fit.state, [1])


def test_a_last_tooth_that_lacks_a_little_of_its_full_chip_is_seen_beside_the_whole_pass(monkeypatch):
    """0.2 % of a pass, a 75th of the arc: between the places of the arc that are tried."""
    records = []
    for number, ((rpm, depth), early) in enumerate(zip(TESTS, (0.0, 0.84, 0.0), strict=True)):
        def simulate(model, course, sampling, early=early):
            return fast.simulate(model, replace(course, early_exit=early), sampling, steps=610)

        records.append(observe(synthetic_record(simulate, TRUE, rpm, depth * 1e-3, 90 + number,
                                                course=(10, 40, 20)), BELIEVED))  # fmt: skip
    fitter, fit = FITTED(records=records)
    assert fit.state.nuisances[1].early_exit == pytest.approx(0.84, abs=1e-3)
    own = fit.state.nuisances[1]
    whole = fitter.fit(fit.state.with_record(1, own.with_fields(early_exit=0.0)))
    assert whole.cost > fit.cost + 100.0
    _, again = solve(fitter, whole, ("beside_whole",))
    assert again.cost < fit.cost + 1.0
    assert again.state.nuisances[1].early_exit == pytest.approx(0.84, abs=1e-3)


def test_an_arc_that_holds_many_swings_is_divided_finer(observed):
    fitter, fit = FITTED(records=observed)
    assert _parts(fitter, 0, fit.state, PARTS) == PARTS  # half a swing
    slow = fitter.on([replace(record, period=0.2) for record in observed])
    swings = fit.state.model.structure.natural_frequency * 0.2 * fit.state.share_in_arc(observed[0])
    assert swings > 4 and _parts(slow, 0, fit.state, PARTS) >= 4 * swings


def test_an_end_that_came_to_the_edge_of_its_arc_holds_nothing(observed):
    fitter, fit = FITTED(records=observed)
    place = next(place for place, own in enumerate(fit.state.nuisances) if own.late_entry == 0.0)
    own, arc = fit.state.nuisances[place], fit.state.share_in_arc(observed[place])
    bent = fit.state.model.with_values({"natural_frequency": fit.state.model.structure.natural_frequency * 1.0002})
    for late, entry in ((arc * (1.0 - 1e-5), own.entry - 1), (arc * 1e-5, own.entry)):
        edge = replace(own, entry=entry, late_entry=late)
        again = fitter.fit(replace(fit.state.with_record(place, edge), model=bent), iterations=60)
        assert again.cost < fit.cost + 0.5
        assert (again.state.nuisances[place].entry, again.state.nuisances[place].late_entry) == (own.entry, 0.0)


def test_ends_nearly_at_a_whole_pass_are_put_there_and_no_others():
    ends, arc = ("entry", "exit"), 0.5
    near = Nuisances(entry=3, late_entry=0.02, exit=20, early_exit=0.98)
    assert nearly_whole(near, ends, arc, 0.1) == Nuisances(entry=3, exit=19)
    assert nearly_whole(replace(near, late_entry=0.47, early_exit=0.52), ends, arc, 0.1) == Nuisances(entry=4, exit=20)
    far = replace(near, late_entry=0.1, early_exit=0.6)
    assert nearly_whole(far, ends, arc, 0.1) == far
    assert nearly_whole(near, ("exit",), arc, 0.1) == replace(near, exit=19, early_exit=0.0)


def test_an_end_that_fails_to_move_on_a_fits_way_is_asked_again_at_its_end(monkeypatch):
    class At(str):
        def with_record(self, place, own):
            return At(f"{own} from {self}")

    costs = {"moved from way": 500.0, "way": 100.0, "moved from way's end": 50.0}

    class Plant:
        records = (SimpleNamespace(cut=True, forces_only=False, size=0),)

        def fit(self, state, iterations, near=None):
            return SimpleNamespace(state=At("way's end") if state == "way" else state, cost=costs[state], converged=True)

    monkeypatch.setattr(parts_of_passes, "best_moved",
                        lambda plant, fit, place: (fit.cost - 60.0 if fit.cost > 50.0 else fit.cost, "moved"))  # fmt: skip
    way = SimpleNamespace(state=At("way"), cost=120.0, converged=False)
    assert parts_of_passes._moved(Plant(), way).state == "moved from way's end"
    way.converged = True  # there is no further way
    assert parts_of_passes._moved(Plant(), way) is way
