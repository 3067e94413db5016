"""Charts and multipliers of ordinary cutters against a road that shares no code, and against closed forms."""

import math

import numpy as np
import pytest

from testbed.analysis.linear import spectral_elements
from testbed.analysis.linear.cells import largest_multipliers
from testbed.analysis.linear.chart_plot import plot_chart
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.stability import CLASSES, FEED_ONLY, StabilityChart, sharpened_limit, stability_chart
from testbed.cut import Cut
from tests.support.second_road import Milling, multipliers
from tests.support.shell import Shell
from tests.validation.charts import model_of, random_machine

RPM = math.pi / 30.0
# two straight flutes in a slot, 922 Hz: the tool of Insperger and Stepan's charts
SLOT = Milling(0.03993, 922.0, 0.011, 2, 0.0, 20e-3, True, 1.0, 6e8, 2e8, 5000 * RPM)


@pytest.mark.parametrize(("depth", "modulus"), [(0.2, 0.8197428), (0.5, 1.0739756), (0.7, 1.2215561), (1.0, 1.4064735)])
def test_a_slot_of_five_oscillations_has_its_known_multipliers_by_every_road(depth, modulus):
    cut = Cut(SLOT.speed, depth * 1e-3)
    values, errors = spectral_elements.multipliers(milling_equation(model_of(SLOT), cut))
    largest, error = largest_multipliers(model_of(SLOT), np.array([SLOT.speed]), np.array([depth * 1e-3]))
    for found in (values[0], largest[0], multipliers(SLOT, depth * 1e-3)[0]):
        assert abs(found) == pytest.approx(modulus, abs=0.6e-7)
    assert errors[0] < 1e-5 and error[0] < 1e-5


def test_limits_of_the_slot_and_no_chatter_where_six_elements_called_it():
    speeds = np.array([5, 9, 10, 11, 15, 20]) * 1000 * RPM
    chart = stability_chart(model_of(SLOT), speeds, np.linspace(0.05e-3, 4e-3, 40))
    limit = sharpened_limit(chart, model_of(SLOT)) * 1e3
    # at 9000 and 11,000 rpm by bisection of the second road
    assert limit == pytest.approx([0.4086, 3.0092, 0.3224, 0.6117, 0.3866, 1.4175], abs=0.6e-4)
    assert CLASSES[chart.classes[-1, -1]] == "flip"


def test_four_straight_flutes_in_a_slot_are_a_plain_delay_equation():
    four = Milling(0.03993, 922.0, 0.011, 4, 0.0, 20e-3, True, 1.0, 6e8, 2e8, 3000 * RPM)
    omega, tau = 2 * math.pi * 922.0, 60.0 / 3000 / 4
    # the sum of (K_t c + K_n s) s over the two teeth in the cut is K_n: at the limit
    # (b K_n / m)(1 - exp(-i w tau)) = w^2 - omega^2 - 2 i zeta omega w
    w = np.linspace(omega * 1.0001, 1.6 * omega, 2_000_001)
    phase = 2 * np.arctan2(-2 * 0.011 * omega * w, w**2 - omega**2)  # of (1 - exp(-i w tau)): pi/2 - w tau/2
    turn = np.mod(math.pi - w * tau - phase + math.pi, 2 * math.pi) - math.pi
    at = np.flatnonzero((turn[:-1] * turn[1:] <= 0) & (np.abs(turn[:-1]) < 1.0))
    depth = (w[at] ** 2 - omega**2) / (1 - np.cos(w[at] * tau)) * 0.03993 / 2e8
    chart = stability_chart(model_of(four), [four.speed], np.linspace(0.02e-3, 1e-3, 30))
    limit = sharpened_limit(chart, model_of(four))[0]
    assert limit == pytest.approx(0.1625e-3, rel=1e-3)
    assert limit == pytest.approx(depth[depth > 0].min(), rel=1e-6)


@pytest.mark.parametrize("seed", range(12))
def test_random_ordinary_cuts_agree_with_the_second_road(seed):
    random = np.random.default_rng(seed)
    machine, depth = random_machine(random, most=12.0)
    exact = multipliers(machine, depth)
    largest, error = largest_multipliers(model_of(machine), np.array([machine.speed]), np.array([depth]))
    values, _ = spectral_elements.multipliers(milling_equation(model_of(machine), Cut(machine.speed, depth)))
    size = max(1.0, abs(exact[0]))
    for found in (largest[0], values[0]):
        assert abs(abs(found) - abs(exact[0])) < 1e-5 * size
        assert np.abs(exact - found).min() < 1e-5 * size
    assert abs(abs(largest[0]) - abs(exact[0])) < error[0] + 1e-8 * size  # the estimate is not too small


def test_a_cut_of_more_oscillations_than_can_be_resolved_is_blank_and_refused():
    speeds = np.array([20.0, 9000.0]) * RPM
    chart = stability_chart(model_of(SLOT), speeds, np.array([0.2e-3, 0.4e-3]))
    assert np.isnan(chart.largest[:, 0]).all() and (chart.classes[:, 0] == -1).all()
    assert np.isfinite(chart.largest[:, 1]).all() and (chart.error[:, 1] < 1e-5).all()
    with pytest.raises(ArithmeticError, match="swings .* times in the cut"):
        spectral_elements.multipliers(milling_equation(model_of(SLOT), Cut(20.0 * RPM, 0.2e-3)))
    drawn = plot_chart(chart).axes[0]
    assert "blank: not known" in [text.get_text() for text in drawn.get_legend().get_texts()]
    assert drawn.get_title(loc="left") == FEED_ONLY


def test_a_blank_cell_is_drawn_hatched_and_never_like_a_stable_one():
    speeds, depths = np.linspace(100.0, 200.0, 4), np.linspace(1e-3, 2e-3, 3)
    largest, classes = np.full((3, 4), 0.5 + 0j), np.zeros((3, 4), dtype=np.int8)
    largest[1, 2], classes[1, 2] = np.nan, -1
    drawn = plot_chart(StabilityChart(speeds, depths, largest, classes))
    drawn.canvas.draw()
    pixels = np.asarray(drawn.canvas.buffer_rgba())[..., :3]
    axes = drawn.axes[0]

    def darkest(row: int, column: int) -> int:
        x, y = axes.transData.transform((speeds[column] * 30.0 / np.pi, depths[row] * 1e3))
        where = pixels[int(len(pixels) - y) - 8:int(len(pixels) - y) + 8, int(x) - 8:int(x) + 8]
        return int(where.min())

    assert darkest(1, 2) < 200 and darkest(0, 0) == 255


def test_an_error_that_does_not_settle_leaves_the_cell_blank(monkeypatch):
    coarse = spectral_elements.Elements(np.array([0.0, 1.0]), np.array([3]))
    monkeypatch.setattr("testbed.analysis.linear.cells.FINER", (0,))
    monkeypatch.setattr("testbed.analysis.linear.cells.divided", lambda breaks, swing: coarse)
    chart = stability_chart(model_of(SLOT), [SLOT.speed], [0.2e-3, 0.7e-3])
    assert np.isnan(chart.largest).all() and (chart.error > 1e-4).all()
    monkeypatch.setattr(spectral_elements, "FINER", (0,))
    monkeypatch.setattr(spectral_elements, "divided", lambda breaks, swing: coarse)
    with pytest.raises(ArithmeticError, match="did not settle"):
        spectral_elements.multipliers(milling_equation(model_of(SLOT), Cut(SLOT.speed, 0.2e-3)))


def test_both_commands_say_the_same_of_one_cut(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.yaml").write_text(
        "structure: {mass: 0.03993 kg, natural_frequency: 922 Hz, damping_ratio: 0.011}\n"
        "cutter: {flutes: 2, diameter: 20 mm, helix_angle: 0 deg}\n"
        "cutting: {direction: up-milling, immersion: 0.5, tangential_coefficient: 600 N/mm^2,"
        " normal_coefficient: 200 N/mm^2}\n")
    testbed = Shell(capsys)
    found = testbed.json("chart", "model.yaml", "--speed", "20:9000:2", "--depth", "0.5:2.9:2")
    assert "2 cells are left blank" in testbed.err and "along the feed only" in testbed.err
    assert [row[0] for row in found["class"]] == [None, None] and [row[1] for row in found["class"]] == ["stable"] * 2
    assert any("along the feed only" in note for note in found["notes"])
    one = testbed.json("multipliers", "model.yaml", "--speed", 9000, "--depth", 2.9)
    assert one["multipliers"][0] == pytest.approx(found["largest_multiplier"][1][1], abs=1e-5)
    assert one["error"][0] < 1e-5 and found["error"][1][1] < 1e-4
    assert "swings" in testbed.refused("multipliers", "model.yaml", "--speed", 20, "--depth", 0.5)
