"""model.yaml: what is read, what is refused in one line with its place, and that what is written reads back."""

import math
from dataclasses import replace

import pytest

from testbed.catalogue import catalogue
from testbed.files.model_file import model_from_text, model_text, read_model, write_model
from testbed.files.structure_file import machines
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.problem import InputProblem

TEXT = """structure:
  mass: 2.573 kg
  natural_frequency: 146.6 Hz
  damping_ratio: 0.0032
cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}
cutting:
  direction: up-milling
  immersion: 0.162
  tangential_coefficient: 550 N/mm^2
  normal_coefficient: 200 N/mm^2
effects:
  process_damping: {coefficient: 1.0e5 N/m}
"""


def test_the_contracts_example():
    model = model_from_text(TEXT)
    assert model == Model(Structure(2.573, 146.6, 0.0032), Cutter(1, 0.01905, 0.0),
                          Cutting("up-milling", 0.162, 5.5e8, 2e8), {"process_damping": {"coefficient": 1e5}})


def test_a_machine_without_cutter():
    model = model_from_text("structure: {mass: 1 kg, natural_frequency: 50 Hz, damping_ratio: 1 %}")
    assert model.cutter is None and model.cutting is None and model.structure.damping_ratio == 0.01


def test_radial_depth_stands_for_immersion():
    model = model_from_text(TEXT.replace("immersion: 0.162", "radial_depth: 4.51 mm"))
    assert model.cutting.immersion == pytest.approx(math.acos(1 - 2 * 4.51 / 19.05) / (2 * math.pi), rel=1e-12)


@pytest.mark.parametrize(("old", "new", "line", "said"), [
    ("mass: 2.573 kg", "mas: 2.573 kg", 2, "structure.mas: unknown key: did you mean mass?"),
    ("  mass: 2.573 kg\n", "", 1, "structure.mass: is missing"),
    ("2.573 kg", "2.573", 2, "structure.mass: 2.573 has no unit"),
    ("2.573 kg", "2.573 Hz", 2, "'Hz' does not convert to kg"),
    ("2.573 kg", "-1 kg", 2, "must be above 0"),
    ("0.0032", "1.5", 4, "damping_ratio: '1.5' must be at least 0 and below 1"),
    ("cutter:", "cuter:", 5, "cuter: unknown key: did you mean cutter?"),
    ("flutes: 1", "flutes: 0", 5, "must be at least 1"),
    ("flutes: 1", "flutes: 1.5", 5, "'1.5' is no whole number"),
    ("flutes: 1", "flutes: two", 5, "'two' is no whole number"),
    ("flutes: 1", "flutes: '1'", 5, "cutter.flutes: '1' is text: write the number without quotes: 1"),
    ("flutes: 1", "flutes: 101", 5, "cutter.flutes: '101' is more than any cutter has"),
    ("2.573 kg", "1e400 kg", 2, "'1e400 kg' is not a finite number: write it with its unit, for example '1 kg'"),
    ("immersion: 0.162", "immersion: .nan", 8, "'nan' is not a finite number: write a plain number, without a unit"),
    ("0 deg", "90 deg", 5, "-90 deg and 90 deg"),
    ("immersion: 0.162", "immersion: 1.2", 8, "cutting.immersion: '1.2' must be above 0 and at most 0.5"),
    ("  immersion: 0.162\n", "", 6, "gives no immersion"),
    ("immersion: 0.162", "immersion: 0.162\n  radial_depth: 4 mm", 6, "gives both"),
    ("immersion: 0.162", "radial_depth: 40 mm", 8, "above the cutter's diameter"),
    ("550 N/mm^2", "-600 N/mm^2", 9, "tangential_coefficient: '-600 N/mm^2' must be above 0"),
    ("550 N/mm^2", "0 N/mm^2", 9, "must be above 0"),
    ("550 N/mm^2", "1e300 N/mm^2", 9, "lies beyond 1e6 N/mm^2"),
    ("200 N/mm^2", "-2e6 N/mm^2", 10, "normal_coefficient: '-2e6 N/mm^2' lies beyond 1e6 N/mm^2"),
    ("up-milling", "upmilling", 7, "one of 'up-milling' or 'down-milling'"),
    ("process_damping:", "proces_damping:", 12, "did you mean process_damping?"),
    ("{coefficient:", "{coeficient:", 12, "did you mean coefficient?"),
    ("{coefficient: 1.0e5 N/m}", "{}", 12, "process_damping.coefficient: is missing"),
    ("{coefficient: 1.0e5 N/m}", "null", 12, "add it, for example"),
    ("1.0e5 N/m", "1.0e5", 12, "has no unit"),
    ("1.0e5 N/m", "-1.0e5 N/m", 12, "outside the law's bounds"),
    ("  damping_ratio: 0.0032\n", "  damping_ratio: 0.0032\n  mass: 3 kg\n", 5, "duplicate key"),
    ("mass: 2.573 kg", "mass: [2.573 kg", None, "not valid YAML"),
])
def test_what_is_wrong_is_said_in_one_line_with_its_place(old, new, line, said):
    assert old in TEXT
    with pytest.raises(InputProblem) as problem:
        model_from_text(TEXT.replace(old, new), "m.yaml")
    message = str(problem.value)
    assert said in message and "\n" not in message
    assert message.startswith(f"m.yaml:{line}: " if line else "m.yaml:")


@pytest.mark.parametrize("part", ["cutter", "cutting"])
def test_cutter_and_cutting_stand_or_fall_together(part):
    lines = TEXT.splitlines()
    begin = next(number for number, line in enumerate(lines) if line.startswith(f"{part}:"))
    end = next(number for number in range(begin + 1, len(lines) + 1) if not lines[number].startswith(" "))
    with pytest.raises(InputProblem, match="without"):
        model_from_text("\n".join(lines[:begin] + lines[end:]))


@pytest.mark.parametrize("text", ["", "[]", "just words", "structure: &a {mass: *a}", "a: *b", "\x00", "? [1]\n: 2"])
def test_what_is_no_model_is_an_input_problem(text):
    with pytest.raises(InputProblem):
        model_from_text(text)


def test_a_law_of_another_form():
    """The exponent of a law need not be given, and reads back where it is."""
    text = TEXT.replace("process_damping: {coefficient: 1.0e5 N/m}",
                        "quadratic_damping: {coefficient: 300 N s^2/m^2, exponent: 3, reference_velocity: 80 mm/s}")
    found = model_from_text(text)
    assert found.effects["quadratic_damping"] == {"coefficient": 300.0, "exponent": 3.0, "reference_velocity": 0.08}
    assert model_from_text(model_text(found)) == found
    plain = model_from_text(text.replace(", exponent: 3, reference_velocity: 80 mm/s", ""))
    assert plain.effects["quadratic_damping"] == {"coefficient": 300.0} and "exponent" not in model_text(plain)
    with pytest.raises(InputProblem, match="did you mean exponent"):
        model_from_text(text.replace("exponent: 3", "exponnent: 3"))
    with pytest.raises(InputProblem, match="outside the law's bounds"):
        model_from_text(text.replace("exponent: 3", "exponent: 30"))


@pytest.mark.parametrize("normal", [0.0, -200.0, 1e6])
def test_a_normal_coefficient_may_be_negative_or_nothing(normal):
    found = model_from_text(TEXT.replace("200 N/mm^2", f"{normal} N/mm^2"))
    assert found.cutting.normal_coefficient == pytest.approx(1e6 * normal)
    assert model_from_text(model_text(found)) == found


def test_a_missing_file_a_folder_and_a_binary_file(tmp_path):
    (tmp_path / "binary").write_bytes(bytes(range(256)))
    for path in (tmp_path / "none.yaml", tmp_path, tmp_path / "binary"):
        with pytest.raises(InputProblem):
            read_model(path)


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_a_model_with_any_effect_reads_back_exactly(name, tmp_path):
    model = replace(model_from_text(TEXT), effects={name: catalogue()[name].example()})
    write_model(model, tmp_path / "model.yaml")
    assert read_model(tmp_path / "model.yaml") == model


def test_awkward_numbers_read_back_exactly():
    model = Model(Structure(1 / 3, 100 * math.pi, 1e-17 / 3), Cutter(3, 0.1 / 7, math.pi / 7),
                  Cutting("down-milling", 0.1 + 0.2, 5e8 / 3, -2e8 / 7))
    assert model_from_text(model_text(model)) == model


def test_a_machine_by_name_whole_or_with_values_replaced(tmp_path):
    assert "flexure" in machines()
    whole = model_from_text("structure: flexure")
    changed = model_from_text("structure: {machine: flexure, damping_ratio: 0.01}")
    assert whole.machine == changed.machine == "flexure"
    assert changed.structure == replace(whole.structure, damping_ratio=0.01)
    for model in (whole, changed):
        assert model_from_text(model_text(model)) == model
    with pytest.raises(InputProblem, match="did you mean flexure"):
        model_from_text("structure: flexur")


def test_writing_leaves_nothing_where_it_cannot_write(tmp_path):
    with pytest.raises(InputProblem):
        write_model(model_from_text(TEXT), tmp_path / "none" / "model.yaml")
    with pytest.raises(InputProblem):
        write_model(model_from_text(TEXT), tmp_path)
    assert not list(tmp_path.iterdir())
