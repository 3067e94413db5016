"""What a diagnosis of a machine in x and y says of modes: one that is missing, and those that move elsewhere than believed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.diagnosis import Diagnosis
from testbed.analysis.search.missing_mode import NAMES
from testbed.machine import Model

FAR = math.radians(20)  # from the believed direction, from which that is told
KNOWN = math.radians(5)  # standard error up to which a direction is known


def with_modes_told(found: Diagnosis, believed: Model) -> Diagnosis:
    """The diagnosis with what the modes are that it names as effects, and with those that moved from the believed direction."""
    return with_strayed_directions(_with_effects_as_modes(found, believed), believed)


def _with_effects_as_modes(found: Diagnosis, believed: Model) -> Diagnosis:
    """The diagnosis with frequency, direction and carrier of every effect named that is a mode more."""
    named = [name for name in NAMES if name in found.effects]
    if not isinstance(found.best, Candidate) or not believed.structure.planar or found.mode or not named:
        return found
    effects, said = found.best.fit.state.model.effects, []
    for name in named:
        if name in effects:
            one = effects[name]
            carrier = "carried by the workpiece" if abs(one["participation"]) > 0.5 else "which no sensor of the workpiece sees"
            said.append(f"{name}: a mode of {one['frequency']:.4g} Hz that moves along "
                        f"{math.degrees(one['direction'] % math.pi):.3g} deg (from x towards y), {carrier}.")
    return replace(found, sentence=" ".join((found.sentence, *said)))


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
