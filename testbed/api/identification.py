"""What identifies a machine from records, by multipliers or by waveform, and what is to be told of each record."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

from testbed.api.believed import DataLike, name_of
from testbed.api.fitting import engine_of, observed_records, told_before
from testbed.api.records import load_records, unfit
from testbed.problem import InputProblem

MOTIONS = ("displacement", "velocity", "acceleration")
FAR_OFF = 0.2  # relative difference from which a decay is another mode's, or the belief is wrong,
FEWEST_ALIKE, MOST_OF = 2, 0.6  # if so many decays, and such a share of them, ring within
RING_ALIKE = 0.05  # of one frequency; what multipliers find beyond that of where the structure rings contradicts it
NOT_MEASURED = "measured multipliers are those of one mode along the feed"
CONTRADICTED = "nothing is identified: the free decays ring"
RATIO_DOUBT = 0.2  # standard error of the logarithm of the coefficients' ratio that a model is believed to have


@dataclass(frozen=True)
class CutTest:
    """A recorded cut ready for its multipliers: entry and exit (s) stand in the recording's conditions.

    channel: whose samples are taken; cut: at the speed that marks or vibration show.
    """

    name: str
    recording: Any
    cut: Any
    segments: tuple[Any, ...]
    channel: str


def motion_channel(record: Any) -> str | None:
    """The record's channel of motion, the least differentiated one: multipliers are the same in each."""
    return next((name for name in MOTIONS if name in record.recording.channels), None)


def cut_tests(records: Sequence[Any], flutes: int, path: object) -> list[CutTest]:
    """The cuts among records, with their entries and exits found. InputProblem where there is none."""
    from testbed.analysis.multipliers.recorded_cut import at_measured_speed
    from testbed.analysis.records.segments import find_segments

    tests = []
    for record in records:
        channel = motion_channel(record)
        if record.kind != "cut" or channel is None:
            continue
        segments = find_segments(record.recording, kind="cut")
        times = entry_and_exit(segments)
        recording = replace(record.recording, conditions={**record.recording.conditions, **times})
        try:
            cut = at_measured_speed(record.cut(flutes), recording, flutes, channel)
        except ValueError as problem:
            raise unfit(path, record.name, problem) from None
        tests.append(CutTest(record.name, recording, cut, tuple(segments), channel))
    if not tests:
        raise InputProblem(path, "holds no cut with a channel of motion", "record cuts, or use --method waveform")
    return tests


def entry_and_exit(segments: Sequence[Any]) -> dict[str, float]:
    """Times (s) of entry and exit, where the segments show them."""
    begin = [part.start for part in segments if part.kind in ("entry", "steady")]
    end = [part.start for part in segments if part.kind in ("exit", "ring-down")]
    times = {"entry_time": begin[0]} if begin else {}
    return times | ({"exit_time": end[0]} if end else {})


def free_decays(records: Sequence[Any], tests: Sequence[CutTest]) -> list[Any]:
    """The free decays after the cuts and of the taps, those that say anything."""
    from testbed.analysis.multipliers.ring_down import ring_down

    found = []
    for test in tests:
        for part in test.segments:
            if part.kind == "ring-down":
                found += _decay(ring_down, test.recording, part.start, part.stop, test.channel)
    for record in records:
        channel = motion_channel(record)
        if record.kind == "ring-down" and channel is not None:
            found += _decay(ring_down, record.recording, None, None, channel)
    return [decay for decay in found if 0 < decay.damping_ratio[0] < 0.5]


def start_from_ring_downs(model: Any, records: Sequence[Any], tests: Sequence[CutTest]) -> Any:
    """The model with frequency and damping of the free decays after the cuts and of the taps; as it was without any.

    The decay with the smallest interval of damping is taken, of those near the believed frequency. One far off may be another
    mode's, or misread; where most of several ring alike elsewhere, it is the belief that is wrong.
    """
    decays = free_decays(records, tests)
    believed = model.structure.natural_frequency
    close = _alike(decays, believed, FAR_OFF)
    if not close and decays:
        rung = float(median(float(decay.natural_frequency[0]) for decay in decays))
        alike = _alike(decays, rung, RING_ALIKE)
        close = alike if len(alike) >= max(FEWEST_ALIKE, MOST_OF * len(decays)) else []
    if not close:
        return model
    best = min(close, key=lambda decay: decay.damping_ratio_high[0] - decay.damping_ratio_low[0])
    return model.with_values({"natural_frequency": float(best.natural_frequency[0]),
                              "damping_ratio": float(best.damping_ratio[0])})


def _alike(decays: Sequence[Any], frequency: float, reach: float) -> list[Any]:
    return [decay for decay in decays if abs(float(decay.natural_frequency[0]) / frequency - 1.0) < reach]


def _of_the_decays(believed: Any, start: Any, found: Any) -> tuple[str, ...]:
    """In words, that free decays ring elsewhere than was believed, or than the machine that was found."""
    rings, was = start.structure.natural_frequency, believed.structure.natural_frequency
    now = found.structure.natural_frequency
    said = []
    if abs(rings / was - 1.0) >= FAR_OFF:
        said.append(f"the free decays ring at {rings:.4g} Hz, where the model has {was:.4g} Hz: identified from theirs")
    if start != believed and abs(now / rings - 1.0) > RING_ALIKE:
        said.append(f"{CONTRADICTED} at {rings:.4g} Hz, the multipliers would have {now:.4g} Hz; "
                    "try --method waveform, and look at the records with testbed inspect")
    return tuple(said)


def _decay(ring_down: Any, recording: Any, start: float | None, stop: float | None, channel: str) -> list[Any]:
    try:
        return [ring_down(recording, start=start, stop=stop, channel=channel)]
    except (ValueError, ArithmeticError):  # too short or too quiet a decay is no start
        return []


@dataclass(frozen=True)
class Identified:
    """What an identification found: model, parameter path -> value, low, high, unit; the tests; quality.

    at_bound: parameters that ended at an end of the range searched. notes: in words, what was taken otherwise than stated.
    said: what was said before the fit.
    """

    model: Any
    parameters: Mapping[str, Any]
    tests: tuple[Mapping[str, Any], ...]
    quality: Mapping[str, Any]
    at_bound: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    said: tuple[str, ...] = ()


def identify_by_multipliers(model: Any, records: Sequence[Any], path: object, seed: int, *,
                            ratio_doubt: float = RATIO_DOUBT) -> Identified:
    """Fit the characteristic multipliers of the cuts. ValueError where they do not suffice."""
    from testbed.analysis.fit.plausible import remarks_on
    from testbed.analysis.multipliers.identify import at_an_end, identify_multipliers
    from testbed.analysis.multipliers.recorded_cut import measured_multipliers

    flutes = model.cutter.flutes
    tests = cut_tests(records, flutes, path)
    measured = [measured_multipliers(test.recording, test.cut, flutes, test.channel) for test in tests]
    start = start_from_ring_downs(model, records, tests)
    found = identify_multipliers(start, [test.cut for test in tests], measured, names=[test.name for test in tests], seed=seed,
                                 ratio_doubt=ratio_doubt)
    rows = tuple(_row(test, result.measured, result.model, result.used, result.reason)
                 for test, result in zip(tests, found.tests, strict=True))
    said, parameters = _of_the_decays(model, start, found.model), found.parameters
    if any(one.startswith(CONTRADICTED) for one in said):
        parameters = {path: replace(one, low=-math.inf, high=math.inf) for path, one in parameters.items()}
    return Identified(found.model, parameters, rows,
                      {"chi_square": found.chi_square, "converged": found.converged, "ratio_slope": found.ratio_slope},
                      at_an_end(start, found.model), (*said, *remarks_on(model, found.model)))


def _row(test: CutTest, measured: Any, model: Any, used: bool, reason: str) -> dict[str, Any]:
    return {"name": test.name, "spindle_speed": test.cut.spindle_speed, "axial_depth_of_cut": test.cut.axial_depth_of_cut,
            "measured": measured, "model": model, "used": used, "reason": reason}


def _multipliers_beside(model: Any, records: Sequence[Any], catalogue: Any, path: object) -> tuple[dict[str, Any], ...]:
    """Per cut with a channel of motion, its measured multipliers and those of a model that was fitted to something else.

    A model whose motion repeats over several tooth passes only (runout) has none of a single one.
    """
    from testbed.analysis.multipliers.identify import beside
    from testbed.analysis.multipliers.recorded_cut import measured_multipliers
    from testbed.api.multipliers import of_cut

    if not any(record.kind == "cut" and motion_channel(record) is not None for record in records):
        return ()
    rows = []
    for test in cut_tests(records, model.cutter.flutes, path):
        measured = measured_multipliers(test.recording, test.cut, model.cutter.flutes, test.channel)
        try:
            found = of_cut(model, test.cut, catalogue, test.name)
            predicted = beside(measured, found["multipliers"]) if found["period_passes"] == 1 else ()
        except InputProblem:
            predicted = ()
        rows.append(_row(test, measured.multipliers, predicted, True, measured.reason))
    return tuple(rows)


def _multipliers_of(model: Any, fitter: Any, fit: Any, catalogue: Any) -> tuple[dict[str, Any], ...]:
    """The same of a machine in x and y: the model's own alone, since one channel holds several modes at once."""
    from testbed.analysis.fit.estimates import speed_factors
    from testbed.api.multipliers import of_cut

    rows, cuts = [], [record for record in fitter.records if record.cut is not None]
    for record, factor in zip(cuts, speed_factors(fitter, fit), strict=True):
        cut = replace(record.cut, spindle_speed=record.cut.spindle_speed * factor)
        try:
            found = of_cut(model, cut, catalogue, record.name)
            values, per = found["multipliers"], "revolution" if found["period_passes"] > 1 else "tooth"
        except InputProblem:
            values, per = (), ""
        rows.append({"name": record.name, "spindle_speed": cut.spindle_speed, "axial_depth_of_cut": cut.axial_depth_of_cut,
                     "measured": (), "model": values, "used": True, "reason": NOT_MEASURED, "per": per})
    return tuple(rows)


def identify_by_waveform(model: Any, records: Sequence[Any], path: object, catalogue: Any, model_file: object,
                         progress: Callable[[str], object] = lambda note: None) -> Identified:
    """Fit the whole waveform of every record with the simulator, the parameters of the model's effects too.

    say: is told, before the fit, what the records' channels do not tell.
    """
    from testbed.analysis.fit.estimates import at_bound, clock_note
    from testbed.analysis.fit.held_guesses import with_guesses_held
    from testbed.analysis.fit.held_out import errors_in_fit, pooled
    from testbed.analysis.fit.model_fit import model_fit
    from testbed.analysis.fit.moves import TOLD
    from testbed.analysis.fit.plausible import remarks_on
    from testbed.analysis.fit.record_hypotheses import taken_notes
    from testbed.analysis.fit.solve import solve
    from testbed.analysis.fit.spindle_speed import at_modelled_speed

    observed, engine = observed_records(records, model, path, model_file), engine_of(catalogue)
    observed = at_modelled_speed(observed, model.effects, catalogue)
    told = told_before(engine, observed, model, catalogue, progress)
    fitter, fit = solve(*model_fit(engine, observed, model, catalogue, told=told), TOLD)  # as testbed compare does
    held = with_guesses_held(fitter, fit, model, catalogue)
    fitter, fit, found = held.fitter, held.fit, held.values
    chi_square = fit.squares / max(1, sum(residual.size for residual in fit.residuals) - len(fit.names))
    noise = pooled(errors_in_fit(fitter, fit))[1]
    rows = _multipliers_of(fit.state.model, fitter, fit, catalogue) if model.planar else \
        _multipliers_beside(fit.state.model, records, catalogue, path)
    quality = {"chi_square": chi_square, "converged": fit.converged, "noise_floor": noise}
    return Identified(held.model, found, rows, quality, at_bound(fitter.free, found),
                      (*taken_notes(observed, fitter.records), *clock_note(fitter, fit), *remarks_on(model, held.model)),
                      tuple(told.notes))


def tests_on_chart(model: Any, data: DataLike) -> list[Any]:
    """The cuts of a data set or campaign with the class that their own multipliers show."""
    from testbed.analysis.linear.chart_plot import ChartTest
    from testbed.analysis.linear.stability import classify
    from testbed.analysis.multipliers.recorded_cut import measured_multipliers

    flutes = model.cutter.flutes
    overlay = []
    for test in cut_tests(load_records(data), flutes, name_of(data)):
        try:
            found = measured_multipliers(test.recording, test.cut, flutes, test.channel)
            outcome = str(classify(found.multipliers)) if found.believed else "undecided"
        except (ValueError, ArithmeticError):
            outcome = "undecided"
        overlay.append(ChartTest(test.cut.spindle_speed, test.cut.axial_depth_of_cut, outcome, test.name))
    return overlay
