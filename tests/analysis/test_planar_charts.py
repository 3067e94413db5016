"""Charts and multipliers of machines in x and y: known numbers, rotations, closed forms, a road that shares no code."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.linear.cells import largest_multipliers
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.lane_maps import rough_multipliers
from testbed.analysis.linear.lanes import LANES
from testbed.analysis.linear.planar_equation import chip_stiffness, divide, planar_machine
from testbed.analysis.linear.planar_multipliers import cut_multipliers
from testbed.analysis.linear.planar_multipliers import planar_multipliers as of_machine
from testbed.analysis.linear.spectral_elements import TABLES
from testbed.analysis.linear.stability import feed_note, sharpened_limit, stability_chart
from testbed.analysis.multipliers.run_labels import class_of_linear
from testbed.cut import Cut
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from tests.support.second_road import Planar, planar_multipliers
from tests.support.shell import Shell
from tests.validation.planar_charts import model_of, random_machine

RPM, X, Y = math.pi / 30.0, 0.0, 0.5 * math.pi
PITCH = tuple(math.radians(angle) for angle in (85, 95, 85, 95))


def machine(modes, flutes, direction, radial, tangential, normal, **cutter):
    immersion = math.acos(1 - 2 * radial) / (2 * math.pi)
    return Model(Structure.of(modes), Cutter(flutes, cutter.pop("diameter", 20e-3), **cutter),
                 Cutting(direction, immersion, tangential * 1e6, normal * 1e6))


def stiff(frequency, ratio, stiffness, direction):
    return Mode(stiffness / (2 * math.pi * frequency) ** 2, frequency, ratio, direction, "tool")


def tool(direction, on="tool"):
    return Mode(0.03993, 922.0, 0.011, direction, on)


def limits(model, speeds, deepest):
    chart = stability_chart(model, np.array(speeds) * RPM, np.linspace(deepest / 40, deepest, 40) * 1e-3)
    assert (chart.classes >= 0).all()
    return sharpened_limit(chart, model) * 1e3


B2 = [stiff(456.78, .11171, 7.9331e6, X), stiff(1448.89, .01704, 1.46918e7, X), stiff(516.52, .02458, 9.3746e6, Y),
      stiff(1408.45, .03136, 1.24064e7, Y)]
B3 = [Mode(shape**-2, frequency, ratio, direction) for frequency, ratio, shape, direction in
      ((369.85, .0316, .8369, X), (1146.36, .0114, 2.4757, X), (411.21, .0168, .9727, Y), (1069.21, .0155, 2.7837, Y))]
B4 = [stiff(f, z, k, direction) for f, z, k in ((1243, .0619, 2.92e6), (1747, .0288, 1.2e7)) for direction in (X, Y)]
FOUR = (5000, 10_000, 15_000, 20_000)


@pytest.mark.parametrize(("model", "speeds", "known"), [
    (machine([tool(X)], 2, "up-milling", 1.0, 600, 200), (5000, 9000, 10_000, 11_000, 15_000, 20_000),
     (.4086, 3.0092, .3224, .6117, .3866, 1.4175)),
    (machine([tool(X), tool(Y)], 2, "down-milling", .05, 600, 200), FOUR, (1.8438, 1.4869, 1.6512, 3.2504)),
    (machine([tool(X), tool(Y)], 2, "down-milling", .1, 600, 200), FOUR, (.9164, .9701, 1.3584, 2.8362)),
    (machine([tool(X), tool(Y)], 2, "down-milling", .5, 600, 200), FOUR, (.1271, .1810, .2818, .1762)),
    (machine(B2, 2, "up-milling", .5, 1319.4, 788.8), (8000, 12_000, 14_000), (2.1977, 2.4403, 5.4905)),
    (machine(B2, 2, "down-milling", .5, 1319.4, 788.8), (8000, 12_000, 14_000), (1.1326, .9134, 4.9541)),
    (machine(B3, 4, "down-milling", .5, 750, 150), (6000, 8000, 12_000), (.3929, 1.0000, .4201)),
    (machine(B4, 4, "down-milling", .5, 2160 * math.sin(math.radians(68)), 2160 * math.cos(math.radians(68)), diameter=12e-3),
     (5500, 7000), (.335, .334)),
], ids=["B0", "B1 .05", "B1 .1", "B1 .5", "B2 up", "B2 down", "B3", "B4"])
def test_known_limits(model, speeds, known):
    digits = 0.6e-3 if model.cutter.diameter == 12e-3 else 2e-4
    assert limits(model, speeds, 1.5 * max(known)) == pytest.approx(known, abs=digits)


@pytest.mark.parametrize(("depth", "modulus"), [(0.2, 0.8197428), (0.5, 1.0739756), (0.7, 1.2215561), (1.0, 1.4064735)])
def test_a_mode_of_the_tool_along_the_feed_is_one_of_the_workpiece(depth, modulus):
    cut = Cut(5000 * RPM, depth * 1e-3)
    for on in ("tool", "workpiece"):
        values, errors, passes = cut_multipliers(machine([tool(X, on)], 2, "up-milling", 1.0, 600, 200), cut)
        assert abs(values[0]) == pytest.approx(modulus, abs=0.6e-7) and errors[0] < 1e-5 and passes == 1


@pytest.mark.parametrize("helix", [0.0, 0.6])
@pytest.mark.parametrize("pitch", [(), PITCH])
def test_equal_modes_in_x_and_y_do_not_know_their_directions_nor_up_from_down(helix, pitch):
    cut = Cut(6000 * RPM, 0.3e-3)

    def largest(turned, direction):
        model = machine([tool(turned), tool(turned + Y)], 4, direction, 0.3, 600, 200, helix_angle=helix, pitch_angles=pitch)
        return cut_multipliers(model, cut)[0][0]

    first = largest(0.0, "up-milling")
    for turned in (0.3, 1.1, Y, 2.5):
        assert largest(turned, "up-milling") == pytest.approx(first, abs=1e-8)
        assert largest(turned, "down-milling") == pytest.approx(first, abs=1e-8)


def test_who_carries_a_mode_and_which_way_it_points_does_not_matter():
    cut = Cut(8000 * RPM, 0.8e-3)
    model = machine(B2, 2, "up-milling", 0.5, 1319.4, 788.8, helix_angle=0.3)
    other = [replace(mode, on="workpiece", direction=mode.direction + math.pi) for mode in B2]
    exact = cut_multipliers(model, cut)[0][0]
    assert cut_multipliers(replace(model, structure=Structure.of(other)), cut)[0][0] == pytest.approx(exact, abs=1e-10)


def test_four_straight_flutes_in_a_slot_are_a_plain_delay_equation():
    """Two teeth are always in the cut: H = [K_n, K_t; -K_t, K_n], and with equal modes x + i y decouples."""
    omega, ratio, mass, tau, depth = 2 * math.pi * 922.0, 0.011, 0.03993, 60.0 / 3000 / 4, 0.1e-3
    model = machine([tool(X), tool(Y)], 4, "up-milling", 1.0, 600, 200)
    values = cut_multipliers(model, Cut(3000 * RPM, depth))[0]
    stiffness = depth * (2e8 - 6e8j) / mass
    for value in values[:4]:
        rates = (np.log(complex(value)) + 2j * math.pi * np.arange(-60, 61)) / tau
        missed = [rates**2 + 2 * ratio * omega * rates + omega**2 + one * (1 - 1 / value)
                  for one in (stiffness, stiffness.conjugate())]
        slope = 2 * np.abs(rates) * tau ** -1 + 1e-300  # of the equation by ln(mu)
        assert min(np.min(np.abs(one) / slope) for one in missed) < 1e-6


@pytest.mark.parametrize("helix", [0.0, 0.5])
def test_a_revolution_of_equal_teeth_by_the_road_for_unequal_ones_is_so_many_passings(helix):
    model = machine(B3, 4, "down-milling", 0.5, 750, 150, helix_angle=helix)
    cut = Cut(8000 * RPM, 0.9e-3)
    one, turn = (of_machine(planar_machine(model, each), cut)[0][0] for each in (False, True))
    assert turn == pytest.approx(one**4 if (one**4).imag >= 0 else (one**4).conjugate(), abs=1e-7)


@pytest.mark.parametrize("helix", [0.0, math.radians(30)])
@pytest.mark.parametrize("depth", [0.3e-3, 1e-3])
def test_unequal_pitch_has_the_multipliers_of_the_second_road(helix, depth):
    modes = ((0.03993, 922.0, 0.011, X), (0.89, 516.5, 0.0246, Y), (2.57, 147.0, 0.004, 0.2))
    road = Planar(modes, PITCH, helix, 12e-3, False, 0.5, 6e8, 2e8, 6000 * RPM)
    exact = planar_multipliers(road, depth)[0]
    values, errors, passes = cut_multipliers(model_of(road), Cut(road.speed, depth))
    assert passes == 4 and abs(values[0].real - exact.real) < 1e-6 and abs(abs(values[0]) - abs(exact)) < 1e-6
    largest, error = largest_multipliers(model_of(road), np.array([road.speed]), np.array([depth]))
    assert abs(largest[0]) == pytest.approx(abs(exact) ** 0.25, abs=1e-6) and error[0] < 1e-4
    assert class_of_linear(model_of(road), Cut(road.speed, depth)).modulus == pytest.approx(abs(exact) ** 0.25, abs=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_random_machines_agree_with_the_second_road(seed):
    road, depth = random_machine(np.random.default_rng(seed), most_modes=4, most_swings=8.0)
    exact = abs(planar_multipliers(road, depth)[0]) ** (1 / len(road.pitches))
    largest, error = largest_multipliers(model_of(road), np.array([road.speed]), np.array([depth]))
    assert abs(abs(largest[0]) - exact) < 1e-5 * max(1.0, exact)
    assert abs(abs(largest[0]) - exact) < error[0] + 1e-7 * max(1.0, exact)


def test_what_is_of_one_mode_refuses_more_and_what_cannot_be_resolved_is_blank():
    model = machine([tool(X), tool(Y)], 2, "up-milling", 0.5, 600, 200)
    with pytest.raises(ValueError, match="takes one mode along x"):
        milling_equation(model, Cut(600.0, 1e-3))
    chart = stability_chart(model, np.array([2.0, 9000.0]) * RPM, np.array([0.2e-3]))
    assert chart.classes[0, 0] == -1 and chart.classes[0, 1] >= 0
    with pytest.raises(ArithmeticError, match="than can be resolved"):
        cut_multipliers(model, Cut(2.0 * RPM, 0.2e-3))
    assert feed_note(model) == "" and feed_note(machine([tool(X)], 2, "up-milling", 0.5, 600, 200))


def test_an_error_that_does_not_settle_leaves_the_cell_blank(monkeypatch):
    model = machine([tool(X), tool(Y)], 2, "up-milling", 0.5, 600, 200)
    monkeypatch.setattr("testbed.analysis.linear.planar_multipliers.PLANAR_TABLES", _wrong_tables())
    chart = stability_chart(model, np.array([9000.0 * RPM]), np.array([0.2e-3]))
    assert chart.classes[0, 0] == -1 and not chart.error[0, 0] < 1e-4


def _wrong_tables():
    """Weights of the points a little wrong, differently for every order."""
    from testbed.analysis.linear.planar_elements import PLANAR_TABLES

    wrong = PLANAR_TABLES[1] * (1.0 + 0.03 * np.arange(PLANAR_TABLES[1].shape[0]))[:, None]
    return (PLANAR_TABLES[0], wrong, *PLANAR_TABLES[2:])


def test_the_commands_take_machines_in_x_and_y(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = ("structure:\n  modes:\n"
            "    - {natural_frequency: 922 Hz, damping_ratio: 0.011, mass: 39.93 gram, direction: x, on: tool}\n"
            "    - {natural_frequency: 516.5 Hz, damping_ratio: 0.0246, stiffness: 9.37 N/um, direction: y, on: tool}\n"
            "cutter: {flutes: 4, diameter: 12 mm, helix_angle: 30 deg, pitch: [85 deg, 95 deg, 85 deg, 95 deg]}\n"
            "cutting: {direction: down-milling, immersion: 0.25, tangential_coefficient: 600 N/mm^2,"
            " normal_coefficient: 200 N/mm^2}\n")
    (tmp_path / "model.yaml").write_text(text)
    testbed = Shell(capsys)
    one = testbed.json("multipliers", "model.yaml", "--speed", 9000, "--depth", 0.5)
    assert one["period_passes"] == 4 and one["error"][0] < 1e-5
    found = testbed.json("chart", "model.yaml", "--speed", "8000:9000:2", "--depth", "0.5:1:2")
    cell, modulus = found["largest_multiplier"][0][1], math.hypot(*one["multipliers"][0])
    assert math.hypot(*cell) == pytest.approx(modulus**0.25, abs=1e-6)
    assert not any("along the feed only" in note for note in found["notes"])
    assert (tmp_path / "stability_chart.png").exists()
    (tmp_path / "model.yaml").write_text(text + "effects: {process_damping: {coefficient: 1e5 N/m}}\n")
    damped = testbed.json("multipliers", "model.yaml", "--speed", 9000, "--depth", 0.5)
    assert damped["period_passes"] == 4 and math.hypot(*damped["multipliers"][0]) < 0.99 * modulus
    cell = testbed.json("chart", "model.yaml", "--speed", "8000:9000:2", "--depth", "0.5:1:2")["largest_multiplier"][0][1]
    assert math.hypot(*cell) == pytest.approx(math.hypot(*damped["multipliers"][0]) ** 0.25, abs=1e-6)


UNEVEN = """
structure: {modes: [{mass: 0.6 kg, natural_frequency: 620 Hz, damping_ratio: 0.02, direction: x, on: tool},
                    {mass: 0.7 kg, natural_frequency: 700 Hz, damping_ratio: 0.02, direction: y, on: tool}]}
cutter: {flutes: 4, diameter: 16 mm, helix_angle: 30 deg, pitch: [84 deg, 96 deg, 84 deg, 96 deg]}
cutting: {direction: down-milling, immersion: 0.2, tangential_coefficient: 600 N/mm^2, normal_coefficient: 200 N/mm^2}
effects:
  contact_loss: {}
  runout: {offset: 2 um, angle: 20 deg}
"""


def test_teeth_that_let_go_for_a_moment_have_an_answer_and_teeth_that_miss_the_work_have_none(tmp_path, monkeypatch, capsys):
    """Unequal teeth leave the work where the chip runs out, in a stable cut too; contact_loss made every such cell blank."""
    monkeypatch.chdir(tmp_path)
    testbed, cut = Shell(capsys), ("--speed", 6000, "--depth", 1)
    for text in (UNEVEN, UNEVEN.replace(", pitch: [84 deg, 96 deg, 84 deg, 96 deg]", "")):
        (tmp_path / "model.yaml").write_text(text)
        found = testbed.json("multipliers", "model.yaml", *cut)
        assert any("stay in the work" in note for note in found["notes"])
        (tmp_path / "model.yaml").write_text(text.replace("  contact_loss: {}\n", ""))
        assert found["multipliers"] == testbed.json("multipliers", "model.yaml", *cut)["multipliers"]
        (tmp_path / "model.yaml").write_text(text.replace("2 um", "90 um"))
        assert "out of the work for" in testbed.refused("multipliers", "model.yaml", *cut)


def test_maps_side_by_side_are_those_of_machines_in_x_and_y():
    model, depths = machine(B2, 2, "up-milling", .5, 1319.4, 788.8), np.array([0.5, 2.0, 3.0, 6.0]) * 1e-3
    planar, speed = planar_machine(model), 12_000 * RPM
    places, cut = planar.corners(depths[0])
    starts, lengths, points = divide(places, cut, planar.frequencies.max() * 1.5 / speed, math.inf, 4, False)
    assert points[-1] == 0 and (points[:-1] > 0).all()  # free flight at the end alone
    stiffness, h = np.empty((1, points.sum(), 2, 2)), np.empty((2, 2))
    angles = [start + length * node for start, length, count in zip(starts, lengths, points, strict=True)
              for node in TABLES[0][count, :count]]
    for place, angle in enumerate(angles):
        chip_stiffness(angle, planar.delays[0], 0.0, planar.law, h)
        stiffness[0, place] = planar.axes.T @ h @ planar.axes
    cells = np.full(4, 1 / speed), np.zeros(4), np.zeros(4, dtype=int), depths
    found = np.empty(4, dtype=complex)
    rough_multipliers((np.ascontiguousarray(planar.shapes), planar.frequencies, planar.dampings), cells,
                      (lengths[None, :-1], lengths[-1:], stiffness), points[:-1], TABLES, LANES, found)
    known = [of_machine(planar, Cut(speed, depth))[0][0] for depth in depths]
    assert np.abs(known).max() > 1.0
    assert np.abs(np.abs(found) - np.abs(known)).max() < 1e-5
