"""What the commands that fit a model to a campaign share: the records made ready, the engine, and notes on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from testbed.api.believed import DataLike, ModelLike, model_of, name_of
from testbed.api.records import load_records, unfit
from testbed.problem import InputProblem

MOST_NOTES = 12
PREDICTED = ("cut", "ring-down", "excited")


def engine_of(catalogue: Any) -> Any:
    """The fast engine with the effects known to this command, as the analysis is handed it."""
    from testbed.engines import predict

    return SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=catalogue),
                           predict_driven=partial(predict.predict_driven, catalogue=catalogue))


def observed_records(records: Sequence[Any], model: Any, path: object, model_file: object) -> list[Any]:
    """Records made ready for a fit of the model. InputProblem names the record that cannot be predicted, and why."""
    from testbed.analysis.fit.observe import observe

    chosen = [record for record in records if record.kind in PREDICTED]
    if not chosen:
        raise InputProblem(path, "has no record that a model can predict", f"record a {', a '.join(PREDICTED)}")
    if model.cutter is None and any(record.kind == "cut" for record in chosen):
        name = next(record.name for record in chosen if record.kind == "cut")
        raise InputProblem(model_file, f"lacks cutter and cutting, but record '{name}' is a cut", "add both")
    ready = []
    for record in chosen:
        try:
            ready.append(observe(record, model))
        except InputProblem:
            raise
        except (ValueError, ArithmeticError) as problem:
            raise unfit(path, record.name, problem) from None
    return ready


def read_both(campaign: DataLike, model_file: ModelLike, catalogue: Any) -> tuple[Any, list[Any], tuple[Any, ...]]:
    """(model, records ready for a fit, at the speed that the model's effects ask for, records as read) of a campaign and a
    model."""
    from testbed.analysis.fit.spindle_speed import at_modelled_speed

    model, name = model_of(model_file, catalogue)
    records = load_records(campaign)
    observed = observed_records(records, model, name_of(campaign), Path(name))
    return model, at_modelled_speed(observed, model.effects, catalogue), records


def uncalibrated(records: Sequence[Any]) -> list[str]:
    """A line where channels stay in their own unit, so that parameters come out in it."""
    from testbed.recording import CHANNEL_UNITS

    found = {}
    for record in records:
        for name, unit in record.recording.units.items():
            usual = CHANNEL_UNITS.get(name, CHANNEL_UNITS.get(name.split("_")[0]))
            if not name.startswith("tachometer") and usual is not None and unit != usual:
                found[name] = (unit, usual)
    return [f"{name} is uncalibrated, in {unit}. In every parameter below read {unit} for {usual}"
            for name, (unit, usual) in found.items()]


def doubts(records: Sequence[Any], model: Any) -> list[str]:
    """What is doubtful of each record: what reading found, sampling too slow for the model, a speed that the signal of a cut
    without tachometer contradicts."""
    from testbed.analysis.records.record_report import report
    from testbed.analysis.records.ring_downs import notes_of
    from testbed.readers.checks import rate_notes

    found, teeth = [], {} if model.cutter is None else {"flutes": model.cutter.flutes}
    for record in records:
        notes = [note for note in record.notes if "uncalibrated" not in note]
        if record.kind != "cut":  # whose spindle may stand still
            notes = [note for note in notes if not note.startswith("tachometer")]
        notes += notes_of(record.recording, record.kind)
        notes += rate_notes(record.recording.sampling_rate, model.structure.frequency_range[1])
        if record.kind == "cut" and not len(record.recording.marks):
            known = replace(record.recording, conditions={**teeth, **record.recording.conditions})
            seen = report(known, record.name, "cut", ())
            notes += [f"{note}: if the signal is right, correct the campaign, or the number of flutes"
                      for note in seen.notes if "spindle speed" in note]
        found += [f"{record.name}: {note}" for note in dict.fromkeys(notes)]
    more = len(found) - MOST_NOTES
    return found if more <= 0 else [*found[:MOST_NOTES], f"{more} more notes: testbed inspect shows them"]


def of_the_mass(records: Sequence[Any], model: Any) -> list[str]:
    """A line where cuts were measured by their motion alone, which tells forces only relative to the mass."""
    from testbed.recording import DERIVATIVES

    if model.structure.planar:  # see testbed.analysis.fit.identifiable
        return []
    moving = any(record.kind == "cut" and any(name in DERIVATIVES for name in record.recording.channels) for record in records)
    if not moving or any(record.kind == "excited" for record in records):
        return []
    return ["only motion was measured, so coefficients and forces scale with the modal mass, which the model says is "
            f"{model.structure.mass:.4g} kg: 1 % more mass makes them 1 % larger"]


def told_before(engine: Any, records: Sequence[Any], model: Any, catalogue: Any,
                note: Callable[[str], object]) -> Any:
    """What the channels of these records tell of the model's parameters; what they cannot is said before the fit."""
    from testbed.analysis.fit.identifiable import identifiable_parameters

    told = identifiable_parameters(engine, records, model, catalogue)
    for one in told.notes:
        note(one)
    return told


def of_the_range(records: Sequence[Any]) -> list[str]:
    """A line where the motion left the sensor's range: of what was cut off nobody can tell which physics made it."""
    cut_off = [record.name for record in records if any("are clipped" in note for note in record.notes)]
    if not cut_off:
        return []
    many = ", ..." if len(cut_off) > 3 else ""
    return [f"the signal left its range in {', '.join(cut_off[:3])}{many}. No model follows what was cut off, so nothing else "
            "need be missing there. Measure these records again with a wider range, or take them out"]


def of_the_parts(records: Sequence[Any]) -> list[str]:
    """A line for each ring-down of which a fit uses a part only."""
    from testbed.analysis.records.ring_downs import used_note

    return [f"{record.name}: {note}" for record in records for note in used_note(record.recording, record.kind)]


def notes_on(records: Sequence[Any], model: Any) -> list[str]:
    """All that is to be said of records as read before a fit of the model is believed."""
    return [*uncalibrated(records), *doubts(records, model), *of_the_parts(records), *of_the_mass(records, model),
            *of_the_range(records)]


def channel_units(records: Sequence[Any]) -> dict[str, str]:
    """The unit of every channel of the records, SI or its own, by its own name and by the engines'."""
    seen = [recording for record in records for recording in (record.recording, record.recording.in_the_plane())]
    return {name: unit for recording in seen for name, unit in recording.units.items()}
