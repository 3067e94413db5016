"""A machine that was another one in every test: each record alone agrees, and what differs is told."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest

from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.diagnose import diagnose
from testbed.analysis.search.homogeneity_check import differing, each_alone
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import TESTS, synthetic_record

KNOWN = catalogue()
CANDIDATES = {name: KNOWN[name] for name in ("process_damping", "edge_force")}
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=KNOWN),
                        predict_driven=partial(predict.predict_driven, catalogue=KNOWN))
SHARES = (0.3, -0.8, 1.0, -0.2)


def records(spread, **effects):
    """Four cuts by another step size than the fit's, the frequency of each its own."""
    found = []
    for number, (share, (rpm, depth)) in enumerate(zip(SHARES, TESTS, strict=False)):
        own = TRUE.with_values({"natural_frequency": TRUE.structure.natural_frequency * (1.0 + spread * share)})
        for name, values in effects.items():
            own = own.with_effect(name, **values)
        found.append(synthetic_record(partial(fast.simulate, steps=37), own, rpm, depth * 1e-3, 90 + number, rate=6400.0))
    return [observe(replace(record, name=f"cut {number}"), BELIEVED) for number, record in enumerate(found)]


@pytest.mark.long
def test_a_frequency_that_differs_from_test_to_test_is_told_and_no_effect_blamed():
    found = diagnose(ENGINE, records(0.01), BELIEVED, CANDIDATES, most=1)
    assert found.verdict == "unexplained" and found.effects == ()
    assert "Each record alone agrees" in found.sentence and "natural_frequency" in found.sentence
    assert "cut 1 145.25" in found.sentence and "cut 2 147.89" in found.sentence


def test_the_values_are_those_of_each_test():
    some = records(0.01)
    apart = each_alone(ENGINE, some, BELIEVED, KNOWN, range(len(some)))
    assert [one.path for one in apart] == ["natural_frequency"]
    for share, one in zip(SHARES, apart[0].values.values(), strict=True):
        true = TRUE.structure.natural_frequency * (1.0 + 0.01 * share)
        assert abs(one.value - true) < 1.6 * (one.high - one.low) / 2 and one.value == pytest.approx(true, rel=1e-4)


def test_one_machine_for_all_records_or_an_effect_within_them_is_no_such_thing():
    some = records(0.0)
    assert each_alone(ENGINE, some, BELIEVED, KNOWN, range(len(some))) == []
    some = records(0.01, cubic_stiffness={"coefficient": 3e13})
    assert each_alone(ENGINE, some, BELIEVED, KNOWN, range(len(some))) == []


def test_values_within_their_intervals_or_hardly_apart_do_not_differ():
    def tests(values, half):
        return {f"{number}": {"natural_frequency": Estimate(one, one - half, one + half, "Hz")}
                for number, one in enumerate(values)}

    assert differing(tests([146.0, 147.0, 148.0], 2.0)) == []
    assert differing(tests([146.0, 146.01, 146.02], 1e-4)) == []
    assert differing(tests([146.0, 147.0], 1e-4)) == []
    (found,) = differing(tests([146.0, 147.0, 148.0], 0.01))
    assert found.sentence == "natural_frequency (Hz: 0 146, 1 147, 2 148)"
    (found,) = differing(tests([140.0 + one for one in range(9)], 0.01))
    assert found.sentence == "natural_frequency, from 140 to 148 Hz"
