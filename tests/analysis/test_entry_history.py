"""A structure that still rings as the first teeth enter, cut by a delay equation with its history or from a straight front."""

from functools import partial

import pytest

from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.moves.entry_history import with_other_front
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.record_hypotheses import taken_notes
from testbed.api.fitting import engine_of
from testbed.catalogue import catalogue
from testbed.cut import Cut
from testbed.engines import fast
from testbed.workshop import RPM, Measurement, measured_cut
from tests.support.campaign_files import BELIEVED, TRUE

TESTS = ((3810, 2.9), (2850, 2.9), (3500, 0.8))  # rpm, mm
FINE = Measurement(noise=3e-7, rate=6400.0)


def campaign(*, swung, swing=3e-5):
    """Cuts by another step size than the fit's, that begin with a swing (m) which has not died when the first tooth enters."""
    found = []
    for seed, (rpm, depth) in enumerate(TESTS):
        cut = Cut(rpm * RPM, depth * 1e-3, 1e-4, 12, 60, 25, swing, 0.0, swung_front=swung)
        found.append(observe(measured_cut(partial(fast.simulate, steps=37), TRUE, cut, FINE, seed, f"c{seed}"), BELIEVED))
    return found


@pytest.mark.parametrize("swung", [True, False])
@pytest.mark.long
def test_the_data_choose_what_the_first_teeth_meet(swung):
    records = campaign(swung=swung)
    found = compare(engine_of(catalogue()), records, BELIEVED, catalogue())
    assert found.error == pytest.approx(found.noise_floor, rel=0.02)
    assert [record.swung_front for record in found.fitter.records] == [swung] * len(TESTS)
    assert any("delay equation" in note for note in taken_notes(records, found.fitter.records)) == swung
    for name in ("damping_ratio", "tangential_coefficient", "normal_coefficient"):
        one = found.parameters[name]
        assert abs(one.value - TRUE.value(name)) < one.high - one.low


def test_a_swing_below_the_noise_of_a_sample_tells_of_the_front_too():
    records = campaign(swung=True, swing=5e-7)  # less than the noise where the teeth enter
    state = State(BELIEVED, 0.0, tuple(first_nuisances(record, 0.0).with_fields(displacement=5e-7) for record in records))
    assert all(record.swung_front for record in with_other_front(records, state))


def test_without_a_swing_nothing_is_asked():
    records = campaign(swung=True, swing=0.0)
    state = State(BELIEVED, 0.0, tuple(first_nuisances(record, 0.0) for record in records))
    assert with_other_front(records, state) is None


def test_what_was_taken_as_swung_may_be_straight_again():
    records = campaign(swung=False)
    nuisances = tuple(first_nuisances(record, 0.0).with_fields(displacement=3e-5) for record in records)
    state = State(BELIEVED, 0.0, nuisances)
    swung = with_other_front(records, state)
    assert all(record.swung_front for record in swung)
    assert not any(record.swung_front for record in with_other_front(swung, state))
