"""What a tap test gives: blows, modes with their intervals, the fits they came from, decays without force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from testbed.analysis.estimate import Estimate
from testbed.analysis.tap.decays import DecaySeen
from testbed.analysis.tap.frequency_response import FrequencyResponse
from testbed.analysis.tap.order import Step
from testbed.analysis.tap.poles import Stabilisation
from testbed.analysis.tap.real_modes import Fit
from testbed.analysis.tap.scales import ScaleCheck
from testbed.machine import Carrier, Mode

_BESIDE = 10  # lines drawn below and above those used


@dataclass(frozen=True)
class BlowSeen:
    """One blow of a tap's record: when (s), how hard (N), used or why not."""

    tap: str
    time: float
    force: float
    used: bool
    why: str = ""


@dataclass(frozen=True)
class FoundMode:
    """A mode as found: each value with its interval, and what carries it."""

    natural_frequency: Estimate
    damping_ratio: Estimate
    mass: Estimate
    direction: Estimate
    on: Carrier

    def mode(self) -> Mode:
        """The vocabulary's mode."""
        return Mode(self.mass.value, self.natural_frequency.value, self.damping_ratio.value, self.direction.value, self.on)

    def as_json(self) -> dict[str, Any]:
        """SI values, for `--json`."""
        return {**{name: getattr(self, name).as_json() for name in ("natural_frequency", "damping_ratio", "mass", "direction")},
                "on": self.on}


@dataclass(frozen=True)
class Group:
    """Responses that share their modes: the search, the fit and the residual (rms over the response's rms) of each."""

    responses: tuple[FrequencyResponse, ...]
    stabilisation: Stabilisation
    steps: tuple[Step, ...]
    fit: Fit
    residuals: tuple[float, ...]

    def drawn(self, place: int) -> slice:
        """The lines of a response that are worth a picture: those used, and some to either side."""
        used = np.flatnonzero(self.fit.lines.masks[place])
        return slice(max(0, int(used[0]) - _BESIDE), int(used[-1]) + _BESIDE)


@dataclass(frozen=True)
class TapResult:
    """All that a tap test gave. residual: pooled over all believed lines. scales: what told them, and how they came out."""

    modes: tuple[FoundMode, ...]
    residual: float
    blows: tuple[BlowSeen, ...]
    groups: tuple[Group, ...]
    notes: tuple[str, ...]
    decays: tuple[DecaySeen, ...] = ()
    scales: tuple[ScaleCheck, ...] = ()

    def responses_json(self) -> list[dict[str, Any]]:
        """What was fitted of each response, for `--json`."""
        return [{"name": one.name, "on": one.on, "first_frequency": float(one.frequency[mask][0]),
                 "last_frequency": float(one.frequency[mask][-1]), "lines": int(mask.sum()), "residual": residual,
                 "coherence": None if one.coherence is None else float(np.median(one.coherence[mask]))}
                for group in self.groups
                for one, mask, residual in zip(group.responses, group.fit.lines.masks, group.residuals, strict=True)]
