"""Machines of several modes in a model file: read, written back exactly, and refused in one line where they are wrong."""

import math

import pytest

from testbed.files.model_file import model_from_text, model_text
from testbed.machine import Cutter, Mode, Structure
from testbed.problem import InputProblem

MACHINE = """
structure:
  modes:
    - {natural_frequency: 922 Hz, damping_ratio: 0.011, mass: 39.93 gram, direction: x, on: tool}
    - {natural_frequency: 516.5 Hz, damping_ratio: 0.0246, stiffness: 9.37 N/um, direction: y, on: tool}
    - {natural_frequency: 147 Hz, damping_ratio: 0.004, mass: 2.57 kg, direction: 12 deg}
cutter: {flutes: 4, diameter: 12 mm, helix_angle: 30 deg, pitch: [85 deg, 95 deg, 85 deg, 95 deg]}
cutting: {direction: down-milling, immersion: 0.25, tangential_coefficient: 600 N/mm^2, normal_coefficient: 200 N/mm^2}
"""


def test_modes_and_pitch_are_read_with_units_and_written_back_exactly():
    model = model_from_text(MACHINE)
    first, second, third = model.structure.modes
    assert (first.mass, first.shape, first.on) == (pytest.approx(0.03993), (1.0, 0.0), "tool")
    assert second.stiffness == pytest.approx(9.37e6) and second.shape == (0.0, 1.0)
    assert third.shape == pytest.approx((math.cos(math.radians(12)), math.sin(math.radians(12)))) and third.on == "workpiece"
    assert [round(math.degrees(angle), 9) for angle in model.cutter.pitches] == [85, 95, 85, 95]
    assert model_from_text(model_text(model)) == model
    assert model.planar and not model_from_text(MACHINE.replace(", pitch: [85 deg, 95 deg, 85 deg, 95 deg]", "")
                                                ).cutter.pitch_angles


def test_one_mode_of_the_workpiece_along_x_is_the_short_form():
    mode = Mode(2.5, 147.0, 0.004)
    assert Structure.of([mode]) == Structure(2.5, 147.0, 0.004) and not Structure.of([mode]).planar
    assert Structure.of([Mode(2.5, 147.0, 0.004, on="tool")]).planar
    assert not Cutter(4, pitch_angles=(math.pi / 2,) * 4).pitch_angles  # equal pitches are the ordinary cutter


def test_parameters_are_named_by_the_place_of_their_mode():
    model = model_from_text(MACHINE)
    assert model.value("modes[1].natural_frequency") == 516.5
    changed = model.with_values({"modes[0].damping_ratio": 0.02, "modes[2].mass": 3.0})
    assert [mode.damping_ratio for mode in changed.structure.modes] == [0.02, 0.0246, 0.004]
    assert changed.structure.modes[2].mass == 3.0
    for path in ("natural_frequency", "modes[3].mass", "modes[0].shape"):
        with pytest.raises(KeyError):
            model.value(path)


@pytest.mark.parametrize(("right", "wrong", "said"), [
    ("direction: x, ", "", "direction: is missing"),
    ("direction: x", "direction: up", "write x, y, or an angle"),
    ("mass: 39.93 gram, ", "", "neither mass nor stiffness"),
    ("mass: 39.93 gram", "mass: 39.93 gram, stiffness: 1 N/m", "both mass and stiffness"),
    ("95 deg]", "99 deg]", "add up to 364 deg"),
    (", 95 deg]", "]", "3 angles for 4 flutes"),
    ("on: tool", "on: table", "one of 'workpiece' or 'tool'"),
    ("  modes:", "  mass: 3 kg\n  modes:", "stands beside modes"),
    ("direction: y", "direktion: y", "did you mean direction?"),
    ("516.5 Hz, damping_ratio: 0.0246, stiffness: 9.37 N/um, direction: y",
     "922 Hz, damping_ratio: 0.0246, stiffness: 9.37 N/um, direction: 180 deg", "a mode stands twice"),
])
def test_what_is_wrong_is_said_in_one_line(right, wrong, said):
    assert right in MACHINE
    with pytest.raises(InputProblem) as problem:
        model_from_text(MACHINE.replace(right, wrong, 1))
    assert said in str(problem.value) and "\n" not in str(problem.value)
