"""Units at the border: text such as `2.573 kg` becomes an SI number, and what the table does not know is refused.

A dimension is named by its SI unit as stored (`kg`, `Hz`, `N/m^2`, ...). The table is closed on purpose: general unit
packages read `g` as a gram and `mil` as an angle, which in a vibration laboratory are an acceleration and a length.
"""

from __future__ import annotations

import difflib
import math
import re
from typing import NamedTuple

_TURN = 2.0 * math.pi
_INCH, _POUND_FORCE, _STANDARD_GRAVITY = 0.0254, 4.4482216152605, 9.80665

# One line a dimension: its SI unit, then every unit text that is known for it with the factor to SI.
TABLE: dict[str, dict[str, float]] = {
    "1": {"1": 1.0, "%": 1e-2},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": _INCH, "ft": 12 * _INCH, "mil": _INCH * 1e-3},
    "m/tooth": {"m/tooth": 1.0, "mm/tooth": 1e-3, "um/tooth": 1e-6, "in/tooth": _INCH},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6, "in/s": _INCH, "ft/s": 12 * _INCH, "m/min": 1 / 60,
            "mm/min": 1e-3 / 60},
    "m/s^2": {"m/s^2": 1.0, "cm/s^2": 1e-2, "mm/s^2": 1e-3, "um/s^2": 1e-6, "in/s^2": _INCH, "ft/s^2": 12 * _INCH,
              "g": _STANDARD_GRAVITY, "mg": _STANDARD_GRAVITY * 1e-3},
    "kg": {"kg": 1.0, "gram": 1e-3, "lb": 0.45359237},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "Hz": {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "1/s": 1.0, "S/s": 1.0, "kS/s": 1e3, "MS/s": 1e6},
    "rad/s": {"rad/s": 1.0, "rpm": _TURN / 60.0, "rev/min": _TURN / 60.0, "rev/s": _TURN, "deg/s": _TURN / 360.0},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": _TURN / 360.0},
    "N": {"N": 1.0, "daN": 10.0, "kN": 1e3, "mN": 1e-3, "lbf": _POUND_FORCE, "kgf": _STANDARD_GRAVITY},
    "N/m": {"N/m": 1.0, "N/mm": 1e3, "kN/m": 1e3, "MN/m": 1e6, "N/um": 1e6, "kN/mm": 1e6},
    "N/m^2": {"N/m^2": 1.0, "N/mm^2": 1e6, "kN/m^2": 1e3, "Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9},
    "N/m^3": {"N/m^3": 1.0, "N/mm^3": 1e9},
    "N s/m": {"N s/m": 1.0, "N s/mm": 1e3, "kg/s": 1.0},
    "N s^2/m^2": {"N s^2/m^2": 1.0, "N s^2/mm^2": 1e6, "kg/m": 1.0},
    "1/m": {"1/m": 1.0, "1/mm": 1e3},
    "V": {"V": 1.0, "mV": 1e-3, "uV": 1e-6},
    "revolutions": {"revolutions": 1.0, "revolution": 1.0, "rev": 1.0},
    "passes": {"passes": 1.0, "pass": 1.0},
}
# Dimensions that may stand for one another: a frequency of turning and an angular speed.
_BRIDGES = {("Hz", "rad/s"): _TURN, ("rad/s", "Hz"): 1.0 / _TURN}

_SI_OF = {unit: (si, factor) for si, units in TABLE.items() for unit, factor in units.items()}
_SPELLINGS = str.maketrans({"µ": "u", "μ": "u", "²": "^2", "³": "^3", "·": " ", "*": " ", "°": "deg"})
_WORDS = {"inch": "in", "inches": "in", "thou": "mil", "mils": "mil", "kilogram": "kg", "kilograms": "kg",
          "RPM": "rpm", "r/min": "rpm", "degree": "deg", "degrees": "deg", "sec": "s", "volt": "V",
          "volts": "V", "micron": "um", "microns": "um", "micrometer": "um", "micrometers": "um", "micrometre": "um",
          "micrometres": "um", "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
          "meter": "m", "metre": "m", "meters": "m", "metres": "m", "second": "s", "seconds": "s", "newton": "N",
          "newtons": "N", "hertz": "Hz", "percent": "%", "": "1", "-": "1"}
_EXAMPLES = ("um", "mm", "m/s", "m/s^2", "g", "N", "V", "rad", "deg", "Hz", "rpm", "s")
# an SI unit of an effect's parameter: products, one quotient, powers
_SI_FACTOR = r"(?:1|m|kg|s|N|rad|Hz|Pa|J|W|V|A|K)(?:\^-?\d+(?:\.\d+)?)?"
_SI_UNIT = re.compile(rf"{_SI_FACTOR}(?: {_SI_FACTOR})*(?:/(?:{_SI_FACTOR}|\({_SI_FACTOR}(?: {_SI_FACTOR})*\)))?")
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.DOTALL)
SPREAD_SIGN = re.compile(r"\+/?-|±")  # between a value and its standard deviation
_COMMA = re.compile(r"\s*([+-]?)(\d*),(\d+(?:[eE][+-]?\d+)?)(?![\d.,])\s*(.*?)\s*", re.DOTALL)


class UnitProblem(ValueError):
    """A text that is no quantity of the wanted dimension: `what` is wrong and what to `do`."""

    def __init__(self, what: str, do: str) -> None:
        self.what, self.do = what, do
        super().__init__(f"{what}: {do}")


class Unit(NamedTuple):
    """A known unit: its text, the SI unit of its dimension and the factor to it."""

    text: str
    si: str
    factor: float


def nearest(name: str, known: object) -> str | None:
    """The known name closest to a misspelt one, or None where none is close."""
    names = [str(item) for item in known]  # type: ignore[attr-defined]
    folded = {item.casefold(): item for item in reversed(names)}
    close = difflib.get_close_matches(name.casefold(), list(folded), n=1, cutoff=0.6)
    return folded[close[0]] if close else None


def spelled(text: str) -> str:
    """A unit's text in the table's spelling: `µm` is `um`, `N/mm2` and `N/mm²` are `N/mm^2`, `N*s/m` is `N s/m`."""
    unit = " ".join(str(text).translate(_SPELLINGS).replace("**", "^").split())
    unit = re.sub(r"(?<=[a-z])([23])\b", r"^\1", unit)
    unit = re.sub(r"\s*/\s*", "/", unit)
    return _WORDS.get(unit, unit)


def known_units(si: str | None = None) -> tuple[str, ...]:
    """Unit texts of one dimension (named by its SI unit), or of all."""
    return tuple(TABLE.get(si, {si: 1.0})) if si is not None else tuple(_SI_OF)


def unit_named(text: str) -> Unit:
    """The unit of a text; UnitProblem, with examples of what is known, where the table does not hold it."""
    unit = spelled(text)
    if unit not in _SI_OF:
        close = nearest(unit, _SI_OF)
        hint = f"did you mean {close}? " if close else ""
        raise UnitProblem(f"unknown unit '{text}'", f"{hint}known are for example {', '.join(_EXAMPLES)}")
    return Unit(unit, *_SI_OF[unit])


def is_si_unit(text: str) -> bool:
    """Whether a text is made of SI symbols, such as `N s^2/m^2`, `1/(N m)` or `1` (no prefixes: inside, all is SI)."""
    return _SI_UNIT.fullmatch(text) is not None


def factor_to(text: str, si: str) -> float:
    """Factor from a unit's text to the SI unit `si`; UnitProblem where it is unknown or of another dimension."""
    unit, asked = spelled(text), spelled(si)
    if unit == asked:
        return 1.0
    own, factor = _SI_OF.get(unit, (None, 1.0))
    target, target_factor = _SI_OF.get(asked, (asked, 1.0))
    if own == target:
        return factor / target_factor
    if (own, target) in _BRIDGES:
        return factor * _BRIDGES[own, target] / target_factor  # type: ignore[index]
    known = known_units(target)
    close = nearest(unit, known)
    hint = f"did you mean {close}? " if close else ""
    wanted = "a bare number" if target == "1" else target
    what = f"unknown unit '{text}'" if own is None else f"'{text}' does not convert to {wanted}"
    raise UnitProblem(what, f"{hint}known here: {', '.join(known)}")


def parse_quantity(value: object, si: str) -> float:
    """A quantity written by a user, as a number in `si`.

    value: a text such as `550 N/mm^2`; a bare number only where the quantity is dimensionless (si = "1").
    Raises UnitProblem for anything else, a NaN or an infinity.
    """
    target = spelled(si)
    example = "write a plain number, without a unit" if target == "1" else \
        f"write it with its unit, for example {_example(value, target)}"
    if value is None:
        raise UnitProblem("is empty", example)
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise UnitProblem(f"'{value}' is not a number with a unit", example)
    if isinstance(value, str) and SPREAD_SIGN.search(value):
        raise UnitProblem(f"'{value}' has a spread, which only values of a machine, its cutting and its effects have",
                          "give the value alone")
    refuse_decimal_comma(value)
    match = _NUMBER.fullmatch(str(value))
    if match is None or not math.isfinite(float(match[1])):
        raise UnitProblem(f"'{value}' is not a finite number", example)
    if not match[2] and target != "1":
        raise UnitProblem(f"{value} has no unit", f"{example} (known here: {', '.join(known_units(target))})")
    return float(match[1]) * factor_to(match[2], target)


def parse_sampling_rate(value: object) -> float:
    """A sampling rate written by a user, in Hz: as `parse_quantity`, but a speed of turning (rpm) is refused."""
    rate = parse_quantity(value, "Hz")
    match = _NUMBER.fullmatch(str(value))
    if match is not None and unit_named(match[2]).si != "Hz":
        raise UnitProblem(f"'{value}' is a speed of turning, no sampling rate", f"write {_example(value, 'Hz')}")
    return rate


def refuse_decimal_comma(value: object) -> None:
    """Raises UnitProblem for a number with a comma, such as `12,8 kHz`, and says how to write it."""
    match = _COMMA.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        return
    sign, whole, rest, unit = match.groups()
    unit = f" {unit}" if unit else ""
    # three digits behind the comma may also be thousands
    thousands = f", or {sign}{whole}{rest}{unit} if thousands are meant" if whole and re.fullmatch(r"\d{3}", rest) else ""
    raise UnitProblem(
        f"'{value}' holds a comma", f"write a decimal point: {sign}{whole or 0}.{rest}{unit}{thousands}"
    )


def _example(value: object, si: str) -> str:
    usual = {"m": "mm", "m/tooth": "mm/tooth", "rad/s": "rpm", "rad": "deg", "N/m^2": "N/mm^2", "1": ""}.get(si, si)
    match = None if isinstance(value, bool) else _NUMBER.fullmatch(str(value))
    number = match[1] if match and math.isfinite(float(match[1])) else 1
    return f"'{number} {usual}'".replace(" '", "'")


def format_quantity(value: float, unit: str, digits: int | None = 6) -> str:
    """An SI value written in `unit`, as `parse_quantity` reads it; digits=None writes it so that it reads back exactly.

    Where no decimal text in `unit` reads back exactly, the exact form falls to the SI unit.
    """
    name = spelled(unit)
    si, factor = _SI_OF.get(name, (name, 1.0))
    value = float(value)  # of numpy's scalars, the repr is no number
    suffix = "" if name == "1" else f" {name}"
    if digits is not None:
        return f"{value / factor:.{digits}g}{suffix}"
    for text in (f"{value / factor:.12g}", f"{value / factor:.15g}", repr(value / factor), f"{value / factor:.17g}"):
        if float(text) * factor == value:
            return f"{text}{suffix}"
    return f"{value!r}{'' if si == '1' else ' ' + si}"
