"""Classes of multipliers and the fast chart against the full eigenvalue problem."""

import math

import numpy as np
import pytest

from analysis.collocation import collocation_multipliers
from analysis.delay_equation import milling_equation
from analysis.plots import ChartTest, plot_chart, plot_multipliers, plot_once_per_period, save
from analysis.stability import CLASSES, classify, stability_chart
from testbed.cut import Cut
from testbed.machine import Cutter, Cutting, Model, Structure

MASS, GAMMA = 2.573, 2.16e8


def machine(flutes=1, helix=0.0, immersion=0.162, direction="up-milling"):
    return Model(Structure(MASS, 921.1 / (2 * math.pi), 0.0032), Cutter(flutes, helix_angle=helix),
                 Cutting(direction, immersion, GAMMA * MASS, 0.3 * GAMMA * MASS))


SPEEDS, DEPTHS = np.linspace(2500, 4500, 200) * 2 * math.pi / 60, np.linspace(0.1e-3, 4e-3, 200)


@pytest.mark.parametrize(("multipliers", "outcome"), [
    ([0.5, -0.9, 0.8 + 0.5j, 0.8 - 0.5j], "stable"), ([0.9 + 0.9j, 0.9 - 0.9j, 1.1], "neimark_sacker"),
    ([1.01, -1.2], "flip"), ([1.2, -1.1], "saddle_node")])
def test_class_is_that_of_the_largest_multiplier(multipliers, outcome):
    assert classify(np.array(multipliers)) == outcome


@pytest.mark.parametrize("multipliers", [[], [float("nan")]])
def test_no_class_without_multipliers(multipliers):
    with pytest.raises(ValueError, match="finite"):
        classify(np.array(multipliers))


@pytest.mark.parametrize("kind", [(), (2, 0.5, 0.3), (4, 0.0, 0.25, "down-milling")])
def test_every_verdict_of_the_fast_chart_is_that_of_the_full_eigenvalues(kind):
    fast = stability_chart(machine(*kind), SPEEDS[::2], DEPTHS[::2])
    full = stability_chart(machine(*kind), SPEEDS[::2], DEPTHS[::2], full_eigenvalues=True)
    assert np.unique(full.classes).size > 1
    np.testing.assert_array_equal(fast.classes, full.classes)
    close = np.abs(full.spectral_radius - 1.0) < 0.1
    assert np.abs(fast.spectral_radius - full.spectral_radius)[close].max() < 1e-3


def test_chart_finds_the_published_outcomes_and_agrees_with_collocation():
    cases = [(3050, 2.7, "neimark_sacker"), (3565, 2.1, "neimark_sacker"), (3635, 2.0, "flip"), (3810, 2.9, "stable"),
             (2850, 2.9, "stable")]
    for speed, depth, outcome in cases:
        omega = speed * 2 * math.pi / 60
        chart = stability_chart(machine(), [omega], [depth * 1e-3], elements=8)
        assert CLASSES[chart.classes[0, 0]] == outcome
        exact = collocation_multipliers(milling_equation(machine(), Cut(omega, depth * 1e-3)))[0]
        assert abs(chart.largest[0, 0] - exact) < 2e-4


def test_stability_limit_lies_where_the_largest_multiplier_has_modulus_one():
    chart = stability_chart(machine(), SPEEDS[60:100:10], np.linspace(0.1e-3, 4e-3, 400), elements=6)
    limits = chart.stability_limit()
    assert np.isfinite(limits).any()
    for speed, limit in zip(chart.spindle_speeds, limits, strict=True):
        if np.isfinite(limit) and limit > chart.axial_depths[0]:
            exact = collocation_multipliers(milling_equation(machine(), Cut(speed, limit)))[0]
            assert abs(exact) == pytest.approx(1.0, abs=2e-3)


def test_added_damping_raises_the_limit():
    speeds, depths = SPEEDS[60:100:10], np.linspace(0.1e-3, 4e-3, 100)
    plain, damped = stability_chart(machine(), speeds, depths), stability_chart(
        machine(), speeds, depths, added_damping=np.full((1, speeds.size), 60.0))
    assert np.sum(damped.classes == 0) > np.sum(plain.classes == 0) > 0


def test_a_cell_of_forty_thousand_is_what_it_is_in_a_small_chart():
    whole, part = (stability_chart(machine(), SPEEDS[::step], DEPTHS[::step]) for step in (1, 10))
    assert whole.classes.shape == (200, 200) and np.isfinite(whole.largest).all()
    np.testing.assert_array_equal(whole.classes[::10, ::10], part.classes)
    np.testing.assert_allclose(whole.largest[::10, ::10], part.largest, rtol=1e-12)


def test_pictures_are_written_as_png_and_svg(tmp_path):
    chart = stability_chart(machine(), SPEEDS[::20], DEPTHS[::20])
    test = ChartTest(SPEEDS[10], 2e-3, "flip", "C")
    figures = {"chart": plot_chart(chart, [test]), "multipliers": plot_multipliers({"a": np.array([0.5 + 0.5j])}),
               "samples": plot_once_per_period(np.arange(5.0), np.arange(5.0), np.arange(2.0), np.arange(2.0))}
    for name, figure in figures.items():
        png, svg = save(figure, tmp_path / "deep" / name)
        assert png.read_bytes()[:4] == b"\x89PNG" and b"<svg" in svg.read_bytes()[:2000]
    drawn = plot_chart(chart, [test]).axes[0]
    assert drawn.lines[0].get_xydata()[0] == pytest.approx([SPEEDS[10] * 30 / math.pi, 2.0])
