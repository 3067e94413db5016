"""What a blind campaign hides: machine, belief, tests, noise and effects, all drawn from one seed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from analysis.delay_equation import milling_equation
from analysis.temporal_elements import characteristic_multipliers
from testbed.cut import Cut
from testbed.machine import Cutter, Cutting, Model, Structure

RPM = 2 * math.pi / 60
KINDS = {"one": 0.55, "pair": 0.15, "none": 0.15, "unknown": 0.15}
STABLE = 0.93  # largest multiplier of a drawn test: transients die away within the record
# what an effect's strength is multiplied by: from barely visible to large, log-uniform over these shares of its example
WEAKEST, STRONGEST = 0.05, 1.0
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


def _strength(random: np.random.Generator, name: str, effect) -> dict[str, float]:
    share = math.exp(random.uniform(math.log(WEAKEST), math.log(STRONGEST)))
    values = {}
    for parameter in effect.parameters:
        if parameter.vanishes:
            values[parameter.name] = parameter.neutral + share * (parameter.example - parameter.neutral)
        else:
            low, high = HELD.get(name, {}).get(parameter.name, (parameter.example, parameter.example))
            values[parameter.name] = float(random.uniform(low, high))
    return values


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
    effects = {name: _strength(random, name, catalogue[name]) for name in chosen}
    noise = math.exp(random.uniform(math.log(0.3e-6), math.log(5e-6)))
    true = model
    for name, values in effects.items():
        true = true.with_effect(name, **values)
    measured = any(name.startswith("speed_") for name in effects)  # a tachometer would show the speed, and hide nothing
    return Truth(seed, kind, true, believed, tests, noise, bool(random.uniform() < 0.9) and not measured, effects, law)
