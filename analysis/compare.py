"""Where a model fails: every record predicted by the refitted model, its error by segment in units of the noise, and
whether anything but noise is left.

The error of a record is that of a model fitted without the record's operating condition. What belongs to the record and
not to the machine (entry, true speed, offset, drift) is estimated and reported.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

from analysis.diagnosis import FAINT_REST
from analysis.fit_state import Free, WaveformFit
from analysis.held_out import RecordError, held_out_errors, holds_out, pooled, record_error
from analysis.identify import Estimate
from analysis.information import Z_95, autocorrelation, effective_size, independent
from analysis.model_fit import model_fit
from analysis.nuisances import Nuisances
from analysis.observed import Observed
from analysis.prediction import Plant, predict
from analysis.segments import Segment
from analysis.spindle_clock import turns_of
from analysis.spindle_speed import at_modelled_speed
from analysis.waveform import Fitter
from testbed.effect import Effect
from testbed.machine import BASE_UNITS, Model

LAGS = 20  # autocorrelations that the Ljung-Box test looks at
SECTORS = 36  # of the tooth's turn, for the test against its angle
FALSE_DISCOVERIES = 0.05  # share of false alarms among the tests that fail (Benjamini and Hochberg 1995)
TRIVIAL = 0.02  # of the noise: what the rms may exceed it by before it counts
AT_BOUND = 1e-6  # of a bound: what is closer lies at it
NO_INTERVAL = 1e-9  # of a value: a narrower interval is none
NOTHING = 0.9  # noise over what was measured from which a record says nothing
DIRECTED = 1.5  # rad: half an interval of an angle from which the direction is unknown


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
class Adequacy:
    """One test of a record's residual: statistic, p value, and whether it fails with the false discoveries controlled."""

    record: str
    test: str
    statistic: float
    p_value: float
    fails: bool = False


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
    """The whole answer; fit and fitter are kept for the pictures. errors hold the held-out residuals."""

    error: float
    noise_floor: float
    records: tuple[RecordComparison, ...]
    nuisances: Mapping[str, float]
    parameters: Mapping[str, Estimate]
    tests: tuple[Adequacy, ...]
    fitter: Fitter
    fit: WaveformFit
    errors: tuple[RecordError, ...]

    @property
    def adequate(self) -> bool:
        """Whether nothing but noise is left of any record."""
        return not any(test.fails for test in self.tests)

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


def at_bound(free: Sequence[Free], found: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Those of the parameters that lie at an end of the range searched, or have no interval."""
    bounds = {one.path: one.bounds for one in free}
    return tuple(path for path, one in found.items() if one.high - one.low <= NO_INTERVAL * abs(one.value)
                 or any(math.isclose(one.value, end, rel_tol=AT_BOUND) for end in bounds.get(path, ())))


def said_at_bound(paths: Sequence[str]) -> str:
    """In words, what it means that parameters lie at a bound."""
    which = "it" if len(paths) == 1 else "them"
    return f"{', '.join(paths)} at the end of the range searched: these records do not determine {which} with this model"


def unit_of(path: str, catalogue: Mapping[str, Effect]) -> str:
    """SI unit of a fitted parameter by its path."""
    if path == "mark_angle":
        return "rad"
    effect, _, parameter = path.partition(".")
    return catalogue[effect].parameter(parameter).unit if parameter else BASE_UNITS[path]


def estimates(fitter: Fitter, fit: WaveformFit, catalogue: Mapping[str, Effect]) -> dict[str, Estimate]:
    """Every fitted machine parameter with its 95 % interval.

    The interval is that of the linearised fit, widened for residuals that are larger than the noise and correlated, and to
    hold what other states that explain as much would give, within what is possible. A strength whose direction is unknown
    is at least what it is along the direction found.
    """
    count = sum(rest.size for rest in fit.residuals)
    wider = math.sqrt(max(1.0, count / effective_size(fit)))
    spread = Z_95 * wider * np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    found = {}
    adrift = {one.path.partition(".")[0] for one, half in zip(fitter.free, spread, strict=False)
              if "." in one.path and unit_of(one.path, catalogue) == "rad" and half > DIRECTED}
    for one, half in zip(fitter.free, spread, strict=False):
        value, (least, most) = fit.state.model.value(one.path), one.bounds
        others = [state.model.value(one.path) for state in fit.alike]
        low, high = min([value, *others]) - float(half), max([value, *others]) + float(half)
        name, _, parameter = one.path.partition(".")
        if name in adrift and catalogue[name].parameter(parameter).vanishes:
            high = max(high, most)
        low, high = min(max(low, least), value), max(min(high, most), value)
        found[one.path] = Estimate(value, low, high, unit_of(one.path, catalogue))
    return found


def mark_angle(fit: WaveformFit, pitch: float) -> float:
    """Angle (rad) that the spindle turns through from a tooth's entry to the mark; teeth alike, it is one of a pitch."""
    return (-fit.state.angle) % pitch


def compare(plant: Plant, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect]) -> Comparison:
    """Refit the model to all records with every nuisance and say where, and by how much, it fails."""
    records = at_modelled_speed(records, model.effects, catalogue)
    fitter, fit = model_fit(plant, records, model, catalogue)
    errors, held_out = held_out_errors(fitter, fit), holds_out(records)
    rows, tests = [], []
    for index, (record, error) in enumerate(zip(fitter.records, errors, strict=True)):
        rows.append(_record(plant, record, error, fit, index, held_out))
        tests += adequacy_tests(record, error, fit.state.angle, fit.state.nuisances[index])
    overall, noise = pooled(errors)
    shared = {}
    if fitter.fits_angle:
        place = fit.names.index("mark_angle")
        shared = {"mark_angle": mark_angle(fit, model.cutter.pitch if model.cutter else 2 * math.pi),
                  "mark_angle_interval": Z_95 * float(fit.covariance[place, place]) ** 0.5}
    return Comparison(overall, noise, tuple(rows), shared, estimates(fitter, fit, catalogue), tuple(controlled(tests)),
                      fitter, fit, tuple(errors))


def _record(plant: Plant, record: Observed, error: RecordError, fit: WaveformFit, index: int,
            held_out: bool) -> RecordComparison:
    error_fit = record_error(record, fit.residuals[index]).error
    segments = tuple(found for segment in record.segments if (found := segment_error(record, error.residual, segment)))
    chi_square = float(np.sum((error.residual / record.noise[:, None]) ** 2)) / record.size
    nuisances = _nuisances(plant, record, fit.state.model, fit.state.angle, fit.state.nuisances[index])
    return RecordComparison(record.name, record.kind, record.channels, error.error, error_fit, error.noise_floor,
                            tuple(map(float, record.noise)), record.noise_basis, held_out, chi_square, segments, nuisances)


def segment_error(record: Observed, residual: np.ndarray, segment: Segment) -> SegmentError | None:
    """The error within one segment, from the residual (channels, samples) in the channels' units; None without samples."""
    first = max(0, round((segment.start - record.start) * record.rate))
    last = min(record.samples, round((segment.stop - record.start) * record.rate))
    if last - first < 2:
        return None
    rest, data = residual[:, first:last], record.data[:, first:last]
    size = data.std(axis=1)
    scale = 1.0 / np.maximum(size, 1e-300)
    share = np.sqrt(np.mean((rest * scale[:, None]) ** 2))
    noise = np.sqrt(np.mean((record.noise * scale) ** 2))
    chi_square = np.mean((rest / record.noise[:, None]) ** 2)
    return SegmentError(segment.kind, segment.start, segment.stop, float(share), float(noise), float(chi_square),
                        last - first)


def _nuisances(plant: Plant, record: Observed, model: Model, angle: float, own: Nuisances) -> dict[str, Any]:
    """What was found of one record. offset in the channel's unit at mid-record, drift its mean slope a second."""
    predicted = predict(plant, record, [(model, angle, own)])[0]
    slow = ((record.data - predicted) @ record.drift) @ record.drift.T
    duration = (record.samples - 1) / record.rate
    found: dict[str, Any] = {"offset": dict(zip(record.channels, slow.mean(axis=1).tolist(), strict=True))}
    if record.drift.shape[1] > 1:
        found["drift"] = dict(zip(record.channels, ((slow[:, -1] - slow[:, 0]) / duration).tolist(), strict=True))
    if record.kind != "excited":
        found |= {"initial_displacement": own.displacement, "initial_velocity": own.velocity}
    if record.cut is None:
        return found
    speed = 2 * math.pi / record.period * own.speed
    end = record.start + record.samples / record.rate
    places = own.entry + own.late_entry, own.exit - own.early_exit
    entry, leave = (record.pass_start(place, angle, own) for place in places)
    return found | {"spindle_speed": speed, "speed_error": speed / record.cut.spindle_speed - 1.0,
                    "constant_speed": record.marks is None, "tooth_angle": own.angle,
                    "entry_time": None if record.starts_in_cut else entry, "exit_time": leave if leave < end else None}


def tooth_angle(record: Observed, angle: float, own: Nuisances) -> np.ndarray:
    """Angle (rad) of the spindle since a tooth last stood at its entry, at every sample of a cut: 0 to one pitch."""
    time = record.start + np.arange(record.samples) / record.rate
    if record.marks is not None:
        turns = np.interp(time, record.marks, turns_of(record.marks)) - (angle + own.angle) / (2 * math.pi)
    else:
        turns = (time - record.pass_start(0, angle, own)) / record.period * own.speed
    return (turns * 2 * math.pi) % (2 * math.pi / record.flutes)


_LEFT = {"rms": "too large", "autocorrelation": "not random", "tooth angle": "recurring with the tooth"}
LEFT_EXPLAINED = ("what is left is more than noise where it is larger than that, not random (a sample foretells the next), "
                  "or recurring with the angle of the tooth")


def said_left(tests: Sequence[Adequacy], record: str) -> str:
    """In words, what a record's residual is, by the tests that fail."""
    failing = [test.test.partition(", ") for test in tests if test.record == record and test.fails]
    return ", ".join(_LEFT[name] + (f" in {channel}" if channel else "") for name, _, channel in failing) or "noise"


def adequacy_tests(record: Observed, error: RecordError, angle: float, own: Nuisances) -> list[Adequacy]:
    """Every channel's rms against its noise (an F test), Ljung-Box on the effective sample size, dependence on tooth angle.

    Of several channels the tests of the second and further ones are named with theirs.
    """
    return [replace(test, test=test.test if place == 0 else f"{test.test}, {channel}")
            for place, channel in enumerate(record.channels)
            for test in _channel_tests(record, error.residual[place] / record.noise[place], angle, own)]


def _channel_tests(record: Observed, rest: np.ndarray, angle: float, own: Nuisances) -> list[Adequacy]:
    """The tests of one channel's residual (samples,) in units of its noise."""
    rest = rest - rest.mean()
    correlation = autocorrelation(rest)
    size = max(independent(correlation), LAGS + 2.0)
    idle = max((s.stop - s.start for s in record.segments if s.kind == "idle"), default=0.0) * record.rate
    ratio = float(rest @ rest) / len(rest)
    p_rms = float(stats.f.sf(ratio / (1.0 + TRIVIAL) ** 2, size, max(idle, 100.0)))
    lags = np.arange(1, LAGS + 1)
    ljung_box = size * (size + 2.0) * float(np.sum(correlation[1:LAGS + 1] ** 2 / np.maximum(size - lags, 1.0)))
    tests = [Adequacy(record.name, "rms", math.sqrt(ratio), p_rms),
             Adequacy(record.name, "autocorrelation", ljung_box, float(stats.chi2.sf(ljung_box, LAGS)))]
    if record.cut is not None:
        place = (tooth_angle(record, angle, own) * record.flutes / (2 * math.pi) * SECTORS).astype(int) % SECTORS
        count = np.bincount(place, minlength=SECTORS)
        mean = np.bincount(place, rest, minlength=SECTORS) / np.maximum(count, 1)
        statistic = float(np.sum(count * mean**2)) * size / len(rest) / max(ratio, 1e-300)
        tests.append(Adequacy(record.name, "tooth angle", statistic, float(stats.chi2.sf(statistic, SECTORS - 1))))
    return tests


def controlled(tests: Sequence[Adequacy], level: float = FALSE_DISCOVERIES) -> list[Adequacy]:
    """The tests, each marked whether it fails (Benjamini and Hochberg 1995, J. R. Stat. Soc. B 57, 289)."""
    order = sorted(range(len(tests)), key=lambda place: tests[place].p_value)
    last = max((rank for rank, place in enumerate(order, 1) if tests[place].p_value <= level * rank / len(tests)), default=0)
    failing = set(order[:last])
    return [replace(test, fails=place in failing) for place, test in enumerate(tests)]


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
            "noise_basis": one.noise_basis, "segments": [vars(segment) for segment in one.segments],
            "nuisances": one.nuisances, "tests": tests_of(one.name),
        } for one in result.records],
        "nuisances": dict(result.nuisances),
        "parameters": {path: one.as_json() for path, one in result.parameters.items()},
    }
