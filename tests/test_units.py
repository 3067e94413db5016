"""Units at the border: what is read, what is refused, and that what is written reads back."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbed.units import TABLE, UnitProblem, factor_to, format_quantity, parse_quantity, unit_named


@pytest.mark.parametrize(("text", "si", "value"), [
    ("2.573 kg", "kg", 2.573), ("146.6 Hz", "Hz", 146.6), ("550 N/mm^2", "N/m^2", 5.5e8), ("550 N/mm²", "N/m^2", 5.5e8),
    ("0.1016 mm/tooth", "m/tooth", 1.016e-4), ("1.0e5 N/m", "N/m", 1e5), ("30 deg", "rad", math.pi / 6),
    ("4.51 mm", "m", 4.51e-3), ("0.5 um", "m", 5e-7), ("0.5 µm", "m", 5e-7), ("5um", "m", 5e-6), ("16.2 %", "1", 0.162),
    (0.162, "1", 0.162), ("0.162", "1", 0.162), ("3810 rpm", "rad/s", 3810 * 2 * math.pi / 60), ("-3 um", "m", -3e-6),
    ("1 mil", "m", 2.54e-5), ("0.75 inches", "m", 0.01905), ("2 thou", "m", 5.08e-5), ("3 kilograms", "kg", 3.0),
    ("2 g", "m/s^2", 19.6133), ("5 V", "V", 5.0), ("50 N*s/m", "N s/m", 50.0),
    ("920 rad/s", "Hz", 920 / (2 * math.pi)), ("60 rev", "revolutions", 60.0),
])
def test_known_quantities(text, si, value):
    assert parse_quantity(text, si) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(("value", "si", "said"), [
    (2.573, "kg", "has no unit"), ("2.573", "kg", "has no unit"), ("2 mmm", "m", "did you mean mm"),
    ("5 hz", "Hz", "did you mean Hz"), ("3 kg", "m", "does not convert to m"), ("nan mm", "m", "finite"),
    ("inf", "1", "finite"), ("1e999 mm", "m", "finite"), (True, "1", "not a number"), (None, "m", "is empty"),
    ("1 2 mm", "m", "unknown unit"), ([1], "m", "not a number"), ("3 mm", "m/tooth", "mm/tooth"),
    ("1 V", "m", "convert"), ("12,8 kHz", "Hz", "write a decimal point: 12.8 kHz"), (",5 mm", "m", ": 0.5 mm"),
    ("2,573 kg", "kg", "point: 2.573 kg, or 2573 kg if thousands"), ("-0,5", "1", "point: -0.5"),
])
def test_refused(value, si, said):
    with pytest.raises(UnitProblem) as problem:
        parse_quantity(value, si)
    assert said in str(problem.value)


def test_an_unknown_unit_is_answered_with_what_is_near_or_with_examples():
    with pytest.raises(UnitProblem, match="known are for example um, mm, m/s"):
        unit_named("furlong")
    with pytest.raises(UnitProblem, match=r"did you mean m/s\^2"):
        unit_named("m/s^3")


def test_every_unit_stands_under_one_dimension_and_a_dimension_holds_its_own_si_unit():
    names = [unit for units in TABLE.values() for unit in units]
    assert len(names) == len(set(names)) >= 60
    assert all(units[si] == 1.0 for si, units in TABLE.items())


def test_a_unit_of_a_users_own_effect_passes_as_it_is_written():
    assert parse_quantity("3 kg m^2", "kg m^2") == 3.0
    with pytest.raises(UnitProblem):
        parse_quantity("3 kg", "kg m^2")


@given(st.floats(1e-12, 1e12), st.sampled_from([(si, unit) for si, units in TABLE.items() for unit in units]))
def test_what_is_written_exactly_reads_back_exactly(value, dimension):
    si, unit = dimension
    assert parse_quantity(format_quantity(value, unit, digits=None), si) == value


@given(st.sampled_from([(si, unit) for si, units in TABLE.items() for unit in units]))
def test_factors_multiply(dimension):
    si, unit = dimension
    assert factor_to(unit, si) * factor_to(si, unit) == pytest.approx(1.0, rel=1e-14)
