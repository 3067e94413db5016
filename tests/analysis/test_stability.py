"""Classes of multipliers and the fast chart against the full eigenvalue problem."""

import math

import numpy as np
import pytest

from testbed.analysis.linear import cells
from testbed.analysis.linear.chart_border import refined
from testbed.analysis.linear.chart_plot import ChartTest, plot_chart, plot_multipliers, plot_once_per_period, save
from testbed.analysis.linear.collocation import collocation_multipliers
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.stability import CLASSES, StabilityChart, classify, stability_chart
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
    assert np.abs(fast.spectral_radius - full.spectral_radius)[close].max() < 1e-6


@pytest.mark.parametrize(("kind", "added"), [((), 0.0), ((2, 0.0, 0.3), 0.0), ((3, 0.0, 0.25, "down-milling"), 4.0)])
def test_cells_side_by_side_have_the_multipliers_of_cells_one_by_one(kind, added, monkeypatch):
    damping = added * np.linspace(0.0, 1.0, 20)  # another one in every column
    monkeypatch.setattr(cells, "MANY", 0)
    together = stability_chart(machine(*kind), SPEEDS[::10], DEPTHS[::20], added_damping=damping)
    monkeypatch.setattr(cells, "IN_LANES", 0)
    alone = stability_chart(machine(*kind), SPEEDS[::10], DEPTHS[::20], added_damping=damping)
    assert not np.array_equal(together.largest, alone.largest)  # two roads
    np.testing.assert_array_equal(together.classes, alone.classes)
    assert np.abs(together.largest - alone.largest).max() < 2e-6
    settled = np.maximum(together.error, alone.error) < 1e-6
    assert settled.any() and np.abs(together.largest - alone.largest)[settled].max() < 1e-9


def test_a_cell_does_not_depend_on_its_neighbours():
    chart = stability_chart(machine(), SPEEDS[::40], DEPTHS[::40])
    own = [[stability_chart(machine(), [speed], [depth]).largest[0, 0] for speed in SPEEDS[::40]] for depth in DEPTHS[::40]]
    np.testing.assert_array_equal(chart.largest, own)


def test_chart_finds_the_published_outcomes_and_agrees_with_collocation():
    cases = [(3050, 2.7, "neimark_sacker"), (3565, 2.1, "neimark_sacker"), (3635, 2.0, "flip"), (3810, 2.9, "stable"),
             (2850, 2.9, "stable")]
    for speed, depth, outcome in cases:
        omega = speed * 2 * math.pi / 60
        chart = stability_chart(machine(), [omega], [depth * 1e-3])
        assert CLASSES[chart.classes[0, 0]] == outcome
        exact = collocation_multipliers(milling_equation(machine(), Cut(omega, depth * 1e-3)))[0]
        assert abs(chart.largest[0, 0] - exact) < 1e-6


def test_stability_limit_lies_where_the_largest_multiplier_has_modulus_one():
    chart = stability_chart(machine(), SPEEDS[60:100:10], np.linspace(0.1e-3, 4e-3, 400))
    limits = chart.stability_limit()
    assert np.isfinite(limits).any()
    for speed, limit in zip(chart.spindle_speeds, limits, strict=True):
        if np.isfinite(limit) and limit > chart.axial_depths[0]:
            exact = collocation_multipliers(milling_equation(machine(), Cut(speed, limit)))[0]
            assert abs(exact) == pytest.approx(1.0, abs=2e-3)


def test_where_cells_are_blank_nobody_knows_where_the_limit_lies():
    nan = math.nan
    largest = np.array([[0.5, 1.5, 0.5, nan, 0.5, nan], [1.5, 2.0, 0.9, 1.5, nan, 0.9]])
    chart = StabilityChart(SPEEDS[:6], np.array([1e-3, 2e-3]), largest + 0j, np.zeros((2, 6)))
    assert chart.limit_lies() == ["within", "below", "above", None, None, "above"]
    assert chart.stability_limit() == pytest.approx([1.5e-3, nan, nan, nan, nan, nan], nan_ok=True)


def test_added_damping_raises_the_limit():
    speeds, depths = SPEEDS[60:100:10], np.linspace(0.1e-3, 4e-3, 100)
    plain, damped = stability_chart(machine(), speeds, depths), stability_chart(
        machine(), speeds, depths, added_damping=np.full((1, speeds.size), 60.0))
    assert np.sum(damped.classes == 0) > np.sum(plain.classes == 0) > 0


def test_a_cell_of_forty_thousand_is_what_it_is_in_a_small_chart():
    whole, part = (stability_chart(machine(), SPEEDS[::step], DEPTHS[::step]) for step in (1, 10))
    assert whole.classes.shape == (200, 200) and np.isfinite(whole.largest).all()
    np.testing.assert_array_equal(whole.classes[::10, ::10], part.classes)
    np.testing.assert_allclose(whole.largest[::10, ::10], part.largest, rtol=2e-6)  # of two roads, as far as they settle
    settled = np.maximum(whole.error[::10, ::10], part.error) < 1e-6
    np.testing.assert_allclose(whole.largest[::10, ::10][settled], part.largest[settled], rtol=1e-9)


def test_pictures_are_written_as_png_and_svg(tmp_path):
    chart = stability_chart(machine(), SPEEDS[::20], DEPTHS[::20])
    test = ChartTest(SPEEDS[10], 2e-3, "flip", "C")
    figures = {"chart": plot_chart(chart, [test]),
               "multipliers": plot_multipliers({"a": (np.array([0.5 + 0.5j]), np.array([]))}),
               "samples": plot_once_per_period(np.arange(5.0), np.arange(5.0), np.arange(2.0), np.arange(2.0))}
    for name, figure in figures.items():
        png, svg = save(figure, tmp_path / "deep" / name)
        assert png.read_bytes()[:4] == b"\x89PNG" and b"<svg" in svg.read_bytes()[:2000]
    drawn = plot_chart(chart, [test]).axes[0]
    assert drawn.lines[0].get_xydata()[0] == pytest.approx([SPEEDS[10] * 30 / math.pi, 2.0])


def fill(speeds, depths):
    return stability_chart(machine(), speeds, depths)


def test_borders_are_refined_to_what_the_whole_chart_would_be_at_a_fifth_of_its_work():
    rough, computed = fill(SPEEDS[::5], DEPTHS[::10]), []

    def counted(speeds, depths):
        computed.append(speeds.size * depths.size)
        return fill(speeds, depths)

    fine = refined(rough, counted)
    whole = fill(fine.spindle_speeds, fine.axial_depths)
    assert fine.classes.size > 200 * rough.classes.size and sum(computed) < 0.2 * fine.classes.size
    assert np.mean(fine.classes != whole.classes) < 1e-4
    near = np.ix_(*(np.abs(new[:, None] - old).argmin(axis=1) for new, old in (
        (fine.axial_depths, rough.axial_depths), (fine.spindle_speeds, rough.spindle_speeds))))
    assert np.mean(rough.classes[near] != whole.classes) > 0.01  # what the chart's own cells make of it
    assert np.array_equal(fine.classes == 0, fine.spectral_radius < 1.0)  # the line lies where the colour changes


@pytest.mark.parametrize("shape", [(1, 5), (5, 1)])
def test_a_line_of_cells_is_not_refined(shape):
    chart = fill(SPEEDS[: shape[0]], DEPTHS[: shape[1]])
    assert refined(chart, fill) is chart


def boxes(figure):
    """(axes, legend, labels, marks), each as boxes in pixels."""
    figure.draw_without_rendering()
    axes = figure.axes[0]
    marks = [axes.transData.transform(line.get_xydata()[0]) for line in axes.lines]
    return (axes.get_window_extent(), axes.get_legend().get_window_extent(),
            {text.get_text(): text.get_window_extent() for text in axes.texts}, marks)


def test_the_legend_stands_beside_the_chart_and_labels_clear_of_each_other():
    chart = fill(SPEEDS[::4], DEPTHS[::4])
    near = [ChartTest(SPEEDS[100] * (1 + 0.004 * k), 2e-3, "neimark_sacker", f"run {k}") for k in range(4)]
    figure = plot_chart(chart, [*near, ChartTest(SPEEDS[20], 2e-3, "undecided", "E")], "E: another")
    axes, legend, labels, marks = boxes(figure)
    assert legend.x0 >= axes.x1
    assert len(labels) == 5
    for name, box in labels.items():
        assert not any(box.overlaps(other) for another, other in labels.items() if another != name), name
        assert not any(box.contains(*mark) for mark in marks), name
        assert axes.x0 <= box.x0 and box.x1 <= axes.x1
    assert all(text.get_path_effects() for text in figure.axes[0].texts)
    said = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert {"Neimark-Sacker", "test: Neimark-Sacker", "test: undecided", "E: another"} <= set(said)
    assert not any("neimark" in text for text in said)


def test_a_label_without_room_is_left_out():
    many = [ChartTest(SPEEDS[100], 2e-3, "stable", f"run {number}") for number in range(40)]
    labels = boxes(plot_chart(fill(SPEEDS[::20], DEPTHS[::20]), many))[2]
    assert 2 <= len(labels) <= 8


def test_multipliers_tell_the_test_by_colour_and_measured_from_model_by_shape():
    pairs = {"3810 rpm": (np.array([0.5 + 0.5j]), np.array([0.6 + 0.5j])), "2850 rpm": (np.array([0.1]), np.array([0.2]))}
    axes = plot_multipliers(pairs).axes[0]
    drawn = {line.get_xydata()[0, 0]: (line.get_marker(), line.get_color()) for line in axes.lines[3:]}  # circle, two axes
    assert [drawn[place][0] for place in (0.5, 0.6, 0.1, 0.2)] == ["o", "x", "o", "x"]
    assert drawn[0.5][1] == drawn[0.6][1] != drawn[0.1][1] == drawn[0.2][1]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["measured", "model", "3810 rpm", "2850 rpm"]
