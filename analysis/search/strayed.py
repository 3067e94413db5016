"""Modes that a fit found to move along another direction than the model has it: no effect is missing, and yet it is told."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from testbed.analysis.search.diagnosis import Diagnosis
from testbed.machine import Model

FAR = math.radians(20)  # from the believed direction, from which that is told
KNOWN = math.radians(5)  # standard error up to which a direction is known


def with_strayed_directions(found: Diagnosis, believed: Model) -> Diagnosis:
    """The diagnosis, where it explains the records, with the modes whose direction is far from the believed one."""
    fit = found.best.fit
    if fit is None or not believed.structure.planar or found.verdict not in ("adequate", "missing_effect") or found.mode:
        return found
    errors = dict(zip(fit.names, np.sqrt(np.maximum(np.diag(fit.covariance), 0.0)), strict=True))
    said = []
    for place, mode in enumerate(believed.structure.modes):
        path = believed.mode_path(place, "direction")
        value = fit.state.model.value(path)
        if errors.get(path, math.inf) < KNOWN and abs(math.remainder(value - mode.direction, math.pi)) > FAR:
            said.append(f"modes[{place}] moves along {math.degrees(value % math.pi):.3g} deg, not along "
                        f"{math.degrees(mode.direction):.3g} deg, as the model has it: mend its direction.")
    return replace(found, sentence=" ".join((found.sentence, *said)))
