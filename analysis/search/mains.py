"""Hum of the mains: a line that a sensor's wires pick up, faint in most records, and nothing that a machine's model lacks."""

from __future__ import annotations

from collections.abc import Mapping

from testbed.analysis.records.hum import MAINS
from testbed.analysis.search.candidate import Candidate
from testbed.effect import Effect

NEAR = 2e-3  # relative distance from a multiple of it within which a line is the mains': that wanders as far
HARMONICS = 5
FAINT = 0.2  # share of the mean square of what is left, from which a line is named all the same


def hum_of(one: Candidate, current: Candidate, catalogue: Mapping[str, Effect]) -> str:
    """In words, that the last effect of a set is but a faint line of the mains beside what `current` leaves; else nothing."""
    effect = catalogue[one.effects[-1]]
    if set(effect.hooks) != {"measure"} or one.error_held_out**2 < (1.0 - FAINT) * current.error_held_out**2:
        return ""
    lines = [one.parameters[f"{effect.name}.{parameter.name}"] for parameter in effect.parameters if parameter.unit == "Hz"]
    if not any(abs(line / (times * mains) - 1.0) < NEAR
               for line in lines for mains in MAINS for times in range(1, HARMONICS + 1)):  # fmt: skip
        return ""
    return f"The sensor hums faintly at {lines[0]:.2f} Hz, a line of the mains."
