"""A depth or feed written down wrong: one record contradicts all others, and what it shows instead is told."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.search.diagnose import diagnose
from testbed.analysis.search.misstated import misstated
from testbed.analysis.search.unheard import agreed
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_record

KNOWN = catalogue()
PLANT = plant_of(KNOWN)
TESTS = ((3500, 0.8), (2850, 2.9), (3900, 2.2), (2700, 1.5))
WRONG = 3


def campaign(condition=None, factor=1.0, true=TRUE):
    """Four cuts; of the last, `condition` is stated as `factor` times what it was."""
    records = [observe(synthetic_record(partial(fast.simulate, steps=37), true if place == WRONG else TRUE, rpm, depth * 1e-3,
                                        80 + place, course=(6, 16, 6), rate=6400.0), BELIEVED)
               for place, (rpm, depth) in enumerate(TESTS)]
    if condition is not None:
        cut = records[WRONG].cut
        records[WRONG] = replace(records[WRONG], cut=replace(cut, **{condition: factor * getattr(cut, condition)}))
    return records


@pytest.mark.parametrize(("condition", "factor", "told"), [
    ("axial_depth_of_cut", 2.0, "depth of cut was 1.5 mm, not 3 mm"),
    ("axial_depth_of_cut", 0.6, "depth of cut was 1.5 mm, not 0.9 mm"),
    ("axial_depth_of_cut", 2.7, "depth of cut was 1.5 mm, not 4.05 mm"),
    ("feed_per_tooth", 0.7, "feed per tooth was 0.102 mm, not 0.0711 mm"),
])
@pytest.mark.long
def test_the_wrong_condition_and_its_value_are_told(condition, factor, told):
    records = campaign(condition, factor)
    found = diagnose(PLANT, records, BELIEVED, KNOWN)
    assert found.verdict == "unexplained" and found.effects == ()
    assert told in found.sentence and found.sentence.count(records[WRONG].name) == 2
    for name in ("tangential_coefficient", "damping_ratio"):
        assert found.best.fit.state.model.value(name) == pytest.approx(TRUE.value(name), rel=0.03)  # by three short records


def test_one_factor_of_all_depths_is_the_coefficients_and_the_depth_of_one_record_is_not():
    """Depth and coefficients enter as their product: no records tell them apart, at whatever depths; one is told."""
    softer = TRUE.with_values({name: 0.5 * TRUE.value(name) for name in ("tangential_coefficient", "normal_coefficient")})

    def motion(true, rpm, depth):
        return synthetic_record(partial(fast.simulate, steps=37), true, rpm, depth * 1e-3, 7, course=(6, 16, 6),
                                rate=6400.0, noise=0.0).recording.channels["displacement"]

    for rpm, depth in TESTS:
        stated, doubled = motion(TRUE, rpm, depth), motion(softer, rpm, 2.0 * depth)
        assert np.abs(stated - doubled).max() < 1e-6 * np.ptp(stated)
        assert np.abs(stated - motion(TRUE, rpm, 2.0 * depth)[: len(stated)]).max() > 0.1 * np.ptp(stated)


def test_a_record_of_other_physics_is_not_said_to_be_written_down_wrong():
    fitter, fit = agreed(*base_fit(PLANT, campaign(true=TRUE.with_values({"damping_ratio": 0.02})), BELIEVED))
    assert [record.heard for record in fitter.records] == [True, True, True, False]
    assert misstated(fitter, fit.state, WRONG) is None


def test_a_record_as_it_was_written_down_is_left_alone():
    fitter, fit = base_fit(PLANT, campaign(), BELIEVED)
    assert np.all(fit.mean_squares < 1.15)
    assert misstated(fitter, fit.state, WRONG) is None
