"""A parameter as it was found: its value with a 95 % interval."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

BEYOND = 1e4  # times a value that its interval may be wide, to be told at all
DECADE = 10.0  # times a value that its interval may be wide, for the value to be called determined


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval, in `unit`.

    size: what the interval is held against where the value may be nothing. bounded: False where the interval is all that was
    allowed, or the value was held for want of anything that tells it.
    """

    value: float
    low: float
    high: float
    unit: str
    size: float = 0.0
    bounded: bool = True

    @property
    def known(self) -> bool:
        """Whether the interval tells anything: not where it has no end, or is beyond measure wider than the value."""
        width = self.high - self.low
        return math.isfinite(width) and not width > BEYOND * abs(self.value) > 0.0

    @property
    def determined(self) -> bool:
        """Whether the data tell the value: its interval ends, and does not span decades."""
        width = self.high - self.low
        return self.bounded and math.isfinite(width) and not width > DECADE * max(abs(self.value), self.size)

    def as_json(self) -> dict[str, Any]:
        """For a command's answer: low and high are None where the interval is unknown, as people are told too."""
        low, high = (self.low, self.high) if self.known else (None, None)
        return {"value": self.value, "low": low, "high": high, "unit": self.unit, "determined": self.determined}
