"""The methods that `testbed benchmark` asks itself: each is given a campaign's folder and nothing of its truth."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from testbed.benchmark.answers import PARAMETERS, Answer
from testbed.problem import InputProblem

OFF_HARMONICS = 0.5  # share of a cut's power away from the tooth harmonics, beyond which the spectral method says chatter
LOUD = 0.25  # share of a record whose loudest stretch is the cut
DECAY = 0.2  # share of a record, at its end, that is free decay


def naive(folder: Path, cuts: Sequence[str]) -> Answer:
    """The machine is as believed, nothing is missing, nothing chatters."""
    believed = _believed(folder)
    nan = float("nan")
    return Answer({name: (believed.value(name), nan, nan) for name in PARAMETERS}, (), dict.fromkeys(cuts, False))


def spectral(folder: Path, cuts: Sequence[str]) -> Answer:
    """The frequency is the peak of the free decay; chatter, where most of the power lies off the tooth harmonics."""
    import numpy as np

    from testbed.api.records import load_records

    peaks = []
    for record in load_records(folder / "campaign.yaml"):
        values = record.recording.channels["displacement"]
        rest = values[-int(DECAY * len(values)):]
        power = np.abs(np.fft.rfft((rest - rest.mean()) * np.hanning(rest.size), 8 * rest.size))
        line = 8 + int(np.argmax(power[8:]))  # padded eightfold: the lines of the mean are left out
        peaks.append(line * record.recording.sampling_rate / (8 * rest.size))
    middle, nan = float(np.median(peaks)), float("nan")
    answer = naive(folder, cuts)
    return Answer({**answer.parameters, "natural_frequency": (middle, nan, nan)}, (),
                  {cut: _off_harmonics(record) > OFF_HARMONICS for cut, record in _judged(folder, cuts)})


def _off_harmonics(record: Any) -> float:
    """Share of the power of the loudest stretch that lies off the tooth harmonics."""
    import numpy as np

    from testbed.analysis.multipliers.window_features import FEATURES, window_features

    values, given = np.asarray(record.recording.channels["displacement"], float), record.conditions
    length = int(LOUD * values.size)
    squares = np.cumsum((values - values.mean()) ** 2)
    first = int(np.argmax(squares[length:] - squares[:-length]))
    found = window_features(values[first:first + length], record.recording.sampling_rate, given["spindle_speed"],
                            given["axial_depth_of_cut"], given["feed_per_tooth"], 1)
    return 1.0 - float(found[FEATURES.index("share of power at tooth harmonics")])


def own(folder: Path, cuts: Sequence[str]) -> Answer:
    """`testbed diagnose` and `add`; where nothing is named, `identify` by the waveform; `inspect` for chatter."""
    from testbed.analysis.records.record_report import report

    told = {}
    for cut, record in _judged(folder, cuts):
        found = report(record.recording, cut, "cut", ()).chatter
        if found is not None and found.verdict != "unknown":
            told[cut] = found.verdict == "chatter"
    with tempfile.TemporaryDirectory() as name:  # `add` writes a model beside the campaign
        copy = Path(name) / "campaign"
        shutil.copytree(folder, copy)
        parameters, effects = _diagnosed(copy)
    return Answer(parameters, effects, told)


def _diagnosed(folder: Path) -> tuple[dict[str, tuple[float, float, float]], tuple[str, ...] | None]:
    from testbed.api.identification import identify_by_waveform
    from testbed.api.records import load_records
    from testbed.catalogue import catalogue
    from testbed.cli._demo_loop import Sealed, run_loop

    campaign, model_file = folder / "campaign.yaml", folder / "model.yaml"
    try:
        loop = run_loop(Sealed(campaign, model_file, folder, "", 0.0, 0.0))
        if loop.additions:
            found = loop.additions[-1].parameters
        else:
            records = load_records(campaign)
            found = identify_by_waveform(_believed(folder), records, campaign, catalogue(), model_file).parameters
    except InputProblem as problem:
        if "memory" in str(problem):
            raise
        return {}, None
    verdict = loop.diagnosis.verdict
    effects = {"adequate": (), "missing_effect": tuple(sorted(loop.diagnosis.effects))}.get(verdict)  # else it abstains
    return {name: (found[name].value, found[name].low, found[name].high) for name in PARAMETERS if name in found}, effects


def _believed(folder: Path) -> Any:
    from testbed.files.model_file import read_model

    return read_model(folder / "model.yaml")


def _judged(folder: Path, cuts: Sequence[str]) -> list[tuple[str, Any]]:
    from testbed.api.records import load_records

    return list(zip(cuts, load_records(folder / "judge" / "campaign.yaml"), strict=True))


METHODS: dict[str, Callable[[Path, Sequence[str]], Answer]] = {"naive": naive, "spectral": spectral, "testbed": own}
