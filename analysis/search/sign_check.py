"""Records that agree with the model turned round: the sensor counts the other way, or the cut was made in the other direction.

No law of the machine mends either; of both, that is said instead of an effect.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbed.analysis.fit.effect_start import all_free
from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.held_out import errors_in_fit, pooled
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.starts import glance
from testbed.analysis.fit.structure_start import structure_start
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.effect import Effect
from testbed.machine import DIRECTIONS, Model

MUCH = 3.0  # error over noise floor from which the other way is tried
LIKELY = 0.8  # share of what the openings leave as stated, that a way must leave of them to be fitted in full
FAR_BETTER = 0.5  # times the error, that it must leave
SLOT = 0.499  # immersion from which both directions are one


@dataclass(frozen=True)
class _Way:
    """A campaign turned round: in words, what was turned, and what to do if that is how it was."""

    turned: str
    remedy: str
    records: Sequence[Observed]
    model: Model

    def fitted(self, engine: Engine, catalogue: Mapping[str, Effect]) -> tuple[Fitter, WaveformFit]:
        """The model as believed fitted to the records as they would have to be."""
        return model_fit(engine, self.records, self.model, catalogue)


def _ways(records: Sequence[Observed], model: Model) -> Iterator[_Way]:
    """The ways in which this campaign may be the wrong way round.

    Those of a machine in x and y are more, and a diagnosis asks them first: see `planar_slips`.
    """
    if model.structure.planar or model.cutting is None or all(record.cut is None for record in records):
        return
    if model.cutting.immersion < SLOT:
        other = next(one for one in DIRECTIONS if one != model.cutting.direction)
        cutting = replace(model.cutting, direction=other)
        yield _Way(f"as {other}", f"the model says {model.cutting.direction}: if that was not so, mend its direction", records,
                   replace(model, cutting=cutting))
    if any(sensor is not None for record in records for sensor in record.sensors):
        remedy = "positive is what makes the chip thicker; if the sensor counts the other way, give its channel scale: -1"
        yield _Way("with the sign of the motion turned", remedy, [_turned(record) for record in records], model)


def other_way_note(
    engine: Engine, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect], error: float, noise: float
) -> list[str]:
    """A line where the model, whose error (held out or not) is given, explains far more of the campaign turned round."""
    if error <= MUCH * noise:
        return []
    ways = list(_ways(records, model))
    most = LIKELY * _opening(engine, records, model, catalogue) if ways else 0.0
    likely = [way for way in ways if _opening(engine, way.records, way.model, catalogue) < most]
    left = {pooled(errors_in_fit(*way.fitted(engine, catalogue)))[0]: way for way in likely}
    if not left or min(left) > FAR_BETTER * error:
        return []
    way = left[min(left)]
    return [f"{way.turned} the error is {min(left):.3g} instead of {error:.3g}: {way.remedy}"]


def other_way(base: Candidate, model: Model, catalogue: Mapping[str, Effect]) -> str:
    """In words, how the campaign is turned round, where the believed `model` then leaves but noise of it; else nothing.

    base: the model fitted to the campaign as it is stated.
    """
    noise = pooled(base.errors)[1]
    if base.error_where_known <= MUCH * noise:
        return ""
    engine, records = base.fitter.engine, base.fitter.records
    ways = list(_ways(records, model))
    stated = _opening(engine, records, model, catalogue) if ways else 0.0
    for way in ways:
        if _opening(engine, way.records, way.model, catalogue) >= stated:
            continue
        error, floor = pooled(errors_in_fit(*way.fitted(engine, catalogue)))
        if error <= ADEQUATE * floor:
            return f"The model explains the records down to their noise {way.turned}: {way.remedy}."
    return ""


def _opening(engine: Engine, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect]) -> float:
    """What a model leaves of the records' openings, as a cost: little work beside a whole fit."""
    return glance(engine, records, structure_start(records, model), all_free(records, model, catalogue))


def _turned(record: Observed) -> Observed:
    sign = np.array([1.0 if sensor is None else -1.0 for sensor in record.sensors])
    return replace(record, data=sign[:, None] * record.data)
