"""What a blind campaign hides: machine, belief, tests, noise and effects, all drawn from one seed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.linear.delay_equation import milling_equation
from analysis.linear.temporal_elements import characteristic_multipliers
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
LIMIT = 3.0  # times the effect's example: no drawn strength is larger
SEEN = 3  # tests by which a strength is weighed
SINGLES = ("process_damping", "cubic_stiffness", "dry_friction", "quadratic_damping", "second_mode", "chip_force_exponent",
           "edge_force", "helix", "runout", "tool_wear", "speed_droop", "speed_variation", "entry_ramp", "immersion_error",
           "sensor_lag", "ambient_vibration")
HELD = {"second_mode": {"frequency": (300.0, 1200.0), "damping_ratio": (0.005, 0.03), "participation": (1.0, 1.0)},
        "ambient_vibration": {"frequency": (20.0, 400.0), "phase": (-math.pi, math.pi)},
        "runout": {"angle": (-math.pi, math.pi)},
        "speed_variation": {"frequency": (1.0, 8.0), "phase": (-math.pi, math.pi)},
        "speed_droop": {"time_constant": (0.1, 0.4)}}


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


def _machine(random: np.random.Generator, flutes: int) -> Model:
    def near(value: float, share: float) -> float:
        return value * math.exp(random.uniform(-share, share))

    structure = Structure(near(2.573, 0.2), near(146.4, 0.1), near(0.0035, 0.4))
    return Model(structure, Cutter(flutes=flutes),
                 Cutting("up-milling", 0.162, near(5.5e8, 0.15) / flutes, near(2.0e8, 0.25) / flutes))


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


def _left_unexplained(model: Model, effect: Effect, makers: Mapping[str, Effect], tests: Sequence[tuple]) -> Callable:
    """The share of the records' rms that the effect at given values leaves when the base parameters have made up for it."""
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
        moved = records(model.with_effect(effect.name, **values)) - plain
        rest = moved - basis @ (basis.T @ moved)
        share = float(np.linalg.norm(rest) / np.linalg.norm(plain))
        return share if math.isfinite(share) else math.inf

    return left


def _strength(random: np.random.Generator, model: Model, effect: Effect, makers: Mapping[str, Effect],
              tests: Sequence[tuple]) -> dict[str, float]:
    """The effect's parameters; its strength such that it leaves a drawn share of the records unexplained."""
    wanted = math.exp(random.uniform(math.log(WEAKEST), math.log(STRONGEST)))
    held = {}
    for parameter in effect.parameters:
        if not parameter.vanishes:
            low, high = HELD.get(effect.name, {}).get(parameter.name, (parameter.example, parameter.example))
            held[parameter.name] = float(random.uniform(low, high))
    left = _left_unexplained(model, effect, makers, tests)

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
         names: tuple[str, ...] | None = None) -> Truth:
    """The truth of one seed; `kind` or the effects' `names` may be laid down."""
    random = np.random.default_rng([2026, seed])
    drawn = str(random.choice(list(KINDS), p=list(KINDS.values())))
    kind = kind or ("one" if names and len(names) == 1 else "pair" if names else drawn)
    count = {"one": 1, "pair": 2, "none": 0, "unknown": 1}[kind]
    chosen = tuple(str(name) for name in random.choice(SINGLES, size=2, replace=False))[:count] if names is None else names
    law = str(random.choice(list(laws))) if kind == "unknown" and laws else None
    if law:
        chosen = (law,)
    flutes = 2 if "runout" in chosen or random.uniform() < 0.1 else 1
    model = _machine(random, flutes)
    believed = _belief(random, model)
    tests = _tests(random, model, int(random.integers(6, 9)))
    effects = {name: _strength(random, model, catalogue[name], catalogue, tests) for name in chosen}
    noise = math.exp(random.uniform(math.log(0.3e-6), math.log(5e-6)))
    true = model
    for name, values in effects.items():
        true = true.with_effect(name, **values)
    measured = any(name.startswith("speed_") for name in effects)  # a tachometer would show the speed, and hide nothing
    return Truth(seed, kind, true, believed, tests, noise, bool(random.uniform() < 0.9) and not measured, effects, law)
