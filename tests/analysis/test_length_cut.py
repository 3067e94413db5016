"""Wear that goes on from record to record, or begins anew in each: which of both, the records tell."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.fit.estimates import estimates
from testbed.analysis.fit.length_cut import asks_length, carried_on, length_note, moved_by_lengths
from testbed.analysis.fit.observe import observe
from testbed.analysis.information import Z_95
from testbed.analysis.search.refit_from_prior import from_believed
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import begun_later, synthetic_record

KNOWN = catalogue()
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=KNOWN),
                        predict_driven=partial(predict.predict_driven, catalogue=KNOWN))
RATE = 20.0  # 1/m
CUTS = ((3500, 0.8), (2850, 2.9), (3900, 2.2))
PASSES, FEED = 40, 0.1016e-3


def campaign(one_tool, early_exit=0.0):
    """Cuts of PASSES each, less a share of the last, by one tool or by a fresh edge each; the records say nothing of it."""
    records = []
    for number, (rpm, depth) in enumerate(CUTS):
        before = number * (PASSES - early_exit) * FEED if one_tool else 0.0

        def simulate(model, cut, sampling, before=before):
            return fast.simulate(model, replace(cut, length_cut_before=before, early_exit=early_exit), sampling, steps=37)

        record = synthetic_record(simulate, TRUE.with_effect("tool_wear", rate=RATE), rpm, depth * 1e-3, 40 + number,
                                  course=(8, PASSES, 12))
        records.append(observe(record, BELIEVED))
    return records


@pytest.mark.parametrize("one_tool", [True, False])
def test_the_rate_of_wear_is_found_whether_or_not_the_tool_was_changed(one_tool):
    records = campaign(one_tool)
    found = from_believed(ENGINE, records, BELIEVED, ["tool_wear"], KNOWN)
    assert found.parameters["tool_wear.rate"] == pytest.approx(RATE, rel=0.03)
    assert bool(length_note(records, found.fitter.records)) is one_tool
    lengths = [record.cut.length_cut_before for record in found.fitter.records]
    assert lengths == pytest.approx([number * PASSES * FEED if one_tool else 0.0 for number in range(len(CUTS))], abs=1e-9)


def test_a_cut_that_ends_within_an_arc_is_as_long_as_that_says():
    found = from_believed(ENGINE, campaign(True, early_exit=0.93), BELIEVED, ["tool_wear"], KNOWN)
    records, own = found.fitter.records, found.fit.state.nuisances
    assert [one.early_exit for one in own] == pytest.approx([0.93] * len(CUTS), abs=0.01)
    idle = 1.0 - found.fit.state.share_in_arc(records[0])
    begun = [number * 0.5 * idle for number in range(len(CUTS))]  # before each, in the middle of the time of no tooth
    passes = [record.cut.length_cut_before / FEED - one for record, one in zip(records, begun, strict=True)]
    assert passes == pytest.approx([number * (PASSES - 0.93) for number in range(len(CUTS))], abs=0.03)


def test_what_no_record_shows_of_the_lengths_widens_the_interval_by_what_it_moves():
    """Against fits with cuts longer by that, all alike or each alone: where one ends between two teeth shows nowhere."""
    found = from_believed(ENGINE, campaign(True), BELIEVED, ["tool_wear"], KNOWN)
    fitter, fit = found.fitter, found.fit
    place = fit.names.index("tool_wear.rate")
    unseen = (1.0 - fit.state.share_in_arc(fitter.records[0])) * (2.0 / 12.0) ** 0.5 * FEED

    def moved(longer):
        before = np.cumsum([0.0, *longer[:-1]]) * unseen
        records = [replace(record, cut=replace(record.cut, length_cut_before=record.cut.length_cut_before + more))
                   for record, more in zip(fitter.records, before, strict=True)]
        refitted = fitter.on(records).fit(fit.state, tolerance=1e-12).state.model
        return refitted.value("tool_wear.rate") - fit.state.model.value("tool_wear.rate")

    ways = [moved(longer) for longer in ((1, 1, 1), (1, 0, 0), (0, 1, 0))]
    assert moved_by_lengths(fitter, fit)[:, place] == pytest.approx(ways, rel=0.05) and ways[0] < -1e-3 * RATE
    told = fitter.on([replace(record, length_summed=False) for record in fitter.records])
    expected = np.hypot(half_interval(told, fit), Z_95 * np.linalg.norm(ways))
    assert half_interval(fitter, fit) == pytest.approx(expected, rel=0.02)


def half_interval(fitter, fit):
    """Half of the rate's interval."""
    rate = estimates(fitter, fit, KNOWN)["tool_wear.rate"]
    return 0.5 * (rate.high - rate.low)


def test_what_was_cut_before_a_record_that_begins_in_the_cut_is_its_own_unknown():
    def simulate(model, cut, sampling):
        return fast.simulate(model, replace(cut, length_cut_before=0.012), sampling, steps=37)

    (rpm, depth), worn = CUTS[-1], TRUE.with_effect("tool_wear", rate=RATE)
    last = synthetic_record(simulate, worn, rpm, depth * 1e-3, 42, course=(8, PASSES, 12))
    records = [*campaign(False)[:2], observe(begun_later(last, 20), BELIEVED)]
    found = from_believed(ENGINE, records, BELIEVED, ["tool_wear"], KNOWN)
    own = found.fit.state.nuisances
    assert [record.begins_cutting(one) for record, one in zip(records, own, strict=True)] == [False, False, True]
    assert [one.length == 0.0 for one in own] == [True, True, False]
    assert found.parameters["tool_wear.rate"] == pytest.approx(RATE, rel=0.04)


def test_what_a_record_states_is_believed():
    records = campaign(False)
    assert carried_on(records) is not None and carried_on(records[:1]) is None
    stated = [replace(records[0], cut=replace(records[0].cut, length_cut_before=0.01)), *records[1:]]
    assert carried_on(stated) is None


def test_only_what_grows_with_the_length_cut_asks_for_it():
    assert asks_length(["edge_force", "tool_wear"], KNOWN) and not asks_length(["edge_force", "helix"], KNOWN)
