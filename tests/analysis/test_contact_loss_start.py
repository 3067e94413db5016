"""Loss of contact under unequal teeth: an effect without a strength, which a model without it has made up for by all it has."""

from functools import partial

import numpy as np
import pytest

from testbed.analysis.fit.effect_start import Origin, switched_on
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.candidate_round import candidate_of, with_effect
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.synthetic_campaign import synthetic_record

CUTTER = Cutter(flutes=2, diameter=0.016)
RUNOUT = {"offset": 4e-6, "angle": 0.0}
TRUE = Model(Structure(1.13, 208.4, 0.0085), CUTTER, Cutting("up-milling", 0.1425, 7.2e8, 2.6e8),
             effects={"runout": RUNOUT, "contact_loss": {}})
BELIEVED = Model(Structure(1.13, 220.9, 0.0102), CUTTER, Cutting("up-milling", 0.1425, 6.3e8, 3.0e8),
                 effects={"runout": RUNOUT})
TESTS = ((3300, 0.6), (2600, 1.0), (4400, 0.5))


@pytest.mark.long
def test_the_effect_is_found_behind_a_fit_that_has_made_up_for_it():
    records = [observe(synthetic_record(partial(fast.simulate, steps=97), TRUE, rpm, depth * 1e-3, 80 + number, noise=3e-7,
                                        feed=8e-5, rate=20000.0, course=(8, 40, 12)), BELIEVED)
               for number, (rpm, depth) in enumerate(TESTS)]
    known = catalogue()
    fitter, fit = model_fit(plant_of(known), records, BELIEVED, known)
    assert fit.mean_squares.max() > 20.0
    origins = [Origin(fit.state, fit.parts)]
    cost, state, _ = switched_on(fitter, known["contact_loss"], origins)
    assert cost < 0.5 * fit.cost and "contact_loss" in state.model.effects
    found = with_effect(candidate_of(fitter, fit, (), None, 1.0), "contact_loss", known, origins, print)
    assert found.fit.mean_squares.max() < 1.1
    cutting = found.fit.state.model.cutting
    assert np.isclose(cutting.tangential_coefficient, 7.2e8, rtol=0.02)
    assert np.isclose(cutting.normal_coefficient, 2.6e8, rtol=0.05)
