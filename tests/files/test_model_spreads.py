"""Values with a standard deviation in model.yaml: read, written back exactly, refused in one line; all else reads the value."""

import math
import pickle

import pytest

from testbed.files.model_file import model_from_text, model_text
from testbed.problem import InputProblem
from tests.files.test_model_file import TEXT

SPREAD = TEXT.replace("2.573 kg", "2.573 +- 0.1 kg").replace("146.6 Hz", "146.6 Hz +/- 1 %") \
    .replace("0.0032", "0.0032 ± 0.0003").replace("550 N", "550 +- 50 N").replace("200 N/mm^2", "(200 +- 20) N/mm^2") \
    .replace("1.0e5 N/m}", "1.0e5 +- 2e4 N/m}")
SIZES = {"mass": 0.1, "natural_frequency": 1.466, "damping_ratio": 3e-4, "tangential_coefficient": 5e7,
         "normal_coefficient": 2e7, "process_damping.coefficient": 2e4}
MODES = """structure:
  modes:
    - {natural_frequency: 922 +- 5 Hz, damping_ratio: 1.1 % +- 0.1 %, stiffness: 9 +- 1 N/um, direction: y +- 3 deg, on: tool}
    - {natural_frequency: 500 Hz, damping_ratio: 0.02, mass: 1.2 +- 0.1 kg, direction: 12 +- 3 deg}
"""


def test_every_value_may_have_a_deviation_and_counts_as_itself():
    found = model_from_text(SPREAD)
    assert found == model_from_text(TEXT) and dict(found.spreads) == pytest.approx(SIZES)
    assert model_from_text(TEXT).spreads == ()


@pytest.mark.parametrize("text", [SPREAD, MODES, MODES.rpartition("    -")[0].replace("y +- 3", "0 +- 3"),
                                  "structure: {machine: flexure, damping_ratio: 0.004 +- 0.001}"])
def test_what_is_written_reads_back_exactly(text):
    found = model_from_text(text)
    again = model_from_text(model_text(found))
    assert again == found and again.spreads == found.spreads and len(found.spreads) > 0
    assert pickle.loads(pickle.dumps(found)).spreads == found.spreads


def test_modes_are_numbered():
    found = dict(model_from_text(MODES).spreads)
    assert found["modes[0].stiffness"] == 1e6 and found["modes[1].direction"] == pytest.approx(math.radians(3))
    assert "modes[0].mass" not in found and found["modes[0].damping_ratio"] == pytest.approx(1e-3)


def test_another_value_takes_the_deviation_away():
    found = model_from_text(MODES)
    assert "modes[0].stiffness" not in dict(found.with_values({"modes[0].mass": 1.0}).spreads)
    assert "modes[1].mass" in dict(found.with_values({"modes[0].mass": 1.0}).spreads)
    damped = model_from_text(SPREAD)
    assert "process_damping.coefficient" not in dict(damped.without_effect("process_damping").spreads)
    assert "process_damping.coefficient" not in dict(damped.with_effect("process_damping", coefficient=1.0).spreads)


@pytest.mark.parametrize(("old", "new", "said"), [
    ("550 N/mm^2", "550 +- -50 N/mm^2", ":9: cutting.tangential_coefficient: '550 +- -50 N/mm^2' has a standard deviation"),
    ("550 N/mm^2", "550 +- 0 N/mm^2", "not above 0"),
    ("550 N/mm^2", "550 +- 50", "50 has no unit"),
    ("550 N/mm^2", "550 +- 10 %", "550 has no unit"),
    ("550 N/mm^2", "550 N/mm^2 +- 5", "5 has no unit"),
    ("550 N/mm^2", "550 +- 50 Hz", "'Hz' does not convert to N/m^2"),
    ("550 N/mm^2", "+- 50 N/mm^2", "is no value with one standard deviation: write for example 550 +- 50 N/mm^2"),
    ("550 N/mm^2", "550 +- 5 +- 5 N/mm^2", "is no value with one standard deviation"),
    ("550 N/mm^2", "550 +- nan N/mm^2", "is not a finite number"),
    ("550 N/mm^2", "550 +- 5,5 N/mm^2", "holds a comma"),
    ("550 N/mm^2", "-550 +- 50 N/mm^2", "must be above 0"),
    ("0.0032", "0.0032 +- 10 %", "may mean two things: give both in one unit, such as 3 % +- 0.3 %"),
    ("flutes: 1", "flutes: 1 +- 1", "is no whole number"),
    ("19.05 mm", "19.05 +- 1 mm", "has a spread, which only values of a machine, its cutting and its effects have"),
    ("immersion: 0.162", "radial_depth: 4.5 +- 0.1 mm", "has a spread"),
])
def test_what_is_no_deviation_is_said_in_one_line(old, new, said):
    with pytest.raises(InputProblem) as problem:
        model_from_text(TEXT.replace(old, new), "m.yaml")
    assert said in str(problem.value) and "\n" not in str(problem.value)
