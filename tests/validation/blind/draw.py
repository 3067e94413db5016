"""What a blind campaign hides: machine, belief, tests, noise and effects, all drawn from one seed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.temporal_elements import characteristic_multipliers
from testbed.cut import Cut, Sampling
from testbed.effect import Effect
from testbed.engines.predict import predict_cuts
from testbed.machine import Cutter, Cutting, Model, Structure

RPM = 2 * math.pi / 60
RATE = 6400.0  # Hz, of the records by which a strength is weighed
KINDS = {"one": 0.55, "pair": 0.15, "none": 0.15, "unknown": 0.15}
STABLE = 0.93  # largest multiplier of a drawn test: transients die away within the record
# what an effect leaves unexplained, as a share of the records' rms: from barely visible to large, log-uniform
WEAKEST, STRONGEST = 0.008, 0.5
RISE = (0.003, 0.03)  # of a faint effect: by how much it lifts the error above the noise, log-uniform
FAINT_KINDS = {"one": 0.75, "none": 0.25}
LIMIT = 3.0  # times the effect's example: no drawn strength is larger
STUCK = 0.4  # share of its motion below which an effect has all but stopped the machine: nobody measures that
SEEN = 3  # tests by which a strength is weighed
SINGLES = ("process_damping", "cubic_stiffness", "dry_friction", "quadratic_damping", "second_mode", "chip_force_exponent",
           "edge_force", "helix", "runout", "tool_wear", "speed_droop", "speed_variation", "entry_ramp", "immersion_error",
           "sensor_lag", "ambient_vibration")
HELD = {"second_mode": {"frequency": (300.0, 1200.0), "damping_ratio": (0.005, 0.03), "participation": (1.0, 1.0)},
        "ambient_vibration": {"frequency": (20.0, 400.0), "phase": (-math.pi, math.pi)},
        "runout": {"angle": (-math.pi, math.pi)},
        "speed_variation": {"frequency": (1.0, 8.0), "phase": (-math.pi, math.pi)},
        "speed_droop": {"time_constant": (0.1, 0.4)}}
RIG = 146.4  # Hz, natural frequency of the published flexure: ranges of HELD are scaled by a machine's own over it
FASTEST = 3800.0  # Hz, of a second mode


@dataclass(frozen=True)
class Setting:
    """How a campaign is measured: largest relative error of the stated speeds, amplitude (m) of a vibration from before at a
    record's start, mark angle (rad), revolutions of idling, cutting and ringing down, sampling rate (Hz)."""

    speed_error: float = 5e-4
    ringing: float = 0.0
    mark_angle: float = 1.1
    course: tuple[int, int, int] = (15, 70, 30)
    rate: float = 12800.0


@dataclass(frozen=True)
class Truth:
    """A blind campaign before it is cut. tests: (rpm, mm, feed m a tooth); noise m; effects by name with parameters."""

    seed: int
    kind: str
    model: Model
    believed: Model
    tests: tuple[tuple[float, float, float], ...]
    noise: float
    tachometer: bool
    effects: Mapping[str, Mapping[str, float]]
    law: str | None = None  # of an effect that no catalogue holds
    setting: Setting = Setting()


def _machine(random: np.random.Generator, flutes: int) -> Model:
    def near(value: float, share: float) -> float:
        return value * math.exp(random.uniform(-share, share))

    structure = Structure(near(2.573, 0.2), near(146.4, 0.1), near(0.0035, 0.4))
    return Model(structure, Cutter(flutes=flutes),
                 Cutting("up-milling", 0.162, near(5.5e8, 0.15) / flutes, near(2.0e8, 0.25) / flutes))


def _any_machine(random: np.random.Generator, flutes: int) -> Model:
    """A machine of any workshop: 80 to 700 Hz, 1 to 5 N/um, up- or down-milling, 6 to 35 % of a turn in the cut."""

    def between(low: float, high: float) -> float:
        return math.exp(random.uniform(math.log(low), math.log(high)))

    frequency, stiffness = between(80.0, 700.0), between(1e6, 5e6)
    structure = Structure(stiffness / (2 * math.pi * frequency) ** 2, frequency, between(0.003, 0.02))
    tangential = between(4e8, 9e8)
    return Model(structure, Cutter(flutes=flutes, diameter=random.uniform(8e-3, 25e-3)),
                 Cutting(str(random.choice(["up-milling", "down-milling"])), between(0.06, 0.35), tangential,
                         tangential * random.uniform(0.2, 0.5)))


def _any_setting(random: np.random.Generator, model: Model) -> Setting:
    """Speeds stated up to 1 % wrong; in half of the campaigns the structure still rings when a record begins."""
    ringing = math.exp(random.uniform(math.log(2e-6), math.log(5e-5))) if random.uniform() < 0.5 else 0.0
    course = tuple(max(least, count // model.cutter.flutes) for least, count in ((6, 20), (20, 90), (8, 40)))
    rate = float(round(min(max(30.0 * model.structure.natural_frequency, 4000.0), 12800.0), -2))
    return Setting(random.uniform(0.0, 0.01), ringing, random.uniform(0.0, 2 * math.pi), course, rate)


def _any_tests(random: np.random.Generator, model: Model, count: int) -> tuple[tuple[float, float, float], ...]:
    """Stable tests from just above the first lobe to five vibrations a tooth; as deep as such a machine bears."""
    structure, cutting, flutes = model.structure, model.cutting, model.cutter.flutes
    bears = structure.stiffness / 2.2e6 * 5.5e8 / cutting.tangential_coefficient * 0.162 / cutting.immersion / flutes
    found: list[tuple[float, float, float]] = []
    while len(found) < count:
        passing = structure.natural_frequency / math.exp(random.uniform(math.log(0.8), math.log(5.0)))
        rpm, depth = 60 * passing / flutes, bears * math.exp(random.uniform(math.log(0.5), math.log(8.0)))
        cut = Cut(rpm * RPM, depth * 1e-3)
        if np.abs(characteristic_multipliers(milling_equation(model, cut), 10)).max() < STABLE:
            found.append((round(rpm), round(depth, 3), round(random.uniform(0.05, 0.15), 3) * 1e-3))
    return tuple(found)


def _belief(random: np.random.Generator, model: Model) -> Model:
    """The machine as its user believes it: every value that an identification frees is off by up to a fifth."""
    off = {"natural_frequency": 0.05, "damping_ratio": 0.2, "tangential_coefficient": 0.2, "normal_coefficient": 0.2}
    return model.with_values({name: model.value(name) * (1 + random.uniform(-share, share)) for name, share in off.items()})


def _tests(random: np.random.Generator, model: Model, count: int) -> tuple[tuple[float, float, float], ...]:
    found: list[tuple[float, float, float]] = []
    flutes = model.cutter.flutes
    while len(found) < count:
        rpm, depth = random.uniform(2400, 4500) / flutes, random.uniform(0.5, 3.0)
        cut = Cut(rpm * RPM, depth * 1e-3)
        if np.abs(characteristic_multipliers(milling_equation(model, cut), 10)).max() < STABLE:
            found.append((round(rpm), round(depth, 2), round(random.choice([0.08, 0.1016, 0.13]), 4) * 1e-3))
    return tuple(found)


def _left_unexplained(model: Model, effect: Effect, makers: Mapping[str, Effect], tests: Sequence[tuple],
                      anywhere: bool) -> tuple[Callable, float]:  # fmt: skip
    """(the share of the records' rms that the effect at given values leaves when the base parameters have made up for it; that
    rms, m).

    anywhere: the share is infinite, too, where the machine is all but stopped.
    """
    cuts = [Cut(rpm * RPM, depth * 1e-3, feed, 3 * model.cutter.flutes, 60 * model.cutter.flutes, 25 * model.cutter.flutes)
            for rpm, depth, feed in tests[:SEEN]]
    flutes = model.cutter.flutes

    def records(one: Model, late: float = 0.0) -> np.ndarray:
        found = []
        for cut in cuts:
            count = round(80 * 2 * math.pi / cut.spindle_speed * RATE)
            sampling = Sampling(RATE, count, 0.01 + late * 2 * math.pi / cut.spindle_speed / flutes)
            values = predict_cuts([one], [cut], [sampling], ("displacement",), catalogue=makers)[0, 0]
            found.append(values - values.mean())
        return np.concatenate(found)

    plain = records(model)
    freed = ("natural_frequency", "damping_ratio", "tangential_coefficient", "normal_coefficient")
    slopes = [records(model.with_values({name: model.value(name) * (1 + 1e-4)})) - plain for name in freed]
    basis = np.linalg.qr(np.stack([*slopes, records(model, 1e-4) - plain], axis=1))[0]

    def left(values: Mapping[str, float]) -> float:
        there = records(model.with_effect(effect.name, **values))
        if anywhere and np.linalg.norm(there) < STUCK * np.linalg.norm(plain):
            return math.inf
        moved = there - plain
        rest = moved - basis @ (basis.T @ moved)
        share = float(np.linalg.norm(rest) / np.linalg.norm(plain))
        return share if math.isfinite(share) else math.inf

    return left, float(np.sqrt(np.mean(plain**2)))


def _strength(random: np.random.Generator, model: Model, effect: Effect, makers: Mapping[str, Effect],
              tests: Sequence[tuple], anywhere: bool = False, noise: float = 0.0) -> dict[str, float]:
    """The effect's parameters; its strength such that it leaves a drawn share of the records unexplained.

    noise: where it is not 0, such that the error rises above that noise (m) by a drawn share, `RISE`.
    """
    wanted = math.exp(random.uniform(*map(math.log, RISE if noise else (WEAKEST, STRONGEST))))
    held = {}
    for parameter in effect.parameters:
        if not parameter.vanishes and parameter.name != "direction":  # along the feed, and as it was drawn before there was one
            low, high = HELD.get(effect.name, {}).get(parameter.name, (parameter.example, parameter.example))
            if anywhere and (effect.name, parameter.name) == ("second_mode", "frequency"):
                scale = model.structure.natural_frequency / RIG
                low, high = low * scale, min(high * scale, FASTEST)
            held[parameter.name] = float(random.uniform(low, high))
    left, size = _left_unexplained(model, effect, makers, tests, anywhere)
    if noise:
        wanted = noise / size * math.sqrt((1.0 + wanted) ** 2 - 1.0)

    def values(share: float) -> dict[str, float]:
        strengths = {one.name: min(max(one.neutral + share * (one.example - one.neutral), one.bounds[0]), one.bounds[1])
                     for one in effect.parameters if one.vanishes}
        return held | strengths

    low, high = math.log(1e-4), math.log(LIMIT)
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if left(values(math.exp(middle))) < wanted else (low, middle)
    return values(math.exp(low))


def draw(seed: int, catalogue: Mapping, laws: Mapping[str, str] | None = None, kind: str | None = None,
         names: tuple[str, ...] | None = None, anywhere: bool = False, faint: bool = False) -> Truth:
    """The truth of one seed; `kind` or the effects' `names` may be laid down.

    anywhere: on a machine of any workshop, measured as it comes; else on the published rig. faint: an effect, if any, that is
    hardly visible above the noise.
    """
    random = np.random.default_rng([2026, seed])
    kinds = FAINT_KINDS if faint else KINDS
    drawn = str(random.choice(list(kinds), p=list(kinds.values())))
    kind = kind or ("one" if names and len(names) == 1 else "pair" if names else drawn)
    count = {"one": 1, "pair": 2, "none": 0, "unknown": 1}[kind]
    chosen = tuple(str(name) for name in random.choice(SINGLES, size=2, replace=False))[:count] if names is None else names
    law = str(random.choice(list(laws))) if kind == "unknown" and laws else None
    if law:
        chosen = (law,)
    flutes = 2 if "runout" in chosen or random.uniform() < 0.1 else 1
    if anywhere:
        flutes = int(random.integers(2 if "runout" in chosen else 1, 5))
    model = _any_machine(random, flutes) if anywhere else _machine(random, flutes)
    setting = _any_setting(random, model) if anywhere else Setting()
    believed = _belief(random, model)
    tests = (_any_tests if anywhere else _tests)(random, model, int(random.integers(4 if anywhere else 6, 9)))
    before = math.exp(np.random.default_rng([2026, seed, 1]).uniform(math.log(0.3e-6), math.log(5e-6))) if faint else 0.0
    effects = {name: _strength(random, model, catalogue[name], catalogue, tests, anywhere, before) for name in chosen}
    noise = before or math.exp(random.uniform(math.log(0.3e-6), math.log(5e-6)))
    true = model
    for name, values in effects.items():
        true = true.with_effect(name, **values)
    measured = any(name.startswith("speed_") for name in effects)  # a tachometer would show the speed, and hide nothing
    marked = bool(random.uniform() < (0.7 if anywhere else 0.9)) and not measured
    return Truth(seed, kind, true, believed, tests, noise, marked, effects, law, setting)
