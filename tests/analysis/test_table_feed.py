"""A table that travels as it was told to, under a spindle that does not turn as it was told to."""

from dataclasses import replace
from functools import partial

import pytest

from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.moves.table_feed import feed_note, with_other_feed
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.record_hypotheses import taken_notes
from testbed.analysis.search.diagnose import diagnose
from testbed.api.fitting import engine_of
from testbed.catalogue import catalogue
from testbed.cut import Cut
from testbed.engines import fast
from testbed.files.manifest import Feed
from testbed.workshop import RPM, Measurement, measured_cut
from tests.support.campaign_files import BELIEVED, TRUE

TESTS = ((3810, 2.9, 1.01), (2850, 2.9, 0.992), (3500, 0.8, 1.0))  # rpm as stated, mm, true over stated speed
FEED = 1e-4  # m a tooth, as stated
A_TOOTH = Feed(FEED, "tooth")
FINE = Measurement(noise=3e-7, rate=6400.0)


def campaign(*, table, written=A_TOOTH, true=TRUE):
    """Cuts by another step size than the fit's, stated at other speeds than they had; table: whether it travels as stated."""
    found = []
    for seed, (rpm, depth, ratio) in enumerate(TESTS):
        cut = Cut(ratio * rpm * RPM, depth * 1e-3, FEED / ratio if table else FEED, 12, 60, 25)
        record = measured_cut(partial(fast.simulate, steps=37), true, cut, FINE, seed, f"c{seed}")
        conditions = {**record.conditions, "spindle_speed": rpm * RPM, "feed_per_tooth": FEED, "feed_per_revolution": FEED}
        recording = replace(record.recording, conditions=conditions)
        feed = Feed(FEED * rpm / 60, "second") if written.per == "second" else written
        found.append(observe(replace(record, conditions=conditions, recording=recording, feed=feed), BELIEVED))
    return found


@pytest.mark.parametrize("table", [True, False])
def test_the_data_choose_what_a_tooth_cuts(table):
    records = campaign(table=table)
    found = compare(engine_of(catalogue()), records, BELIEVED, catalogue())
    assert found.error == pytest.approx(found.noise_floor, rel=0.02)
    assert bool(feed_note(records, found.fitter.records)) == table
    for record, (_, _, ratio) in zip(found.fitter.records, TESTS, strict=True):
        assert record.cut.feed_per_tooth == pytest.approx(FEED / ratio if table else FEED, rel=1e-3)
    one = found.parameters["damping_ratio"]
    assert abs(one.value - TRUE.structure.damping_ratio) < one.high - one.low


@pytest.mark.parametrize("table", [True, False])
@pytest.mark.long
def test_a_missing_effect_is_named_whatever_the_table_does(table):
    """Without it, the base fit may lean on the other feed: with it, that is asked again."""
    known = {name: catalogue()[name] for name in ("process_damping", "edge_force")}
    records = campaign(table=table, true=TRUE.with_effect("process_damping", coefficient=2e5))
    found = diagnose(engine_of(catalogue()), records, BELIEVED, known)
    assert (found.verdict, found.effects) == ("missing_effect", ("process_damping",))
    assert found.with_effects == pytest.approx(found.noise_floor, rel=0.03)
    assert bool(feed_note(records, found.best.fitter.records)) == table
    assert found.best.parameters["process_damping.coefficient"] == pytest.approx(2e5, rel=0.05)


def test_what_was_taken_is_told_of_the_records_that_a_fit_has():
    """A search may leave records out, and tells of the others all the same."""
    records = campaign(table=True)
    other = with_other_feed(records, State(BELIEVED, 0.0, tuple(first_nuisances(record, 0.0) for record in records)))
    assert taken_notes(records, records[1:]) == [] and taken_notes(records, other[1:]) == feed_note(records, other)
    assert len(feed_note(records, other)) == 1


def test_a_speed_of_travel_leaves_nothing_to_choose():
    records = campaign(table=True, written=Feed(FEED, "second"))
    assert all(record.feed_basis == "travel" for record in records)
    found = compare(engine_of(catalogue()), records, BELIEVED, catalogue())
    assert found.error == pytest.approx(found.noise_floor, rel=0.02) and feed_note(records, found.fitter.records) == []


def test_a_table_leaves_less_to_a_tooth_of_a_spindle_that_turns_faster():
    """Where the speed is found by a fit, what a table travels in a second stays; what was written a tooth stays, too."""
    for written, left in ((Feed(FEED, "second"), 1.02), (A_TOOTH, 1.0)):
        record = campaign(table=True, written=written)[0]
        slow, fast_ = (record.timeline(0.0, Nuisances(exit=20, speed=speed))[0] for speed in (1.0, 1.02))
        assert slow.feed_per_tooth / fast_.feed_per_tooth == pytest.approx(left)
    assert fast_.spindle_speed == pytest.approx(1.02 * slow.spindle_speed)
