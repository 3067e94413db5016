"""What a diagnosis of a machine in x and y says of modes: one that is missing, and those that move elsewhere than believed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.estimates import estimates
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.diagnosis import Diagnosis
from testbed.analysis.search.missing_mode import NAMES, RINGS
from testbed.effect import Effect
from testbed.machine import Model

FAR = math.radians(20)  # from the believed direction, from which that is told
VAGUE = 0.2  # of a frequency: half an interval beyond which no mode is seen to ring there
KNOWN = math.radians(5)  # standard error up to which a direction is known


def with_modes_told(found: Diagnosis, believed: Model, catalogue: Mapping[str, Effect]) -> Diagnosis:
    """The diagnosis with what the modes are that it names as effects, and with those that moved from the believed direction."""
    return with_strayed_directions(_with_effects_as_modes(found, believed, catalogue), believed)


def _with_effects_as_modes(found: Diagnosis, believed: Model, catalogue: Mapping[str, Effect]) -> Diagnosis:
    """The diagnosis with frequency, direction and carrier of every effect named that is a mode more: what the records tell."""
    named = [name for name in NAMES if name in found.effects]
    if not isinstance(found.best, Candidate) or not believed.structure.planar or found.mode or not named:
        return found
    effects, values = found.best.fit.state.model.effects, estimates(found.best.fitter, found.best.fit, catalogue)
    said = [mode_in_words(name, effects[name], values) for name in named if name in effects]
    return replace(found, sentence=" ".join((found.sentence, *said)))


def mode_in_words(name: str, one: Mapping[str, float], values: Mapping[str, Estimate]) -> str:
    if one["damping_ratio"] > RINGS or not _within(values.get(f"{name}.frequency"), VAGUE * one["frequency"]):
        return (f"{name}: these records do not show at what frequency it rings; what stands for it may be any compliance that "
                "the model lacks.")
    along = f"that moves along {math.degrees(one['direction'] % math.pi):.3g} deg (from x towards y)"
    carrier = "carried by the workpiece" if abs(one["participation"]) > 0.5 else "which no sensor of the workpiece sees"
    if not _within(values.get(f"{name}.direction"), FAR):
        along = "in a direction that these records do not show"
    return f"{name}: a mode of {one['frequency']:.4g} Hz {along}, {carrier}."


def _within(one: Estimate | None, half: float) -> bool:
    return one is not None and one.determined and one.high - one.low <= 2.0 * half


def with_strayed_directions(found: Diagnosis, believed: Model) -> Diagnosis:
    """The diagnosis, where it explains the records, with the modes whose direction is far from the believed one."""
    named = found.verdict in ("adequate", "missing_effect") and not found.mode
    if not isinstance(found.best, Candidate) or not believed.structure.planar or not named:
        return found
    fit = found.best.fit
    errors = dict(zip(fit.names, np.sqrt(np.maximum(np.diag(fit.covariance), 0.0)), strict=True))
    said = []
    for place, mode in enumerate(believed.structure.modes):
        path = believed.mode_path(place, "direction")
        value = fit.state.model.value(path)
        if errors.get(path, math.inf) < KNOWN and abs(math.remainder(value - mode.direction, math.pi)) > FAR:
            said.append(f"modes[{place}] moves along {math.degrees(value % math.pi):.3g} deg, not along "
                        f"{math.degrees(mode.direction):.3g} deg, as the model has it: mend its direction.")
    return replace(found, sentence=" ".join((found.sentence, *said)))
