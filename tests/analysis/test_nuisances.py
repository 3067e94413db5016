"""The ends of a cut, moved by parts of a pass: always a whole pass and a share of one, whatever rounding does."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbed.analysis.fit.nuisances import MISSING, Nuisances, end_moved, end_moved_in_arc

ENDS = sorted(MISSING)


@pytest.mark.parametrize(("end", "by", "place", "share"), [
    ("entry", 0.25, 7, 0.25), ("entry", 1.25, 8, 0.25), ("entry", -0.25, 6, 0.75), ("entry", -1.0, 6, 0.0),
    ("exit", 0.25, 7, 0.25), ("exit", 1.25, 6, 0.25), ("exit", -0.25, 8, 0.75), ("exit", 0.0, 7, 0.0),
])
def test_what_is_missing_beyond_a_pass_is_missing_of_the_next(end, by, place, share):
    moved = end_moved(Nuisances(entry=7, exit=7), end, by)
    assert getattr(moved, end) == place and getattr(moved, MISSING[end]) == pytest.approx(share)


@pytest.mark.parametrize("end", ENDS)
def test_a_hair_less_than_a_whole_pass_is_the_whole_pass(end):
    whole = Nuisances(entry=7, exit=7)
    assert end_moved(whole, end, -1e-17) == whole


@given(st.sampled_from(ENDS), st.floats(0.0, 1.0, exclude_max=True), st.floats(-5.0, 5.0))
def test_a_share_stays_a_share(end, missing, by):
    begun = Nuisances(entry=7, exit=70).with_fields(**{MISSING[end]: missing})
    moved = end_moved(begun, end, by)
    outwards = 1 if end == "entry" else -1
    assert 0.0 <= getattr(moved, MISSING[end]) < 1.0
    there = outwards * getattr(moved, end) + getattr(moved, MISSING[end])
    assert there == pytest.approx(outwards * getattr(begun, end) + missing + by, abs=1e-12)


@pytest.mark.parametrize(("end", "missing", "by", "place", "share"), [
    ("entry", 0.0, 0.5, 7, 0.1), ("entry", 0.0, -0.5, 6, 0.1), ("entry", 0.1, 0.75, 8, 0.05), ("entry", 0.6, -0.5, 7, 0.1),
    ("exit", 0.0, 0.5, 7, 0.9), ("exit", 0.0, -0.5, 8, 0.9), ("exit", 0.9, 0.75, 6, 0.85), ("exit", 0.4, 0.5, 7, 0.9),
])
def test_in_units_of_the_arc_where_no_tooth_cuts_is_skipped(end, missing, by, place, share):
    moved = end_moved_in_arc(Nuisances(entry=7, exit=7).with_fields(**{MISSING[end]: missing}), end, by, 0.2)
    assert getattr(moved, end) == place and getattr(moved, MISSING[end]) == pytest.approx(share)


@given(st.sampled_from(ENDS), st.floats(0.05, 1.0), st.floats(-5.0, 5.0))
def test_a_share_in_an_arc_stays_a_share(end, arc, by):
    whole = Nuisances(entry=7, exit=70)
    moved = end_moved_in_arc(whole, end, by, arc)
    assert 0.0 <= getattr(moved, MISSING[end]) < 1.0
    back = end_moved_in_arc(moved, end, -by, arc)
    outwards = 1 if end == "entry" else -1
    gone = getattr(back, MISSING[end]) - (1.0 - arc if end == "exit" and getattr(back, MISSING[end]) > 0.0 else 0.0)
    assert outwards * getattr(back, end) + gone / arc == pytest.approx(outwards * getattr(whole, end), abs=1e-9)
