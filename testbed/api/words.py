"""Quantities for people: in the unit that is usual for them, with as many digits as their interval warrants."""

from __future__ import annotations

import math
from typing import Any

MOST_DIGITS = 12  # of a number, however narrow its interval
NOT_DETERMINED = "not determined"  # in place of an interval that spans decades


def shown(value: float, unit: str, digits: int = 5, path: str = "") -> str:
    """A quantity for people: an SI value in the unit that is usual for it, or for a parameter of that path."""
    from testbed.units import format_quantity

    usual = {"rad/s": "rpm", "N/m^2": "N/mm^2"}.get(unit, "deg" if path.endswith(".direction") else unit)
    return "-" if not math.isfinite(value) else format_quantity(value, usual, digits)


def interval_shown(one: Any, path: str = "") -> tuple[str, str, str]:
    """Value, low and high of an estimate for people, with as many digits as tell the ends apart. path: of the parameter."""
    width = one.high - one.low
    if not one.determined:
        return shown(one.value, one.unit, path=path), NOT_DETERMINED, NOT_DETERMINED
    digits = 5 if width <= 0.0 or one.value == 0.0 else math.ceil(math.log10(abs(one.value) / width)) + 2
    digits = min(max(digits, 5), MOST_DIGITS)
    value, low, high = (shown(number, one.unit, digits, path) for number in (one.value, one.low, one.high))
    return value, low, high
