"""Whether the structure that rings while cutting is the one that a tap showed: their intervals, side by side.

A tap is made on a machine at rest. A joint that slips, a spindle that turns, a workpiece that loses mass move the modes. It is
said only where both intervals tell it, and where the model leaves nothing but noise of the records: else what it lacks may have
moved its parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from testbed.analysis.estimate import Estimate
from testbed.machine import Model

_NAMES = {"natural_frequency": "natural frequency", "damping_ratio": "damping ratio", "mass": "modal mass",
          "direction": "direction"}
# what intervals, which are of noise, do not hold: clocks of two recorders, windows, a hammer's and a sensor's calibration
_SLACK = {"natural_frequency": 2e-4, "damping_ratio": 0.02, "mass": 0.02, "direction": 0.02}  # of the value; rad
_SHOWN = {"kg": "kg", "1": "", "rad": "rad", "Hz": "Hz"}


@dataclass(frozen=True)
class TappedParameter:
    """One parameter of a mode as the records show it, and the interval (low, high) of the tap, SI.

    differs: whether the two intervals lie apart; None where the records do not tell it.
    """

    path: str
    found: Estimate
    low: float
    high: float
    differs: bool | None

    @property
    def change(self) -> float:
        """Relative change from the tap's middle to the records' value; of an angle, the angle (rad)."""
        middle = 0.5 * (self.low + self.high)
        return self.found.value - middle if self.found.unit == "rad" else self.found.value / middle - 1.0

    def as_json(self) -> dict[str, Any]:
        """SI values, for `--json`."""
        return {"parameter": self.path, "found": self.found.as_json(), "tap_low": self.low, "tap_high": self.high,
                "change": self.change, "differs": self.differs}


def beside_the_tap(model: Model, found: Mapping[str, Estimate], explained: bool) -> tuple[TappedParameter, ...]:
    """The parameters that a tap gave (of the model as believed), beside those that a fit of records found.

    explained: whether the fitted model leaves nothing but noise of the records.
    """
    rows = []
    for path, (low, high) in model.tapped.items():
        if path.rpartition(".")[2] in _NAMES and path in found and found[path].determined:
            one = found[path]
            slack = _SLACK[path.rpartition(".")[2]] * (1.0 if one.unit == "rad" else abs(one.value))
            apart = one.low - slack > high or one.high + slack < low
            rows.append(TappedParameter(path, one, low, high, apart if explained else None))
    return tuple(rows)


def said_of_the_tap(rows: tuple[TappedParameter, ...], cutting: bool) -> list[str]:
    """The sentences: what differs, else what is the same, else why that is not told. cutting: whether the records hold cuts."""
    if not rows:
        return []
    where, when = ("in the cut", "while cutting") if cutting else ("in these records", "there")
    if all(row.differs is None for row in rows):
        return ["the model leaves more than noise, so the tap's modes cannot be checked here"]
    apart = [row for row in rows if row.differs]
    if not apart:
        names = ", ".join(f"{_name(row.path)} {_shown(row.found.value, row)}" for row in rows)
        return [f"{where} the modes are those of the tap, within both intervals: {names}"]
    return [f"{where} {_verb(row.path)} {_shown(row.found.value, row)} +- {0.5 * (row.found.high - row.found.low):.1g}, "
            f"the tap says {_shown(0.5 * (row.low + row.high), row)} +- {0.5 * (row.high - row.low):.1g}: {_change(row)} {when}"
            for row in apart]


def _name(path: str) -> str:
    mode, _, name = path.rpartition(".")
    return f"{_NAMES[name]}{f' of {mode}' if mode else ''}"


def _verb(path: str) -> str:
    mode, _, name = path.rpartition(".")
    if name == "natural_frequency":
        return f"the structure{f' ({mode})' if mode else ''} rings at"
    return f"the {_name(path)} is"


def _shown(value: float, row: TappedParameter) -> str:
    """With four digits, or as many as show a difference."""
    gap = abs(row.found.value - 0.5 * (row.low + row.high)) if row.differs else 0.0
    digits = max(4, 2 + math.ceil(math.log10(abs(row.found.value) / gap))) if gap > 0.0 and row.found.value != 0.0 else 4
    return f"{value:.{digits}g} {_SHOWN[row.found.unit]}".rstrip()


def _change(row: TappedParameter) -> str:
    name, change = row.path.rpartition(".")[2], row.change
    if name == "direction":
        return f"turned by {change:.3g} rad"
    size = f"{100.0 * abs(change):.2g} %"
    if name == "natural_frequency":
        return f"{'softer or heavier' if change < 0.0 else 'stiffer or lighter'}, {size} of the frequency,"
    return f"{'less' if change < 0.0 else 'more'} by {size}"
