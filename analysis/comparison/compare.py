"""Where a model fails: every record predicted by the refitted model, its error by segment in units of the noise, and
whether anything but noise is left.

The error of a record is that of a model fitted without the record's operating condition. What belongs to the record and
not to the machine (entry, true speed, offset, drift) is estimated and reported.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbed.analysis.comparison.adequacy import Adequacy, adequacy_tests, controlled, less_open
from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.estimates import at_bound
from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.held_guesses import with_guesses_held
from testbed.analysis.fit.held_out import RecordError, held_out_errors, holds_out, pooled, pooled_doubt, record_error
from testbed.analysis.fit.identifiable import Identifiable
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.moves import TOLD
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.plausible import against_adequacy
from testbed.analysis.fit.prediction import Engine, predict
from testbed.analysis.fit.solve import solve
from testbed.analysis.fit.spindle_speed import at_modelled_speed
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.information import Z_95
from testbed.analysis.records.segments import Segment
from testbed.analysis.search.diagnosis import FAINT_REST
from testbed.effect import Effect
from testbed.machine import Model

NOTHING = 0.9  # noise over what was measured from which a record says nothing


@dataclass(frozen=True)
class SegmentError:
    """One segment: its error and noise floor against its own rms about the mean, chi-square a sample, bounds in s."""

    kind: str
    start: float
    stop: float
    error: float
    noise_floor: float
    chi_square: float
    samples: int


@dataclass(frozen=True)
class RecordComparison:
    """One record: held-out error, error in the fit, segments, and what belongs to the record alone (SI)."""

    name: str
    kind: str
    channels: tuple[str, ...]
    error: float
    error_fit: float
    noise_floor: float
    noise: tuple[float, ...]
    noise_basis: str
    held_out: bool
    chi_square: float
    segments: tuple[SegmentError, ...]
    nuisances: Mapping[str, Any]


@dataclass(frozen=True)
class Comparison:
    """The whole answer; fit and fitter are kept for the pictures. errors hold the held-out residuals.

    against: in words, why little that is left would say nothing for the model.
    """

    error: float
    noise_floor: float
    records: tuple[RecordComparison, ...]
    nuisances: Mapping[str, float]
    parameters: Mapping[str, Estimate]
    tests: tuple[Adequacy, ...]
    fitter: Fitter
    fit: WaveformFit
    errors: tuple[RecordError, ...]
    against: tuple[str, ...] = ()

    @property
    def adequate(self) -> bool:
        """Whether nothing but noise is left of any record, by a machine that can be."""
        return not any(test.fails for test in self.tests) and not self.against

    @property
    def silent(self) -> tuple[str, ...]:
        """Records of hardly anything but noise, which say nothing about the model."""
        return tuple(one.name for one in self.records if one.noise_floor > NOTHING)

    @property
    def says_nothing(self) -> bool:
        """Whether hardly anything but noise was measured in all records: then no model is called adequate, and none bad."""
        return len(self.silent) == len(self.records)

    @property
    def slight(self) -> bool:
        """Whether what is left beyond the noise is so little that the error hardly shows it."""
        return not self.adequate and self.error <= FAINT_REST * self.noise_floor

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Parameters that ended where the range searched ends: these records do not determine them with this model."""
        return at_bound(self.fitter.free, self.parameters)


def mark_angle(fit: WaveformFit, pitch: float) -> float:
    """Angle (rad) that the spindle turns through from a tooth's entry to the mark; teeth alike, it is one of a pitch."""
    return (-fit.state.angle) % pitch


def compare(engine: Engine, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect],
            told: Identifiable | None = None) -> Comparison:
    """Refit the model to all records with every nuisance and say where, and by how much, it fails.

    told: what the records, at the speed that the model has, tell of its parameters, if that is at hand.
    """
    records = at_modelled_speed(records, model.effects, catalogue)
    fitter, fit = solve(*model_fit(engine, records, model, catalogue, told=told), TOLD)
    held = with_guesses_held(fitter, fit, model, catalogue)
    fitter, fit = held.fitter, held.fit
    errors, held_out = held_out_errors(fitter, fit), holds_out(records)
    judged, tests = less_open(fitter, fit, errors)
    rows = []
    for index, (record, error, less) in enumerate(zip(fitter.records, errors, judged, strict=True)):
        rows.append(_record(engine, record, error, fit, index, held_out))
        tests += adequacy_tests(record, less, fit.state.angle, fit.state.nuisances[index])
    overall, noise = pooled(errors)
    shared = {}
    if fitter.fits_angle:
        place = fit.names.index("mark_angle")
        alike = model.cutter.pitch if model.cutter and not model.cutter.pitch_angles else 2 * math.pi
        shared = {"mark_angle": mark_angle(fit, alike),
                  "mark_angle_interval": Z_95 * float(fit.covariance[place, place]) ** 0.5}
    against = against_adequacy(fitter, fit, model, catalogue, overall / noise, pooled_doubt(errors))
    return Comparison(overall, noise, tuple(rows), shared, held.values, tuple(controlled(tests)),
                      fitter, fit, tuple(errors), tuple(against))


def _record(engine: Engine, record: Observed, error: RecordError, fit: WaveformFit, index: int,
            held_out: bool) -> RecordComparison:
    error_fit = record_error(record, fit.residuals[index]).error
    segments = tuple(found for segment in record.segments if (found := segment_error(record, error.residual, segment)))
    chi_square = float(np.sum((error.residual / record.noise[:, None]) ** 2)) / record.size
    nuisances = _nuisances(engine, record, fit.state.model, fit.state.angle, fit.state.nuisances[index])
    return RecordComparison(record.name, record.kind, record.channels, error.error, error_fit, error.noise_floor,
                            tuple(map(float, record.noise)), record.noise_basis, held_out, chi_square, segments, nuisances)


def used_part(record: Observed) -> dict[str, float]:
    """From when to when (s) a record is predicted, and which share of it that is."""
    stop = record.start + record.samples / record.rate
    whole = max(stop, *(part.stop for part in record.segments)) - min(record.start, *(part.start for part in record.segments)) \
        if record.segments else stop - record.start
    return {"start": record.start, "stop": stop, "share": (stop - record.start) / whole}


def segment_error(record: Observed, residual: np.ndarray, segment: Segment) -> SegmentError | None:
    """The error within one segment, from the residual (channels, samples) in the channels' units; None without samples."""
    first = max(0, round((segment.start - record.start) * record.rate))
    last = min(record.samples, round((segment.stop - record.start) * record.rate))
    if last - first < 2:
        return None
    rest, data = residual[:, first:last], record.data[:, first:last]
    size = data.std(axis=1)
    scale = 1.0 / np.maximum(size, 1e-300)
    with np.errstate(over="ignore"):  # at rest, within a converter's step: no ratio
        share = np.sqrt(np.mean((rest * scale[:, None]) ** 2))
        noise = np.sqrt(np.mean((record.noise * scale) ** 2))
    chi_square = np.mean((rest / record.noise[:, None]) ** 2)
    return SegmentError(segment.kind, segment.start, segment.stop, float(share), float(noise), float(chi_square),
                        last - first)


def _nuisances(engine: Engine, record: Observed, model: Model, angle: float, own: Nuisances) -> dict[str, Any]:
    """What was found of one record. offset in the channel's unit at mid-record, drift its mean slope a second."""
    predicted = predict(engine, record, [(model, angle, own)])[0]
    slow = ((record.data - predicted) @ record.drift) @ record.drift.T
    duration = (record.samples - 1) / record.rate
    found: dict[str, Any] = {"offset": dict(zip(record.channels, slow.mean(axis=1).tolist(), strict=True))}
    if record.drift.shape[1] > 1:
        found["drift"] = dict(zip(record.channels, ((slow[:, -1] - slow[:, 0]) / duration).tolist(), strict=True))
    if record.kind != "excited":
        found |= {"initial_displacement": own.displacement, "initial_velocity": own.velocity}
        found |= {"initial_states": dict(own.states)} if record.modes > 1 else {}
    if record.cut is None:
        return found
    speed = 2 * math.pi / record.period * own.speed
    end = record.start + record.samples / record.rate
    places = own.entry + own.late_entry, own.exit - own.early_exit
    entry, leave = (record.pass_start(place, angle, own) for place in places)
    return found | {"spindle_speed": speed, "speed_error": speed / record.cut.spindle_speed - 1.0,
                    "constant_speed": record.marks is None, "tooth_angle": own.angle,
                    "entry_time": None if record.starts_in_cut else entry, "exit_time": leave if leave < end else None}


def as_json(result: Comparison) -> dict[str, Any]:
    """The answer of `testbed compare --json`, SI values. Of noise alone `adequate` is None: it says nothing of the model."""
    def tests_of(name: str) -> dict[str, Any]:
        return {one.test: {"statistic": one.statistic, "p_value": one.p_value, "fails": one.fails}
                for one in result.tests if one.record == name}

    return {
        "error": result.error, "noise_floor": result.noise_floor,
        "adequate": None if result.says_nothing else result.adequate,
        "converged": result.fit.converged, "at_bound": list(result.at_bound),
        "records": [{
            "name": one.name, "kind": one.kind, "channels": list(one.channels), "error": one.error,
            "error_fit": one.error_fit, "noise_floor": one.noise_floor, "held_out": one.held_out,
            "chi_square": one.chi_square, "noise": dict(zip(one.channels, one.noise, strict=True)),
            "noise_basis": one.noise_basis, "used": used_part(own), "segments": [vars(segment) for segment in one.segments],
            "nuisances": one.nuisances, "tests": tests_of(one.name),
        } for one, own in zip(result.records, result.fitter.records, strict=True)],
        "nuisances": dict(result.nuisances),
        "parameters": {path: one.as_json() for path, one in result.parameters.items()},
    }
