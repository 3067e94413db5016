"""Records whose sensor counts the other way: positive where the chip grows thinner, a sign that no law of the machine mends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.held_out import errors_in_fit, pooled
from analysis.model_fit import model_fit
from analysis.observed import DERIVATIVES, Observed
from analysis.prediction import Plant
from testbed.effect import Effect
from testbed.machine import Model

MUCH = 3.0  # error over noise floor from which the other sign is tried
FAR_BETTER = 0.5  # times the error, that it must leave


def sign_note(
    plant: Plant, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect], error: float, noise: float
) -> list[str]:
    """A line where the model, whose error (held out or not) is given, explains far more with the motion's sign turned."""
    moving = any(name in DERIVATIVES for record in records for name in record.channels)
    if error <= MUCH * noise or not moving or all(record.cut is None for record in records):
        return []
    fitter, fit = model_fit(plant, [_turned(record) for record in records], model, catalogue)
    turned = pooled(errors_in_fit(fitter, fit))[0]
    if turned > FAR_BETTER * error:
        return []
    return [f"with the sign of the motion turned the error is {turned:.3g} instead of {error:.3g}: positive is what makes the "
            "chip thicker; if the sensor counts the other way, give its channel scale: -1"]


def _turned(record: Observed) -> Observed:
    sign = np.array([-1.0 if name in DERIVATIVES else 1.0 for name in record.channels])
    return replace(record, data=sign[:, None] * record.data)
