"""Fits of models that are rough: teeth that change places, and records weighed by what is left of them."""

import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.fit import effect_start
from testbed.analysis.fit.drift import drift_basis
from testbed.analysis.fit.effect_start import starting_points
from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.nuisances import Nuisances, other_teeth
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import predict as predicted
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.search.candidate_round import by_noise as in_noise
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.reweight import ROUGH, reweighted
from testbed.catalogue import catalogue
from testbed.cut import Cut
from testbed.engines import fast, predict
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.campaign_files import BELIEVED
from tests.support.synthetic_campaign import synthetic_campaign

TRUE = Model(Structure(2.573, 146.42, 0.0032), Cutter(), Cutting())
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=catalogue()),
                        predict_driven=partial(predict.predict_driven, catalogue=catalogue()))


@pytest.mark.parametrize("flutes", (2, 3, 4))
def test_teeth_may_change_places_again_and_again(flutes):
    own = Nuisances(entry=20, exit=80, angle=0.3)
    begin = own.angle + 2 * math.pi * own.entry / flutes
    for _ in range(50):
        own = other_teeth(own, flutes)[0]
        assert -2 * math.pi < own.angle <= 2 * math.pi  # a simulation that starts turns earlier would end turns too early
        assert own.angle + 2 * math.pi * own.entry / flutes == pytest.approx(begin)
        assert own.exit - own.entry == 60


def test_another_tooth_is_the_first_where_a_record_starts_in_the_cut():
    """Unequal teeth that change places must change what is predicted, half a turn apart: entry and angle moved alike do not."""
    slot = Model(Structure(100.0, 300.0, 0.05), Cutter(flutes=2), Cutting(immersion=0.5))
    slot = slot.with_effect("runout", offset=8e-6, angle=0.3)
    record = Observed("slot", "cut", ("force_x",), np.zeros((1, 800)), 1e4, 0.0, np.ones(1), "", drift_basis(800, 0), (), (),
                      cut=Cut(200 * math.pi, 3e-3, 5e-5), flutes=2, period=0.01, starts_in_cut=True)
    own = first_nuisances(record, 0.3)
    (other,) = other_teeth(own, 2)
    here, there, plain, turned = (
        predicted(ENGINE, record, [(model, 0.3, one)])[0, 0]
        for model, one in ((slot, own), (slot, other), (slot.without_effect("runout"), own),
                           (slot.without_effect("runout"), other))
    )
    unequal = np.std(here - plain)
    assert unequal > 0.1 * np.std(plain)
    assert np.std(plain - turned) < 0.01 * unequal  # equal teeth: nothing has changed
    assert np.std(here - plain + there - turned) < 0.01 * unequal  # the long one is where the short one was


def test_no_angle_that_is_tried_leaves_two_teeth_equal():
    runout = catalogue()["runout"]
    angles = {point["angle"] for point in starting_points(runout, (), None)}
    assert len(angles) == 4
    assert all(abs(math.cos(angle)) > 0.3 for angle in angles)


@pytest.mark.parametrize("channels, directions", [(("displacement",), 1), (("displacement", "force_y"), 1),
                                                  (("tool_acceleration_x", "tool_acceleration_y"), 4)])
def test_a_mode_begins_aslant_only_where_motion_across_tells_its_direction(monkeypatch, channels, directions):
    monkeypatch.setattr(effect_start, "residual_peaks", lambda records, fit: [300.0])
    records = [SimpleNamespace(channels=channels, samples=1000, rate=2000.0)]
    found = {point["direction"] for point in starting_points(catalogue()["second_mode"], records, None)}
    assert len(found) == directions and (directions > 1 or found == {0.0})


def test_a_rough_model_is_fitted_to_all_records_alike():
    true = TRUE.with_effect("cubic_stiffness", coefficient=2e14)
    records = synthetic_campaign(partial(fast.simulate, steps=37), true, seed=6, noise=3e-7,
                                 tests=((3500, 0.4), (2600, 1.5), (3900, 2.5)), rate=6400.0)  # the loud ones outvote the quiet
    fitter, fit = base_fit(ENGINE, [observe(record, BELIEVED) for record in records], BELIEVED)
    by_noise = candidate_of(fitter, fit, (), None, 1.0)
    error, noise = pooled(by_noise.errors)
    assert error > ROUGH * noise
    weighed = reweighted(by_noise)
    assert all((one.weight > 3 * one.noise).all() for one in weighed.fitter.records)
    assert pooled(weighed.errors)[1] == pytest.approx(noise)  # the noise floor is the noise's, whatever the weights

    def relative(one):
        return [np.std(rest * record.scale[0]) / record.data.std()
                for record, rest in zip(one.fitter.records, one.fit.residuals, strict=True)]

    assert max(relative(weighed)) < 0.95 * max(relative(by_noise))  # no record is given up for the sake of another
    back = in_noise(weighed)
    assert all(one.weight is None for one in back.fitter.records)
    assert back.fit.state == weighed.fit.state
    assert back.fit.cost > weighed.fit.cost
    assert in_noise(by_noise) is by_noise
