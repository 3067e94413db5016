"""The end of `testbed demo`: a workshop's campaign with an effect that nobody tells, and what the commands make of it.

The truth is written down and sealed before the first cut; what diagnoses and adds reads the workshop's files alone, and the
truth is opened last.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from testbed.problem import InputProblem

KIND = "sealed truth of a testbed demo"
COURSE = (12, 50, 22)  # revolutions of idling, cutting, ringing down: 1.2 to 1.9 s
CUTS = ((3810, 2.9, 0.1016), (2850, 2.9, 0.08), (4200, 1.5, 0.13), (2600, 1.5, 0.13), (3900, 2.2, 0.08))  # rpm, mm, mm/tooth
RATE, NOISE, COUNT = 6400.0, 1e-6, 1e-3 / 2**15  # Hz; m; m: 16 bits over +-1 mm
# strengths drawn: all clearly beyond the noise in these cuts, which stay stable
HIDDEN: dict[str, dict[str, tuple[float, float]]] = {
    "process_damping": {"coefficient": (4.0e5, 8.0e5)},
    "cubic_stiffness": {"coefficient": (1.0e13, 4.0e13)},
    "edge_force": {"tangential": (1.2e4, 2.5e4), "normal": (1.5e4, 3.0e4)},
    "tool_wear": {"rate": (3.0, 6.0)},
    "chip_force_exponent": {"exponent": (0.65, 0.8)},
    "immersion_error": {"error": (0.1, 0.25)},
}
# the machine as it is, each value drawn within a share of this, and by what share the workshop's belief is off
MACHINE = {"natural_frequency": (146.4, 0.01, 0.02), "damping_ratio": (0.0034, 0.15, 0.3),
           "tangential_coefficient": (5.5e8, 0.06, 0.15), "normal_coefficient": (2.0e8, 0.1, 0.2)}


@dataclass(frozen=True)
class Sealed:
    """The workshop's files, the sealed truth's file and its SHA-256: all that a diagnosis is given, and less than it."""

    campaign: Path
    model: Path
    truth: Path
    digest: str
    longest: float
    shortest: float


def workshop_folder(folder: Path) -> Path:
    """Where the demo's campaign goes, not made yet. InputProblem where somebody else's files stand there."""
    place = folder / "workshop"
    if place.exists() and (not place.is_dir() or (any(place.iterdir()) and not _is_ours(place / "truth.json"))):
        raise InputProblem(place, "exists and is no earlier demo's", "choose another folder with -o")
    return place


def _is_ours(truth: Path) -> bool:
    try:
        return json.loads(truth.read_text(encoding="utf-8"))["kind"] == KIND
    except (OSError, ValueError, KeyError, TypeError):
        return False


def draw(seed: int) -> dict[str, Any]:
    """What the seed hides: effect and its parameters, the machine, what is believed of it, the mark's angle (SI)."""
    import numpy as np

    random = np.random.default_rng([1907, seed])
    name = list(HIDDEN)[int(random.integers(len(HIDDEN)))]
    strength = {one: float(random.uniform(*span)) for one, span in HIDDEN[name].items()}
    machine, believed = {}, {}
    for one, (middle, spread, off) in MACHINE.items():
        machine[one] = middle * (1 + spread * float(random.uniform(-1, 1)))
        believed[one] = machine[one] * (1 + off * float(random.choice([-1, 1]) * random.uniform(0.5, 1)))
    return {"kind": KIND, "seed": seed, "effect": name, "parameters": strength, "machine": machine, "believed": believed,
            "mark_angle": float(random.uniform(0, 2 * math.pi))}


def make(folder: Path, seed: int, show: Callable[[int, int], None] = lambda done, total: None) -> Sealed:
    """Seal a truth drawn by the seed, cut it with MuJoCo, and write the workshop's files. The truth is not handed back."""
    from testbed.cut import Cut
    from testbed.engines.mujoco_engine import simulate
    from testbed.machine import Cutter, Cutting, Model, Structure
    from testbed.system.atomic import write_text
    from testbed.workshop import RPM, Measurement, measured_cut, write_campaign

    place = workshop_folder(folder)
    place.mkdir(exist_ok=True)
    truth = draw(seed)
    text = json.dumps(truth, indent=2) + "\n"
    write_text(place / "truth.json", text)
    bare = Model(Structure(2.573, 146.4, 0.0034), Cutter(), Cutting("up-milling", 0.162, 5.5e8, 2.0e8))
    model = bare.with_values(truth["machine"]).with_effect(truth["effect"], **truth["parameters"])
    how = Measurement(rate=RATE, noise=NOISE, count=COUNT, mark_angle=truth["mark_angle"])
    records, cut_so_far = [], 0.0
    for number, (rpm, depth, feed) in enumerate(CUTS):
        cut = Cut(rpm * RPM, depth * 1e-3, feed * 1e-3, *COURSE, length_cut_before=cut_so_far)
        records.append(measured_cut(simulate, model, cut, how, 1000 * seed + number, f"{rpm} rpm, {depth} mm"))
        cut_so_far += round(COURSE[1] * cut.feed_per_tooth, 9)
        show(number + 1, len(CUTS))
    campaign, model_file = write_campaign(place, records, bare.with_values(truth["believed"]), name="workshop")
    seconds = [len(record.recording) / record.recording.sampling_rate for record in records]
    return Sealed(campaign, model_file, place / "truth.json", sha256(text.encode()).hexdigest(), max(seconds), min(seconds))


@dataclass(frozen=True)
class Loop:
    """The diagnosis of the workshop's files, and the effects added one after the other."""

    diagnosis: Any
    said: Mapping[str, Any]
    additions: Sequence[Any]
    believed: Any
    units: Mapping[str, str]
    written: Path | None

    @property
    def error(self) -> dict[str, float]:
        """Held-out error before the first and after the last addition, and the noise floor."""
        if not self.additions:
            return {"before": self.diagnosis.baseline, "after": self.diagnosis.baseline,
                    "noise_floor": self.diagnosis.noise_floor}
        last = self.additions[-1]
        return {"before": self.additions[0].before, "after": last.after, "noise_floor": last.noise_floor}


def run_loop(sealed: Sealed, say: Callable[[str], None] = lambda text: None) -> Loop:
    """What `testbed diagnose` and `testbed add` do, on the workshop's files. Deterministic.

    Tied effects: the first of them is added. Nothing named: nothing is added.
    """
    from testbed.analysis.search.add_effect import add_effect
    from testbed.analysis.search.diagnose import diagnose
    from testbed.analysis.search.diagnosis import as_json
    from testbed.api.fitting import channel_units, plant_of, read_both
    from testbed.catalogue import catalogue
    from testbed.files.model_file import read_model, write_model

    effects = catalogue()
    model, records, read = read_both(str(sealed.campaign), str(sealed.model), effects)
    plant = plant_of(effects)
    found = diagnose(plant, records, model, effects, say=say)
    added, current, written = [], model, None
    for name in found.effects[:1] if found.verdict == "undecided" else found.effects:
        added.append(add_effect(plant, records, current, effects[name], effects, say))
        written = sealed.campaign.with_name("better.yaml")
        write_model(added[-1].model, written, effects)
        current = read_model(written, effects)
    return Loop(found, as_json(found, model), added, model, channel_units(read), written)


@dataclass(frozen=True)
class Revealed:
    """The truth beside what was found. rows: parameter, SI unit, believed, found, low, high, truth; None where unknown."""

    truth: Mapping[str, Any]
    named_right: bool
    rows: Sequence[Mapping[str, Any]]


def open_truth(sealed: Sealed, loop: Loop) -> Revealed:
    """Open the sealed file, last of all. RuntimeError where it is not what was sealed."""
    from testbed.catalogue import catalogue
    from testbed.machine import BASE_UNITS

    content = sealed.truth.read_bytes()
    if sha256(content).hexdigest() != sealed.digest:
        raise RuntimeError(f"{sealed.truth}: was changed after it was sealed")
    truth = json.loads(content)
    name = truth["effect"]
    true = truth["machine"] | {f"{name}.{one}": value for one, value in truth["parameters"].items()}
    found = loop.additions[-1].parameters if loop.additions else {}
    known = catalogue()
    rows = []
    for path in [*truth["machine"], *(path for path in true if "." in path), *(path for path in found if path not in true)]:
        estimate = found.get(path)
        effect, _, parameter = path.partition(".")
        unit = known[effect].parameter(parameter).unit if parameter else BASE_UNITS[path]
        rows.append({"parameter": path, "unit": unit, "believed": None if parameter else loop.believed.value(path),
                     "value": estimate and estimate.value, "low": estimate and estimate.low,
                     "high": estimate and estimate.high, "truth": true.get(path)})
    return Revealed(truth, loop.diagnosis.verdict == "missing_effect" and loop.diagnosis.effects == (name,), rows)


def add_story(page: Any, loop: Loop) -> None:
    """The error falling, the candidates, effects to tick, and what was left before and after, on the demo's page."""
    from testbed.analysis.fit.held_out import pooled
    from testbed.analysis.report.steps import add_candidates, add_steps
    from testbed.analysis.report.ticked import add_before_after, add_ticks, leading, points_for
    from testbed.analysis.report.waveforms import looks, worst_first
    from testbed.analysis.search.diagnosis import unaided
    from testbed.catalogue import catalogue

    found, error = loop.diagnosis, loop.error
    page.tiles((("error before", f"{error['before']:.4f}"), ("error after", f"{error['after']:.4f}"),
                ("noise floor", f"{error['noise_floor']:.4f}"),
                ("error / noise floor, now", f"{error['after'] / error['noise_floor']:.2f}")))
    steps = [(unaided(loop.believed) if not one.effects else f"+ {one.effects[-1]}", one.error_held_out, pooled(one.errors)[1])
             for one in found.steps]
    add_steps(page, steps, found.held_out)
    add_candidates(page, found, catalogue())
    if not found.best.effects:
        return
    sets: dict[frozenset[str], Any] = {}
    for one in sorted((*found.candidates, *found.steps), key=lambda one: one.error_held_out):
        if one.errors:
            sets.setdefault(frozenset(one.effects), one.errors)
    key = frozenset(found.best.effects)
    shown = worst_first(looks(found.best.fitter.records, loop.units), found.base.errors)
    add_ticks(page, shown, sets, key)
    points = points_for(shown, leading(sets, key))
    add_before_after(page, shown, found.base.errors, sets[key],
                     (found.base.fit.state, found.best.fit.state), points, key)
