"""The force that a machine in x and y lacks is found along both axes, by closed forms; maps and orbits stand on the page."""

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.comparison.compare import compare
from testbed.analysis.comparison.compare_plots import pictures
from testbed.analysis.comparison.orbit import orbits
from testbed.analysis.comparison.residual_views import CALIBRATED
from testbed.analysis.fit.held_out import RecordError
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.force.cut_variables import Edges, course_of
from testbed.analysis.force.force_state import force_states
from testbed.analysis.force.planar_force import planar_force
from testbed.analysis.report.compare_page import compare_page
from testbed.catalogue import catalogue
from testbed.engines import fast
from testbed.engines import predict as engine
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from tests.support import planar_campaign as campaign
from tests.support.planar_campaign import PLACES

KNOWN = catalogue()
ENGINE = SimpleNamespace(predict_cuts=engine.predict_cuts, predict_driven=engine.predict_driven)
TWO = Model(Structure.of((Mode(2.5, 146.6, 0.01, math.radians(12)), Mode(0.6, 310.0, 0.02, math.radians(100), "tool"))),
            Cutter(2, 20e-3), Cutting("down-milling", 0.2, 6e8, 2e8))
EDGE = (1e5, 5e4)  # N/m, tangential and normal
TESTS = ((3800, 0.3e-3), (3300, 0.2e-3))


def fitted(true, noise, monkeypatch, places=PLACES, tests=TESTS[:1]):
    """(fitter, fit) of the true machine to its own records, nothing but the records' own unknowns free."""
    monkeypatch.setitem(campaign.NOISE, "displacement", noise)
    records = campaign.planar_campaign(partial(fast.simulate, steps=37), true, tests, places, 3, (4, 20, 8), rate=8000.0)
    return model_fit(ENGINE, [observe(record, TWO) for record in records], true, KNOWN, free=[])


@pytest.mark.long
@pytest.mark.parametrize(("noise", "alike", "off"), [(1e-7, 0.95, 0.04), (1e-6, 0.9, 0.1)])
def test_an_edge_force_left_out_is_found_along_x_and_y(monkeypatch, noise, alike, off):
    fitter, fit = fitted(TWO.with_effect("edge_force", tangential=EDGE[0], normal=EDGE[1]), noise, monkeypatch)
    state = replace(fit.state, model=TWO)
    found, _ = planar_force(ENGINE, fitter.records[0], state, KNOWN)
    course = course_of(fitter.records[0], state, 0, KNOWN)
    edges = Edges(course.cell, course.share, {"angle": course.rows["angle"]})
    truth = edges.force(*(one * course.rows["depth"] for one in EDGE), len(course.time))
    assert [one.name[-8:] for one in found] == [" along x", " along y"]
    for one, right in zip(found, map(course.sampled, (truth.along, truth.across)), strict=True):
        assert np.corrcoef(one.force, right)[0, 1] > alike
        assert one.force.mean() == pytest.approx(right.mean(), rel=off)
        assert one.force[one.cutting].mean() == pytest.approx(right[one.cutting].mean(), rel=2 * off)
        assert np.sqrt(np.mean((one.force - right) ** 2)) < 2.0 * one.deviation


@pytest.mark.long
def test_a_mode_believed_too_soft_lacks_a_spring_along_its_axis_and_what_x_alone_shows_is_no_force_along_y(monkeypatch):
    true = TWO.with_values({"modes[1].direction": math.pi / 2})
    fitter, fit = fitted(true, 1e-7, monkeypatch)
    soft = true.with_values({"modes[1].natural_frequency": 290.0})
    state = replace(fit.state, model=soft)
    (along_y,), _ = planar_force(ENGINE, fitter.records[0], state, KNOWN)
    out = ~along_y.cutting
    slope = np.polyfit(along_y.displacement[out], along_y.force[out], 1)[0]
    lacks = soft.structure.modes[1].stiffness - true.structure.modes[1].stiffness
    assert lacks < 0 and slope == pytest.approx(lacks, rel=0.2)
    record = fitter.records[0]
    kept = [place for place, name in enumerate(record.channels) if name == "displacement"]
    blind = replace(record, channels=("displacement",), data=record.data[kept], noise=record.noise[kept])
    assert not any("along y" in one.name for one in planar_force(ENGINE, blind, state, KNOWN)[0])


@pytest.mark.long
def test_the_page_of_a_machine_in_x_and_y_has_orbits_and_force_maps(monkeypatch):
    fitter, _ = fitted(TWO.with_effect("edge_force", tangential=EDGE[0], normal=EDGE[1]), 2e-7, monkeypatch, tests=TESTS)
    found = compare(ENGINE, fitter.records, TWO, KNOWN)
    states = force_states(ENGINE, found.fitter, found.fit, found.errors, KNOWN)
    assert any("along y, while a tooth cuts" in one.name for one in states)
    page = compare_page(found, TWO, KNOWN, {}, force_maps=[(one.name, one.x, one.v, one.force) for one in states]).html()
    assert "Does the motion in the plane turn as predicted?" in page and "along y, while a tooth cuts)" in page
    assert {"orbit", "force_state_map", "misfit_on_chart"} <= set(pictures(found, None, states, CALIBRATED, {}))
    uneven = replace(TWO, cutter=Cutter(2, 20e-3, pitch_angles=(math.radians(172), math.radians(188))))
    fit = replace(found.fit, state=replace(found.fit.state, model=uneven))
    assert force_states(ENGINE, found.fitter, fit, found.errors, KNOWN) == []  # its teeth are not followed


def test_an_orbit_is_what_both_sensors_of_a_carrier_gave(monkeypatch):
    monkeypatch.setitem(campaign.NOISE, "displacement", 1e-7)
    places = PLACES[:3]  # of the tool x alone
    record, = campaign.planar_campaign(partial(fast.simulate, steps=37), TWO, TESTS[:1], places, 3, (4, 20, 8), rate=8000.0)
    one = observe(record, TWO)
    rest = 0.25 * (one.data - (one.data @ one.drift) @ one.drift.T)
    orbit, = orbits([one], [RecordError(one.name, 0.25, 0.0, rest, 1.0, 1.0, 1.0)], {})
    assert orbit.quantity == "displacement of the workpiece" and orbit.unit == "µm"
    assert orbit.measured.shape[1] == pytest.approx(3 * one.period * one.rate, abs=1) and np.ptp(orbit.measured[0]) > 5.0
    assert np.allclose(orbit.predicted, 0.75 * orbit.measured, atol=1e-9)
