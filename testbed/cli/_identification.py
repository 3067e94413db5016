"""What identifies a machine from records, by multipliers or by waveform, and what is to be told of each record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from testbed.cli._fitting import observed_records, plant_of
from testbed.cli._records import unfit
from testbed.problem import InputProblem

MOTIONS = ("displacement", "velocity", "acceleration")
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
    from analysis.multipliers.recorded_cut import at_measured_speed
    from analysis.records.segments import find_segments

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


def start_from_ring_downs(model: Any, records: Sequence[Any], tests: Sequence[CutTest]) -> Any:
    """The model with frequency and damping of the free decays after the cuts and of the taps; as it was without any.

    The decay with the smallest interval of damping is taken.
    """
    from analysis.multipliers.ring_down import ring_down

    found = []
    for test in tests:
        for part in test.segments:
            if part.kind == "ring-down":
                found += _decay(ring_down, test.recording, part.start, part.stop, test.channel)
    for record in records:
        channel = motion_channel(record)
        if record.kind == "ring-down" and channel is not None:
            found += _decay(ring_down, record.recording, None, None, channel)
    wide = 0.2 * model.structure.natural_frequency  # a decay of another mode, or a misread one, is no start
    close = [decay for decay in found if abs(decay.natural_frequency[0] - model.structure.natural_frequency) < wide
             and 0 < decay.damping_ratio[0] < 0.5]
    if not close:
        return model
    best = min(close, key=lambda decay: decay.damping_ratio_high[0] - decay.damping_ratio_low[0])
    return model.with_values({"natural_frequency": float(best.natural_frequency[0]),
                              "damping_ratio": float(best.damping_ratio[0])})


def _decay(ring_down: Any, recording: Any, start: float | None, stop: float | None, channel: str) -> list[Any]:
    try:
        return [ring_down(recording, start=start, stop=stop, channel=channel)]
    except (ValueError, ArithmeticError):  # too short or too quiet a decay is no start
        return []


@dataclass(frozen=True)
class Identified:
    """What an identification found: model, parameter path -> value, low, high, unit; the tests; quality.

    at_bound: parameters that ended at an end of the range searched. notes: in words, what was taken otherwise than stated.
    """

    model: Any
    parameters: Mapping[str, Any]
    tests: tuple[Mapping[str, Any], ...]
    quality: Mapping[str, Any]
    at_bound: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def identify_by_multipliers(model: Any, records: Sequence[Any], path: object, seed: int, *,
                            ratio_doubt: float = RATIO_DOUBT) -> Identified:
    """Fit the characteristic multipliers of the cuts. ValueError where they do not suffice."""
    from analysis.multipliers.identify import at_an_end, identify_multipliers
    from analysis.multipliers.recorded_cut import measured_multipliers

    flutes = model.cutter.flutes
    tests = cut_tests(records, flutes, path)
    measured = [measured_multipliers(test.recording, test.cut, flutes, test.channel) for test in tests]
    start = start_from_ring_downs(model, records, tests)
    found = identify_multipliers(start, [test.cut for test in tests], measured, names=[test.name for test in tests], seed=seed,
                                 ratio_doubt=ratio_doubt)
    rows = tuple(_row(test, result.measured, result.model, result.used, result.reason)
                 for test, result in zip(tests, found.tests, strict=True))
    return Identified(found.model, found.parameters, rows,
                      {"chi_square": found.chi_square, "converged": found.converged, "ratio_slope": found.ratio_slope},
                      at_an_end(start, found.model))


def _row(test: CutTest, measured: Any, model: Any, used: bool, reason: str) -> dict[str, Any]:
    return {"name": test.name, "spindle_speed": test.cut.spindle_speed, "axial_depth_of_cut": test.cut.axial_depth_of_cut,
            "measured": measured, "model": model, "used": used, "reason": reason}


def _multipliers_beside(model: Any, records: Sequence[Any], catalogue: Any, path: object) -> tuple[dict[str, Any], ...]:
    """Per cut with a channel of motion, its measured multipliers and those of a model that was fitted to something else.

    A model whose motion repeats over several tooth passes only (runout) has none of a single one.
    """
    from analysis.multipliers.identify import beside
    from analysis.multipliers.recorded_cut import measured_multipliers
    from testbed.cli.multipliers import multipliers

    if not any(record.kind == "cut" and motion_channel(record) is not None for record in records):
        return ()
    rows = []
    for test in cut_tests(records, model.cutter.flutes, path):
        measured = measured_multipliers(test.recording, test.cut, model.cutter.flutes, test.channel)
        try:
            found = multipliers(model, test.cut, catalogue, test.name)
            predicted = beside(measured, found["multipliers"]) if found["period_passes"] == 1 else ()
        except InputProblem:
            predicted = ()
        rows.append(_row(test, measured.multipliers, predicted, True, measured.reason))
    return tuple(rows)


def identify_by_waveform(model: Any, records: Sequence[Any], path: object, catalogue: Any, model_file: object) -> Identified:
    """Fit the whole waveform of every record with the simulator, the parameters of the model's effects too."""
    from analysis.fit.estimates import at_bound
    from analysis.fit.held_guesses import with_guesses_held
    from analysis.fit.held_out import errors_in_fit, pooled
    from analysis.fit.model_fit import model_fit
    from analysis.fit.spindle_speed import at_modelled_speed
    from analysis.fit.taken import taken_notes

    observed = at_modelled_speed(observed_records(records, model, path, model_file), model.effects, catalogue)
    fitter, fit = model_fit(plant_of(catalogue), observed, model, catalogue)
    held = with_guesses_held(fitter, fit, model, catalogue)
    fitter, fit, found = held.fitter, held.fit, held.values
    chi_square = fit.squares / max(1, sum(residual.size for residual in fit.residuals) - len(fit.names))
    noise = pooled(errors_in_fit(fitter, fit))[1]
    rows = _multipliers_beside(fit.state.model, records, catalogue, path)
    quality = {"chi_square": chi_square, "converged": fit.converged, "noise_floor": noise}
    return Identified(held.model, found, rows, quality, at_bound(fitter.free, found),
                      tuple(taken_notes(observed, fitter.records)))
