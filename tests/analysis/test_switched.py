"""Loss of contact where a model that does not know it would need it: told where its chips would be negative, nowhere else."""

from dataclasses import replace
from functools import partial

import pytest

from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.fit.switched import switch_note, switchable
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

KNOWN = catalogue()
PLANT = plant_of(KNOWN)


@pytest.fixture(scope="module")
def fitted():
    records = synthetic_campaign(partial(fast.simulate, steps=37), TRUE, seed=9, course=(6, 20, 6), rate=6400.0,
                                 tests=((3500, 0.8), (3900, 2.2), (2700, 1.5)))
    return base_fit(PLANT, [observe(record, BELIEVED) for record in records], BELIEVED)


def test_stable_cuts_of_a_fitted_model_need_no_switch(fitted):
    fitter, fit = fitted
    assert list(switchable(fitter, fit.state, KNOWN)) == [] and switch_note(fitter, fit.state, KNOWN) == []


def test_a_model_whose_teeth_would_leave_the_work_is_told_so(fitted):
    fitter, fit = fitted
    model = fit.state.model
    harder = fit.state.model.with_values({name: 6.0 * model.value(name)
                                          for name in ("tangential_coefficient", "normal_coefficient")})
    state = replace(fit.state, model=harder)
    ((name, changed),) = switchable(fitter, state, KNOWN)
    assert name == "contact_loss" and 0 < len(changed) <= 3
    (note,) = switch_note(fitter, state, KNOWN)
    assert note.startswith(", ".join(changed)) and "contact_loss, which the model lacks" in note
    knows = replace(state, model=harder.with_effect("contact_loss"))
    assert list(switchable(fitter, knows, KNOWN)) == []
