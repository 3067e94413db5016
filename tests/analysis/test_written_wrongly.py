"""A condition written down wrongly in all records is named, and no verdict stands on values that no machine has."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.budget import Budgeted, BudgetSpent
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.plausible import against_adequacy, moved_together, remarks_on, unlike_a_machine
from testbed.analysis.search import diagnose as search
from testbed.analysis.search.answer import as_json
from testbed.analysis.search.common_factor import restatements, shown_by_lines
from testbed.analysis.search.diagnose import diagnose
from testbed.engines import fast
from testbed.files.model_file import model_from_text, write_model
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.analysis.test_diagnose import CANDIDATES, ENGINE
from tests.support.campaign_files import BELIEVED
from tests.support.synthetic_campaign import synthetic_campaign

TRUE = Model(Structure(2.573, 146.42, 0.0032), Cutter(2), Cutting(immersion=0.1))
TWO = replace(BELIEVED, cutter=Cutter(2), cutting=replace(BELIEVED.cutting, immersion=0.1))
COEFFICIENTS = ("tangential_coefficient", "normal_coefficient")
TESTS = ((2850, 1.2), (3810, 1.0), (2600, 0.8))


def records(model=TWO):
    """Three cuts by two teeth, from steps of another size than the fit's."""
    made = synthetic_campaign(partial(fast.simulate, steps=37), TRUE, seed=8, tests=TESTS, course=(8, 24, 10), rate=4000.0)
    return [observe(record, model) for record in made]


def with_feed(some, factor):
    return [replace(one, cut=replace(one.cut, feed_per_tooth=factor * one.cut.feed_per_tooth)) for one in some]


@pytest.mark.long
def test_a_feed_per_revolution_written_as_per_tooth_is_named_and_no_effect():
    found = diagnose(ENGINE, with_feed(records(), 2.0), TWO, CANDIDATES)
    assert found.verdict == "unexplained" and found.effects == ()
    assert found.misstated == ("feed", 0.5) and "1/2 of the stated" in found.sentence


@pytest.mark.long
def test_an_insert_taken_out_is_named_and_no_effect():
    four = replace(TWO, cutter=Cutter(4))
    found = diagnose(ENGINE, records(four), four, CANDIDATES)
    assert found.verdict == "unexplained" and found.effects == ()
    assert found.misstated == ("flutes", 2.0) and "if 2 flutes cut, not 4" in found.sentence


def test_every_statement_changes_what_it_says_and_nothing_else():
    some = records()
    for one in restatements(some, TWO):
        assert one.told and math.isfinite(one.factor)
        for before, after in zip(some, one.records, strict=True):
            changed = {"feed": after.cut.feed_per_tooth / before.cut.feed_per_tooth, "flutes": after.flutes}[one.condition]
            assert changed == pytest.approx(one.factor)
            assert after.cut.spindle_speed == before.cut.spindle_speed and np.array_equal(after.data, before.data)
    assert {one.condition for one in restatements(some, TWO)} == {"feed", "flutes"}  # the marks tell the speed


@pytest.mark.parametrize(("heard", "teeth"), [
    ((1.337, 1.33, 1.335), 4), ((1.0, 1.003, 0.998), None), ((1.337, 1.0, 1.335), None), ((1.27, 1.26, 1.27), None)])
def test_teeth_by_which_all_cuts_turn_as_stated_are_tried_whatever_the_openings_say(heard, teeth):
    three = replace(TWO, cutter=Cutter(3))
    some = [replace(one, period=2.0 * math.pi / (factor * one.cut.spindle_speed))
            for one, factor in zip(records(), heard, strict=True)]
    base = SimpleNamespace(fitter=SimpleNamespace(records=some))
    shown = {one.factor for one in restatements(some, three) if shown_by_lines(one, base, three)}
    assert shown == ({teeth} if teeth else set())


@pytest.mark.parametrize("factor", [25.4, 1e-3])
def test_coefficients_decades_off_are_found_and_said(factor):
    """As of a depth written in inches, or of N/m^2 for kN/m^2: no start of the base fit is near."""
    believed = TWO.with_values({path: factor * TWO.value(path) for path in COEFFICIENTS})
    fitter, fit = model_fit(ENGINE, records(), believed, CANDIDATES)
    assert "other_decades" in fit.helped and fit.variance < 1.1
    moved = moved_together(believed, fit.state.model)
    assert moved == pytest.approx(TRUE.value(COEFFICIENTS[0]) / believed.value(COEFFICIENTS[0]), rel=0.5)
    assert "both cutting coefficients came out" in against_adequacy(fitter, fit, believed, CANDIDATES, 1.0, 0.05)[0]


def test_a_search_beside_an_explanation_is_short_and_its_end_is_that_explanation(monkeypatch):
    """Where the base fit leaves little, effects are tried beside a statement that leaves but noise; that does not cost all."""
    monkeypatch.setattr(search, "PLAINLY", math.inf)
    monkeypatch.setattr(search, "FEW_STEPS", 1)
    found = diagnose(ENGINE, with_feed(records(), 2.0), TWO, CANDIDATES)
    assert found.verdict == "unexplained" and found.misstated == ("feed", 0.5) and found.effects == ()


def test_a_budget_ends_a_diagnosis_with_what_is_known_at_the_same_place_every_time():
    some = with_feed(records(), 2.0)
    short = diagnose(ENGINE, some, TWO, CANDIDATES, budget=50)
    assert short.verdict == "not_converged" and "budget (50 simulations" in short.sentence and short.effects == ()
    assert as_json(diagnose(ENGINE, some, TWO, CANDIDATES, budget=50), TWO) == as_json(short, TWO)
    counted = Budgeted(ENGINE, some, 30.0)
    with pytest.raises(BudgetSpent):
        model_fit(counted, some, TWO, CANDIDATES)
    assert counted.spent > 30.0 and counted.known is None
    counted.allow(10.0)
    assert counted.budget == 30.0  # never more than there was
    counted = Budgeted(ENGINE, some, 30.0)
    counted.allow(10.0)
    assert counted.budget == 10.0
    counted.allow_all()  # what it was worth less for is over
    assert counted.budget == 30.0


def of(**values):
    return BELIEVED.with_values(values)


def test_coefficients_that_no_tool_has_are_said_and_written_with_the_model(tmp_path):
    odd = of(normal_coefficient=-1.05e8)
    said, = unlike_a_machine(odd)
    assert "normal_coefficient came out at -105 N/mm^2" in said and "less than 0" in said
    assert "not identified" in remarks_on(BELIEVED, odd)[0]
    assert not unlike_a_machine(BELIEVED) and not remarks_on(BELIEVED, BELIEVED)
    assert "tangential_coefficient" in unlike_a_machine(of(tangential_coefficient=8e5, normal_coefficient=1e5))[0]
    write_model(odd, tmp_path / "odd.yaml", remarks=[said])
    text = (tmp_path / "odd.yaml").read_text()
    assert text.startswith(f"# {said}\n") and model_from_text(text).value("normal_coefficient") == -1.05e8


def test_a_value_outside_by_less_than_its_interval_says_nothing_against_the_fit():
    odd = of(normal_coefficient=-1e6)
    assert not unlike_a_machine(odd, {"normal_coefficient": Estimate(-1e6, -5e6, 3e6, "N/m^2")})
    assert unlike_a_machine(odd, {"normal_coefficient": Estimate(-1e6, -2e6, -1e5, "N/m^2")})


def test_both_coefficients_moved_by_one_factor_name_depth_and_mass():
    times = {path: 10.0 * BELIEVED.value(path) for path in COEFFICIENTS}
    assert moved_together(BELIEVED, of(**times)) == pytest.approx(10.0)
    said, = remarks_on(BELIEVED, of(**times))
    assert "depth of cut" in said and "mass 0.1 times" in said
    assert moved_together(BELIEVED, of(tangential_coefficient=2.0 * times["tangential_coefficient"])) == 1.0
