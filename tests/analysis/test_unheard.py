"""A record that no model follows while the others agree: it must not bend their parameters, and its name is told."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.search.add_effect import add_effect
from testbed.analysis.search.diagnose import diagnose
from testbed.analysis.search.unheard import agreed
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_record

KNOWN = catalogue()
PLANT = plant_of(KNOWN)
LAW, STRENGTH = "process_damping", 2e5
TESTS = ((3500, 0.8), (2850, 2.9), (3900, 2.2), (2700, 1.5))
FREED = ("natural_frequency", "damping_ratio", "tangential_coefficient", "normal_coefficient")


def campaign(true, strange):
    """Four cuts; the machine of the `strange` one has another flexure."""
    simulate = partial(fast.simulate, steps=37)
    models = [true.with_values({"natural_frequency": 171.0}) if place == strange else true for place in range(len(TESTS))]
    return [observe(synthetic_record(simulate, model, rpm, depth * 1e-3, 60 + place, course=(6, 16, 6),
                                     rate=6400.0), BELIEVED)
            for place, (model, (rpm, depth)) in enumerate(zip(models, TESTS, strict=True))]


@pytest.fixture(scope="module")
def linear():
    return base_fit(PLANT, campaign(TRUE, 3), BELIEVED)


def far(fit):
    """How far the parameters are from the truth, in standard errors."""
    errors = dict(zip(fit.names, np.sqrt(np.diag(fit.covariance)), strict=True))
    return max(abs(fit.state.model.value(name) - TRUE.value(name)) / errors[name] for name in FREED)


def test_the_others_decide_where_one_record_is_strange(linear):
    fitter, fit = linear
    assert max(abs(fit.state.model.value(name) / TRUE.value(name) - 1.0) for name in FREED) > 0.05  # one record bends all
    quiet, found = agreed(fitter, fit)
    assert [record.heard for record in quiet.records] == [True, True, True, False]
    assert max(abs(found.state.model.value(name) / TRUE.value(name) - 1.0) for name in FREED) < 0.01
    assert far(found) < 4.0
    again = agreed(quiet, found)
    assert again[0] is quiet and again[1] is found


def test_a_fit_in_which_no_record_stands_out_stays_as_it_is(linear):
    fitter, fit = linear
    few = fitter.of_records([0, 1, 2])
    alone = few.fit(fit.state.of_records([0, 1, 2]))
    assert agreed(few, alone)[1] is alone


def test_a_record_whose_passes_were_wrong_is_heard_again():
    fitter, fit = base_fit(PLANT, campaign(TRUE, None), BELIEVED)
    own = list(fit.state.nuisances)
    own[0] = replace(own[0], entry=own[0].entry + 5, exit=own[0].exit - 4)
    bent = fitter.fit(replace(fit.state, nuisances=tuple(own)), iterations=15)
    assert bent.cost > 5.0 * fit.cost
    quiet, found = agreed(fitter, bent)
    assert quiet is fitter and all(record.heard for record in quiet.records)
    assert found.cost < 1.001 * fit.cost


@pytest.mark.long
def test_a_diagnosis_says_which_record_stands_alone():
    records = campaign(TRUE, 3)
    found = diagnose(PLANT, records, BELIEVED, {name: KNOWN[name] for name in ("helix", LAW)})
    assert found.verdict == "unexplained"  # one record may be the only one to show what is missing
    assert f"All records but {records[3].name} agree with the model as it is" in found.sentence


@pytest.mark.long
def test_an_effect_is_added_to_the_records_that_agree_and_the_other_is_named():
    records = campaign(TRUE.with_effect(LAW, coefficient=STRENGTH), 3)
    added = add_effect(PLANT, records, BELIEVED, KNOWN[LAW], KNOWN)
    assert added.unheard == (records[3].name,)
    before, after, noise = added.heard()
    assert after < 1.05 * noise < 0.5 * before
    assert added.records_after[3].error > 5.0 * added.records_after[3].noise_floor  # predicted all the same, and told
    strength = added.parameters[f"{LAW}.coefficient"]
    assert strength.low < STRENGTH < strength.high
    told = [text for text in added.warnings if records[3].name in text]
    assert len(told) == 1 and f"{after:.4f}" in told[0]
    assert not any("nothing speaks for it" in text for text in added.warnings)
