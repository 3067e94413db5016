"""Chances of stability against closed forms, draws against what was stated, a surface against every chart."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm

from testbed.analysis.linear.stability import StabilityChart, stability_chart
from testbed.analysis.probable.chance import QUANTILES, by_surface, chance_of, charts_on_surface, each_drawn
from testbed.analysis.probable.draws import Known, NoDraws, of_spreads
from testbed.analysis.probable.plot import plot_chance
from testbed.catalogue import catalogue
from testbed.files.model_file import model_from_text
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.campaign_files import TRUE

RPM = math.pi / 30
SLOT = Model(Structure(0.5, 600.0, 0.02), Cutter(4), Cutting("up-milling", 0.5, 6e8, 2e8))


def closed_form_limit(model, speed):
    """Depth (m) at which a slot of four straight flutes, of which the sum of the forces is constant, becomes unstable.

    m x'' + 2 m zeta w x' + m w^2 x = -b K_n (x - x(t - tau)): the least b with a root on the imaginary axis.
    """
    one, tau = model.structure, 2 * math.pi / (4 * speed)
    w = one.natural_frequency_rad

    def loop(omega):
        return (1 - np.exp(-1j * omega * tau)) / (one.mass * (w**2 - omega**2 + 2j * one.damping_ratio * w * omega))

    grid = np.linspace(0.2 * w, 6 * w, 40_001)
    signs = np.sign(loop(grid).imag)
    roots = [brentq(lambda omega: loop(omega).imag, grid[k], grid[k + 1]) for k in np.flatnonzero(np.diff(signs))]
    depths = [-1.0 / (model.cutting.normal_coefficient * loop(root).real) for root in roots if loop(root).real < -1e-15]
    return min(depths)


def test_the_chance_is_that_of_the_closed_form():
    """The limit goes with 1 / K_n, so a cut is stable with the chance that a normal K_n is below what it bears."""
    speeds = np.array([5200.0, 6100.0, 7300.0]) * RPM
    plain = np.array([closed_form_limit(SLOT, speed) for speed in speeds])
    deviation, draws = 0.15 * 2e8, 2000
    known = of_spreads(replace(SLOT, spreads=(("normal_coefficient", deviation),)), catalogue())
    depths = np.linspace(0.6 * plain.min(), 1.5 * plain.max(), 60)
    found = chance_of(each_drawn(stability_chart, known, speeds, depths, draws, 3))
    for column, limit in enumerate(plain):
        bears = 2e8 * limit / depths
        exact = norm.cdf((bears - 2e8) / deviation)
        assert np.all(np.abs(found.probability[:, column] - exact) < 4.5 * np.sqrt(exact * (1 - exact) / draws) + 0.002)
        for share, value in zip(QUANTILES, found.limits[:, column], strict=True):
            exact = limit * 2e8 / (2e8 + deviation * norm.ppf(1 - share))
            assert value == pytest.approx(exact, rel=0.02)
    best = found.recommended(0.05)
    rates = [speed * depth for column, speed in enumerate(speeds) for depth in depths
             if norm.cdf((2e8 * plain[column] / depth - 2e8) / deviation) >= 0.95]
    assert best.spindle_speed * best.axial_depth_of_cut == pytest.approx(max(rates), rel=0.05)
    assert best.stable_probability >= 0.95


def test_draws_have_the_covariance_and_keep_the_bounds():
    covariance = np.array([[4e14, -3.6e14], [-3.6e14, 4e14]])
    known = Known(SLOT, ("tangential_coefficient", "normal_coefficient"), covariance, ((0.0, math.inf), (-math.inf, math.inf)))
    drawn = known.drawn(20_000, 1)
    assert np.allclose(drawn.mean(axis=0), (6e8, 2e8), rtol=2e-3)
    assert np.allclose(np.cov(drawn.T), covariance, rtol=0.04)
    assert np.array_equal(drawn, known.drawn(20_000, 1)) and not np.array_equal(drawn, known.drawn(20_000, 2))
    half = replace(known, bounds=((6e8, math.inf), (-math.inf, 2e8)))
    cut = half.drawn(2000, 1)
    assert cut[:, 0].min() > 6e8 and cut[:, 1].max() < 2e8 and cut[:, 0].mean() > 6.1e8
    with pytest.raises(NoDraws, match="tangential_coefficient"):
        replace(known, bounds=((9e9, math.inf), (-math.inf, math.inf))).drawn(100, 1)


def test_a_stiffness_is_drawn_and_the_mass_follows():
    text = ("structure: {modes: [{natural_frequency: 922 +- 20 Hz, damping_ratio: 0.011 +- 0.01, stiffness: 1.3 +- 0.2 N/um, "
            "direction: y +- 5 deg, on: tool}]}")
    known = of_spreads(model_from_text(text), catalogue())
    drawn = known.drawn(3000, 5)
    machines = [known.at(values).structure for values in drawn]
    stiffness = np.array([one.stiffness for one in machines])
    assert np.allclose(stiffness, drawn[:, known.paths.index("modes[0].stiffness")], rtol=1e-12)
    assert stiffness.mean() == pytest.approx(1.3e6, rel=0.01) and stiffness.std() == pytest.approx(2e5, rel=0.05)
    frequencies = np.array([one.natural_frequency for one in machines])
    assert abs(np.corrcoef(stiffness, frequencies)[0, 1]) < 0.06  # as given, each by itself
    damping = np.array([one.damping_ratio for one in machines])
    assert damping.min() > 0 and damping.mean() > 0.0115  # cut off at none
    assert np.std([one.direction for one in machines]) == pytest.approx(math.radians(5), rel=0.05)


def test_a_single_mode_along_the_feed_is_turned_out_of_it():
    text = ("structure: {modes: [{natural_frequency: 922 Hz, damping_ratio: 0.011, mass: 40 +- 2 gram, "
            "direction: x +- 5 deg}]}\ncutter: {flutes: 2}\n"
            "cutting: {immersion: 0.2, tangential_coefficient: 600 N/mm^2, normal_coefficient: 200 N/mm^2}\n")
    known = of_spreads(model_from_text(text), catalogue())
    machines = [known.at(values) for values in known.drawn(5, 1)]
    assert all(one.planar for one in machines) and len({one.structure.mass for one in machines}) == 5


def test_a_surface_comes_to_what_every_chart_says():
    model = replace(TRUE, spreads=(("natural_frequency", 1.0), ("damping_ratio", 5e-4), ("tangential_coefficient", 5e7)))
    known, speeds, depths = of_spreads(model, catalogue()), np.linspace(2600, 4400, 13) * RPM, np.linspace(2e-4, 4e-3, 12)
    every = chance_of(each_drawn(stability_chart, known, speeds, depths, 200, 1))
    asked = []

    def fill(*grid):
        asked.append(grid)
        return stability_chart(*grid)

    near = chance_of(by_surface(fill, known, speeds, depths, 200, 1))
    assert len(asked) == charts_on_surface(known) == 7
    between = (every.probability > 0.02) & (every.probability < 0.98)
    assert between.sum() > 20  # it is a test
    assert np.mean(np.abs(near.probability - every.probability)[between]) < 0.04
    assert np.mean(np.abs(near.probability - every.probability)) < 0.01


def test_blank_cells_are_not_known_and_few_draws_promise_little():
    def fill(model, speeds, depths):
        largest = np.full((2, 2), 0.5 + 0j)
        largest[0, 0] = np.nan if model.cutting.normal_coefficient > 2e8 else 0.5
        return StabilityChart(speeds, depths, largest, np.where(np.isnan(largest), -1, 0))

    known = of_spreads(replace(SLOT, spreads=(("normal_coefficient", 1e7),)), catalogue())
    found = chance_of(each_drawn(fill, known, np.array([1.0, 2.0]), np.array([1e-3, 2e-3]), 20, 1))
    assert np.isnan(found.probability[0, 0]) and found.unknown[0, 0] > 0.2
    assert np.all(found.probability.ravel()[1:] == 1.0) and found.lies[1] == ("above", "above")
    assert found.recommended(0.05).spindle_speed == 2.0 and found.recommended(0.01) is None  # 20 draws tell no 1 %
    assert len(plot_chance(found, np.full(2, np.nan), None, 0.05).axes) == 2
