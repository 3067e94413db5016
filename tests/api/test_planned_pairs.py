"""`plan` where what lacks has bent the model to what no machine is: the diagnosis says what is open, and cuts tell it apart."""

import pytest

import testbed
from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.observe import observe
from testbed.catalogue import catalogue
from testbed.files.campaign import Campaign
from tests.support.campaign_files import BELIEVED
from tests.validation.hard_pairs import ENGINE, cases


@pytest.mark.long
def test_a_pair_that_makes_coefficients_impossible_is_planned_for():
    case = next(one for one in cases() if one.hidden == "edge_force" and not one.separates)
    records = case.maker(case.truth, 106)
    assert compare(ENGINE, [observe(one, BELIEVED) for one in records], BELIEVED, catalogue()).against
    reach = "4000 rpm:4350 rpm:2", "2 mm:3 mm:2"
    found = testbed.plan(Campaign("tied", tuple(records)), BELIEVED, *reach, draws=40, progress=False)
    assert found.no_plan is None and set(found.explanations) == {"edge_force", "chip_force_exponent"}
    assert any(set(one.separates) == set(found.explanations) for one in found.next)
