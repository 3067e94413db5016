"""The parts of `testbed demo`: each computes one thing and hands it back; nothing is printed here."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

NOISE = "displacement"
SPEED_CELLS, DEPTH_CELLS = 401, 201
PAPER_START = {"natural_frequency": 930.0 / (2.0 * math.pi), "damping_ratio": 0.0064}  # Mann and Young (2006)
BLOW_SECONDS, BLOW_RATE, BLOW_START, BLOW_WIDTH = 6.0, 3200.0, 0.2, 2e-3  # s, Hz, s, s: a soft tip on a soft flexure
BLOW_FORCE, BLOW_FORCE_NOISE, BLOW_NOISE = 200.0, 0.02, 0.02  # N, N, m/s^2
PAPER_GAMMA, NORMAL_SHARE = 5.0e8, 0.3  # tangential coefficient over mass, N m^-2 kg^-1; normal over tangential


@dataclass(frozen=True)
class Observed:
    """A simulated cut, what the linear theory says of it and what its samples show."""

    name: str
    spindle_speed: float
    axial_depth_of_cut: float
    published: str | None
    multiplier: complex
    linear: str
    simulated: str
    reason: str
    samples: Any

    @property
    def agrees(self) -> bool:
        """All verdicts there are say the same; without a published one, stable or not is what counts."""
        if self.published is None:
            return (self.linear == "stable") == (self.simulated == "stable") and self.simulated != "undecided"
        return self.published == self.linear == self.simulated


def data_set(name: str, folder: Path, seed: int | None, show: Callable[[int, int], None]) -> Any:
    """Simulate a shipped scenario into `folder`, in place of an earlier demo's data; returns the sweep's report."""
    from testbed.engines.mujoco_engine import model_xml, simulate
    from testbed.scenario.scenario_file import read_scenario
    from testbed.store.data_set import is_data_set, read_data_set
    from testbed.sweeps import sweep

    scenario = read_scenario(name)
    scenario = scenario if seed is None else replace(scenario, seed=seed)
    target = folder / f"{name}.h5"
    if target.exists() and is_data_set(target) and read_data_set(target).name == name:
        target.unlink()
    first = scenario.run(0)
    return sweep.run(scenario, simulate, target, workers=min(4, os.cpu_count() or 1), resume=True, progress=show,
                     model_xml=model_xml(first.model, first.cut))


def observe(path: Path, names: Sequence[str] = (), published: Sequence[str] = ()) -> list[Observed]:
    """The verdicts on every cut of a data set, from multipliers and from once-per-tooth samples."""
    from testbed.analysis.linear.published import PublishedTest, linear_multipliers
    from testbed.analysis.linear.stability import classify
    from testbed.analysis.multipliers.verdict import once_per_tooth_samples, simulated_verdict
    from testbed.store.data_set import read_data_set

    data = read_data_set(path)
    model = data.true_model()
    found = []
    for place, recording in enumerate(data):
        known = recording.conditions
        point = (known["spindle_speed"], known["axial_depth_of_cut"])
        multipliers = linear_multipliers(model, PublishedTest("", *point, "stable"))
        samples = once_per_tooth_samples(recording, data.flutes)
        verdict = simulated_verdict(samples, float(data.noise[NOISE][place]))
        reason = verdict.reason if recording.outcome == "ok" else recording.outcome
        found.append(Observed(names[place] if names else "", *point, published[place] if published else None,
                              complex(multipliers[0]), str(classify(multipliers)), verdict.outcome, reason, samples))
    return found


@dataclass(frozen=True)
class Scored:
    """The first campaign's identification, and the scores over all."""

    first: Any
    scores: list[Any]


def identified(path: Path, show: Callable[[int, int], None]) -> Scored:
    """The paper's identification of each repeat of a data set's three tests, from the paper's starting guess."""
    from testbed.analysis.multipliers.score import score
    from testbed.api.identification import identify_by_multipliers
    from testbed.api.records import records_of
    from testbed.store.data_set import read_data_set

    data = read_data_set(path)
    truth = data.true_model()
    start = truth.with_values(PAPER_START | {
        "tangential_coefficient": PAPER_GAMMA * truth.structure.mass,
        "normal_coefficient": NORMAL_SHARE * PAPER_GAMMA * truth.structure.mass})
    points: dict[tuple[float, float], list[Any]] = {}
    for record in records_of(data):
        known = record.recording.conditions
        points.setdefault((known["spindle_speed"], known["axial_depth_of_cut"]), []).append(record)
    campaigns = list(zip(*points.values(), strict=False))
    found: list[Any] = []

    def method(records: Sequence[Any]) -> Any:
        found.append(identify_by_multipliers(start, records, path, 0))
        show(len(found), len(campaigns))
        return found[-1].parameters

    level = float(data.noise[NOISE][0])
    scores = score(method, truth, lambda noise, number: campaigns[number], [level], range(len(campaigns)))
    if not found:
        raise RuntimeError(f"no identification succeeded: {'; '.join(scores[0].reasons)}")
    return Scored(found[0], scores)


def chart(path: Path, spindle_speeds: tuple[float, float], deepest: float) -> Any:
    """The stability chart, borders refined, of the machine that a data set was cut on; speeds rad/s, depth m."""
    from functools import partial

    import numpy as np

    from testbed.analysis.linear.chart_border import refined
    from testbed.analysis.linear.stability import stability_chart
    from testbed.store.data_set import read_data_set

    fill = partial(stability_chart, read_data_set(path).true_model())
    depths = np.linspace(deepest / DEPTH_CELLS, deepest, DEPTH_CELLS)
    return refined(fill(np.linspace(*spindle_speeds, SPEED_CELLS), depths), fill)


def tap_test_folder() -> Path | None:
    """Where the measured hammer test stands: in $TESTBED_MEASUREMENTS, or beside the project; None if nowhere."""
    beside = Path(__file__).resolve().parents[3] / "shared" / "measurements"
    folder = Path(os.environ.get("TESTBED_MEASUREMENTS", beside)) / "tap_test"
    files = ("impact_Point1_time.txt", "FRF_Point_1.txt")
    return folder if all((folder / file).is_file() for file in files) else None


def hammer_test(folder: Path) -> dict[str, dict[str, Any]]:
    """First mode of the measured tool, from the blow itself and from the receptance its owners computed."""
    import numpy as np

    from testbed.analysis.multipliers.ring_down import fit_receptance, receptance

    time, force, acceleration = np.loadtxt(folder / "impact_Point1_time.txt").T
    frequency, real, imaginary = np.loadtxt(folder / "FRF_Point_1.txt").T[:, 1:]  # the line at 0 Hz is drift
    modes = {"time record": fit_receptance(*receptance(force, acceleration, 1.0 / float(np.mean(np.diff(time))))),
             "receptance file": fit_receptance(frequency, real + 1j * imaginary)}
    return {name: {"natural_frequency": mode.natural_frequency, "damping_ratio": mode.damping_ratio,
                   "modal_mass": mode.modal_mass, "misfit": mode.misfit} for name, mode in modes.items()}


def struck_rig(path: Path) -> dict[str, dict[str, Any]]:
    """First mode of the machine that a data set was cut on, struck in simulation; and as it is, which has no misfit."""
    import numpy as np

    from testbed.analysis.multipliers.ring_down import fit_receptance, receptance
    from testbed.engines.predict import predict_driven
    from testbed.store.data_set import read_data_set

    mode = read_data_set(path).true_model().structure.modes[0]
    model = replace(read_data_set(path).true_model(), effects={})
    time = np.arange(round(BLOW_SECONDS * BLOW_RATE)) / BLOW_RATE
    blow = np.where((time > BLOW_START) & (time < BLOW_START + BLOW_WIDTH),
                    BLOW_FORCE * np.sin(np.pi * (time - BLOW_START) / BLOW_WIDTH) ** 2, 0.0)
    answer = predict_driven([model], [(0.0, 0.0)], blow, BLOW_RATE, ("acceleration",))[0, 0]
    random = np.random.default_rng(0)
    force, acceleration = (values + noise * random.standard_normal(time.size)
                           for values, noise in ((blow, BLOW_FORCE_NOISE), (answer, BLOW_NOISE)))
    found = fit_receptance(*receptance(force, acceleration, BLOW_RATE))
    return {name: {"natural_frequency": one.natural_frequency, "damping_ratio": one.damping_ratio, "modal_mass": mass,
                   "misfit": misfit}
            for name, one, mass, misfit in (("simulated blow", found, found.modal_mass, found.misfit),
                                            ("truth", mode, mode.mass, None))}


def draw_rig(path: Path) -> str | None:
    """Render the rig into a PNG file; returns why it could not be drawn, or None."""
    from testbed.view import render_rig

    try:
        render_rig(path, width=1200, height=900)
    except RuntimeError as problem:
        return str(problem)
    return None
