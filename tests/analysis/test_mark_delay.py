"""A delay of the sensor against the tachometer is told, with its size; a mark that stays where it is on the shaft is not."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.moves import TOLD
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.solve import solve
from testbed.analysis.search.mark_delay import delay_note
from testbed.api.fitting import engine_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

TESTS = ((3500, 0.8), (2850, 2.0), (4200, 1.5))
FITTED = partial(model_fit, engine_of(catalogue()), model=BELIEVED, catalogue=catalogue())


def moved_marks(moved, model=TRUE):
    """Cuts whose marks come later than the shaft has them by `moved` (s), one for each record."""
    records = []
    made = synthetic_campaign(partial(fast.simulate, steps=37), model, seed=4, tests=TESTS, course=(10, 40, 15), rate=6400.0)
    for record, late in zip(made, moved, strict=True):
        recording = replace(record.recording, marks=record.recording.marks + late)
        records.append(observe(replace(record, recording=recording), BELIEVED))
    return records


def noted(moved, model=TRUE):
    """The note on such cuts, by a fit that doubts their marks."""
    records = moved_marks(moved, model)
    return delay_note(records, *solve(*FITTED(records=records), TOLD))


@pytest.mark.parametrize(("delay", "said"), [(0.5e-3, "the marks come"), (-0.5e-3, "the motion comes")])
def test_a_delay_is_told_with_its_size_and_sign(delay, said):
    (note,) = noted([delay] * 3)
    assert said in note and float(re.search(r"come\w* ([\d.]+) ms", note)[1]) == pytest.approx(0.5, rel=0.05)


def test_a_mark_that_moves_by_steps_is_told_and_one_that_stays_is_not():
    periods = np.array([60.0 / rpm for rpm, _ in TESTS])
    (note,) = noted(periods * [0.0, 0.02, 0.02])
    assert float(re.search(r"from record to record, by ([\d.]+) deg", note)[1]) == pytest.approx(7.2, rel=0.05)
    assert noted([0.0] * 3) == []


def test_of_a_model_that_lacks_much_nothing_is_said():
    assert noted([0.5e-3] * 3, TRUE.with_effect("edge_force", tangential=2e4, normal=3e4)) == []


def test_marks_that_the_motion_contradicts_are_held_loosely_and_others_as_well_as_they_are_known():
    agreeing = FITTED(records=moved_marks([0.0] * 3))
    assert solve(*agreeing, TOLD) == agreeing
    fitter, fit = FITTED(records=moved_marks([0.5e-3] * 3))
    wider, found = solve(fitter, fit, TOLD)
    off = [record.off_marks(own)[0] for record, own in zip(fitter.records, fit.state.nuisances, strict=True)]
    held = [record.off_marks(own)[0] for record, own in zip(wider.records, found.state.nuisances, strict=True)]
    assert np.abs(off).max() > 5.0 and np.abs(held).max() < 2.0
    assert found.cost < fit.cost - 10.0
    lacking = FITTED(records=moved_marks([0.5e-3] * 3, TRUE.with_effect("edge_force", tangential=2e4, normal=3e4)))
    assert solve(*lacking, TOLD) == lacking
