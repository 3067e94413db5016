"""Samples at the jumps of a force, as an accelerometer of finite bandwidth shows them, in a campaign."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.moves import every_move
from testbed.analysis.fit.moves.force_jumps import BESIDE
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.add_effect import add_effect
from testbed.api.fitting import engine_of
from testbed.catalogue import catalogue
from testbed.cut import Cut
from testbed.engines import fast
from testbed.workshop import RPM, Measurement, measured_cut
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import MARK_ANGLE

EDGE = {"tangential": 3.0e4, "normal": 4.0e4}
TESTS = ((3810, 2.0), (2850, 2.5), (4300, 1.5))
WHOLE = ((0.0, 0.0),) * 3
NOISE = 0.05  # m/s^2
FINER = 4  # fine samples in half a measured one
HOW = Measurement(noise=NOISE, mark_angle=MARK_ANGLE, count=1e-6)
FITTED = partial(model_fit, engine_of(catalogue()), catalogue=catalogue())


def sensed(model, cut, sampling):
    """The acceleration, each sample the mean over the quarter of a sample to either side."""
    step = 1.0 / (2 * FINER * sampling.rate)
    fine = replace(sampling, rate=1.0 / step, count=2 * FINER * sampling.count)
    clean = fast.simulate(model, cut, fine, channels=["acceleration"], steps=610 if cut.late_entry or cut.early_exit else 61)
    values = clean.channels["acceleration"]
    near = sum(np.roll(values, by) for by in (-2, -1, 0, 1, 2)) / 5
    channels = {"displacement": near[:: 2 * FINER]}
    return replace(clean, channels=channels, units={"displacement": "m"}, sampling_rate=sampling.rate)


def campaign(model, parts=WHOLE):
    """Cuts as `TESTS` has them; parts: shares of the first and the last pass that are not cut."""
    records = []
    for number, ((rpm, depth), (late, early)) in enumerate(zip(TESTS, parts, strict=True)):
        def in_part(model, cut, sampling, late=late, early=early):
            return sensed(model, replace(cut, late_entry=late, early_exit=early), sampling)

        record = measured_cut(in_part, model, Cut(rpm * RPM, depth * 1e-3, 0.1016e-3, 15, 50, 25), HOW, 60 + number, f"{rpm}")
        values = record.recording.channels["displacement"]
        recording = replace(record.recording, channels={"acceleration": values}, units={"acceleration": "m/s^2"})
        records.append(observe(replace(record, recording=recording), BELIEVED))
    return records


@pytest.fixture(scope="module")
def records():
    return campaign(TRUE.with_effect("edge_force", **EDGE))


def test_what_the_jumps_show_bends_nothing(records, monkeypatch):
    believed = BELIEVED.with_effect("edge_force", **EDGE)
    fitter, fit = FITTED(records=records, model=believed)
    assert fit.mean_squares.max() < 1.05
    true = TRUE.cutting
    for place, value in ((fit.names.index("tangential_coefficient"), true.tangential_coefficient),
                         (fit.names.index("normal_coefficient"), true.normal_coefficient),
                         (fit.names.index("edge_force.normal"), EDGE["normal"])):
        assert abs(fit.state.model.value(fit.names[place]) - value) < 4 * fit.covariance[place, place] ** 0.5
    for record, own in zip(fitter.records, fit.state.nuisances, strict=True):
        passes = own.exit - own.entry
        assert record.samples - record.count <= 2 * passes * math.ceil(2 * BESIDE)
        assert record.size == record.count < record.samples
        laid_out = record.on_samples(record.project(record.data))
        assert np.count_nonzero(laid_out[0] == 0.0) == record.samples - record.count
    monkeypatch.delitem(every_move(), "force_jumps")
    assert FITTED(records=records, model=believed)[1].mean_squares.max() > 1.3


@pytest.mark.long
def test_the_jumps_are_where_the_model_with_the_effect_places_them(records):
    found = add_effect(engine_of(catalogue()), records, BELIEVED, catalogue()["edge_force"], catalogue())
    assert found.after < 1.03 * found.noise_floor < 0.5 * found.before
    assert found.parameters["edge_force.normal"].value == pytest.approx(EDGE["normal"], rel=1e-3)


def test_cuts_that_begin_or_end_within_an_arc_are_seen_behind_the_jumps():
    """With the samples at the jumps, which weigh more than all the rest, no part of a pass seems worth it."""
    parts = ((0.07, 0.0), (0.0, 0.93), (0.11, 0.0))
    records = campaign(TRUE, parts)
    _, fit = FITTED(records=records, model=BELIEVED)
    assert fit.mean_squares.max() < 1.1  # the engine's step that is cut in part is of second order
    for own, (late, early) in zip(fit.state.nuisances, parts, strict=True):
        assert own.late_entry == pytest.approx(late, abs=0.01)
        assert own.early_exit == pytest.approx(early, abs=0.01)
    for path in ("tangential_coefficient", "normal_coefficient"):
        place = fit.names.index(path)
        assert abs(fit.state.model.value(path) - TRUE.value(path)) < 4 * fit.covariance[place, place] ** 0.5


def test_a_displacement_has_no_jumps():
    record = measured_cut(partial(fast.simulate, steps=61), TRUE, Cut(3810 * RPM, 2e-3, 0.1016e-3, 15, 40, 25),
                          Measurement(), 3, "smooth")
    fitter, _ = FITTED(records=[observe(record, BELIEVED)], model=BELIEVED)
    assert fitter.records[0].mask is None and fitter.records[0].count == fitter.records[0].samples
