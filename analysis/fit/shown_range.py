"""What records can show at all: frequencies, times and masses outside of which no parameter of a fit goes.

A motion slower than the record is long looks like drift, one faster than half the sampling rate like a slower one; a mass is
told by the force that moves it. So the range of a fit follows from the records, whatever their scale.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from testbed.analysis.fit.observed import Observed
from testbed.effect import Parameter

SLOWEST = 0.5  # periods in the longest record
BELIEVED = 2.0  # times what is believed, or a part of it, which a fit may always reach
MASSES = 1e6  # times the mass by which force and motion at their strongest frequency are in proportion, or a part of it
LONGEST = 3.0  # periods of the motion, of a law's time
EXAMPLES = 100.0  # times its example, which a law's time may always reach


def shown_frequencies(records: Sequence[Observed]) -> tuple[float, float]:
    """The lowest and the highest frequency (Hz) that any of the records can show."""
    return SLOWEST / max(one.samples / one.rate for one in records), 0.5 * max(one.rate for one in records)


def frequency_bounds(records: Sequence[Observed], believed: float) -> tuple[float, float]:
    """Bounds (Hz) of a natural frequency that is believed to be this (Hz): what the records can show, and round about that."""
    low, high = shown_frequencies(records)
    return min(low, believed / BELIEVED), max(high, believed * BELIEVED)


def mass_bounds(records: Sequence[Observed], believed: float) -> tuple[float, float]:
    """Bounds (kg) of a mass that driven records are to tell, round about the believed one and what they show at a glance."""
    seen = [believed]
    for one in records:
        if one.kind == "excited" and one.force is not None and one.motion is not None:
            mass = float(np.std(one.force)) / max(one.motion_size * one.main_frequency**2, 1e-300)
            seen += [mass] if mass > 0.0 and math.isfinite(mass) else []
    return min(seen) / MASSES, max(seen) * MASSES


def is_shown(parameter: Parameter, records: Sequence[Observed]) -> bool:
    """Whether any of the channels that alone show an effect's parameter was recorded, whatever its sensor sits on."""
    return not parameter.channels or any(channel.removeprefix("tool_") in parameter.channels
                                         for record in records for channel in record.channels)  # fmt: skip


def parameter_bounds(parameter: Parameter, records: Sequence[Observed]) -> tuple[float, float]:
    """Bounds of an effect's parameter: those of its law, and of a frequency or a time what these records can show."""
    low, high = parameter.bounds
    if parameter.unit == "Hz":
        slowest, fastest = shown_frequencies(records)
        return (max(low, slowest), min(high, fastest)) if max(low, slowest) < min(high, fastest) else (low, high)
    if parameter.unit == "s":
        period = max(2 * math.pi / one.main_frequency for one in records)
        return low, min(high, max(LONGEST * period, EXAMPLES * parameter.example))
    return low, high
