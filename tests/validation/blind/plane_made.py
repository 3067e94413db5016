"""Campaigns of machines in x and y with a hidden truth, drawn by seed and cut.

One to four modes between 120 Hz and 1 kHz, in any direction, on workpiece and tool; displacement, velocity or acceleration
along x and y of every part that moves, at times a dynamometer besides. Cut by MuJoCo on its own grid; under teeth of unequal
pitch by the fast engine with several times the steps, as MuJoCo has none. Hidden is nothing, an effect, two, a law of no
catalogue, or a slip in what is written down of machine and channels (a mode, a direction, who carries a mode, channels
exchanged or turned, the pitch of the teeth, their number).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling, whole_cut_sampling
from testbed.engines import fast, mujoco_engine
from testbed.engines.predict import predict_cuts
from testbed.files.campaign import Record
from testbed.files.manifest import Feed
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from testbed.recording import Recording, motion_channel, quantity_of
from tests.support.planar_campaign import RPM, UNITS
from tests.validation.blind.draw import HELD, LIMIT, SINGLES
from tests.validation.planar_fits import stable_tests

KINDS = {"one": 0.4, "pair": 0.1, "none": 0.15, "unknown": 0.1, "slip": 0.25}
SLIPS = ("mode", "direction", "carrier", "axes", "parts", "sign", "pitch", "flutes")
RATE = 4000.0  # Hz
COURSE = (14, 12, 7)  # revolutions of idling, cutting, ringing down
OFF = {"natural_frequency": 0.02, "damping_ratio": 0.2, "tangential_coefficient": 0.2, "normal_coefficient": 0.2}
ASKEW_RAD = math.radians(6)
WEAKEST, STRONGEST = 0.03, 0.5  # share of the motion that an effect leaves unexplained, log-uniform
NOISIEST, QUIETEST = 0.02, 0.003  # of a channel's own size
FINE = 240  # steps while a tooth is in the cut, of the engine that the fit has: several times as many as it takes there
TRIED = 9  # halvings of a strength
UNLIMITED = 1e9  # times its example that a law of no catalogue may be: those are made for the rig, which is far softer


@dataclass(frozen=True)
class Hidden:
    """A campaign before it is cut; believed: as its user has it, `slip` counted; sensors: (channel, its part)."""

    seed: int
    kind: str
    model: Model
    believed: Model
    tests: tuple[tuple[float, float], ...]
    sensors: tuple[tuple[str, str], ...]
    noise: float
    marked: bool
    effects: Mapping[str, Mapping[str, float]]
    slip: str = ""


def _machine(random: np.random.Generator, modes: int, flutes: int, uneven: bool) -> Model:
    frequencies = random.uniform(120, 250) * np.cumprod([1.0, *random.uniform(1.3, 1.9, modes - 1)])
    found = [Mode(float(10 ** random.uniform(6.3, 7.3) / (2 * math.pi * frequency) ** 2), float(frequency),
                  float(random.uniform(0.006, 0.03)), float(random.uniform(0, math.pi)),
                  "tool" if random.random() < 0.5 else "workpiece") for frequency in frequencies]
    pitches: tuple[float, ...] = ()
    if uneven:
        moved = np.radians(random.uniform(4, 12)) * random.permutation(np.linspace(-1, 1, flutes))
        pitches = tuple(float(angle) for angle in 2 * math.pi / flutes + moved)
    tangential = float(random.uniform(4e8, 15e8))
    cutting = Cutting("up-milling" if random.random() < 0.5 else "down-milling", float(random.uniform(0.08, 0.3)), tangential,
                      float(random.uniform(0.2, 0.6)) * tangential)
    return Model(Structure.of(found), Cutter(flutes, 16e-3, 0.0, pitches), cutting)


def _believed(random: np.random.Generator, model: Model) -> Model:
    values = {}
    for path in model.base_parameters:
        name = path.rpartition(".")[2]
        if name in OFF:
            values[path] = model.value(path) * (1 + OFF[name] * random.uniform(-1, 1))
        elif name == "direction":
            values[path] = model.value(path) + ASKEW_RAD * random.uniform(-1, 1)
    return model.with_values(values)


def _sensors(random: np.random.Generator, model: Model, forces: bool) -> tuple[tuple[str, str], ...]:
    """Two axes on every part that moves; a quantity of its own for each."""
    found = []
    for on in sorted({mode.on for mode in model.structure.modes}):
        quantity = random.choice(["displacement", "velocity", "acceleration"], p=[0.5, 0.2, 0.3])
        found += [(f"{quantity}_{axis}", on) for axis in "xy"]
    return (*found, *((("force_x", "workpiece"), ("force_y", "workpiece")) if forces else ()))


def draw(seed: int, makers: Mapping, kind: str | None = None, names: Sequence[str] | None = None,
         slip: str | None = None) -> Hidden:  # fmt: skip
    """The campaign of a seed; its kind, effects or slip may be laid down."""
    random, known = np.random.default_rng([5757, seed]), catalogue()
    drawn = str(random.choice(list(KINDS), p=list(KINDS.values())))
    kind = kind or ("slip" if slip else "one" if names and len(names) == 1 else "pair" if names else drawn)
    chosen = [str(name) for name in random.choice(SINGLES, 2, replace=False)][: {"one": 1, "pair": 2}.get(kind, 0)]
    if kind == "unknown":
        chosen = [str(random.choice([name for name in makers if name not in known]))]
    chosen = list(names) if names else chosen
    error = slip or (str(random.choice(SLIPS)) if kind == "slip" else "")
    modes = int(random.choice([1, 2, 3, 4], p=[0.35, 0.4, 0.15, 0.1]))
    modes = max(modes, 2) if error in ("mode", "carrier") else modes
    flutes = int(random.integers(2 if "runout" in chosen or error in ("pitch", "flutes") else 1, 5))
    model = _machine(random, modes, flutes, flutes > 1 and (error == "pitch" or not error and random.random() < 0.2))
    tests = tuple((round(rpm), depth) for rpm, depth in stable_tests(model, random))
    sensors = _sensors(random, model, random.random() < 0.15)
    believed = _believed(random, model)
    noise = math.exp(random.uniform(math.log(QUIETEST), math.log(NOISIEST)))
    if error:
        believed, sensors = _slipped(random, error, believed, sensors)
    makers = makers if kind == "unknown" else known  # whose kernels are compiled anyway
    effects = {name: _strength(random, model, makers[name], makers, tests, sensors) for name in chosen}
    for name, values in effects.items():
        model = model.with_effect(name, **values)
    marked = not any(name.startswith("speed_") for name in chosen) and bool(random.random() < 0.8 or error == "pitch")
    return Hidden(seed, kind, model, believed, tests, sensors, noise, marked, effects, error)


def _slipped(random: np.random.Generator, slip: str, model: Model, sensors: tuple[tuple[str, str], ...]
             ) -> tuple[Model, tuple[tuple[str, str], ...]]:  # fmt: skip
    """The believed model without what a slip loses, and the sensors as they are said to sit; see `measured` for the others."""
    modes = list(model.structure.modes)
    place = int(random.integers(len(modes)))
    if slip == "mode":
        del modes[place]
    elif slip == "direction":
        modes[place] = replace(modes[place], direction=modes[place].direction + math.radians(random.uniform(45, 90)))
    elif slip == "carrier":
        modes[place] = replace(modes[place], on="tool" if modes[place].on == "workpiece" else "workpiece")
    elif slip == "flutes":
        other = model.cutter.flutes + (1 if random.random() < 0.5 else -1)
        return replace(model, cutter=replace(model.cutter, flutes=other)), sensors
    elif slip == "pitch":
        return replace(model, cutter=replace(model.cutter, pitch_angles=())), sensors
    return replace(model, structure=Structure.of(modes)), sensors


def said_to_be(truth: Hidden, channel: str, on: str) -> tuple[str, str, float]:
    """(channel, part, sign) as the campaign has a sensor."""
    if channel.startswith("force"):
        return channel, on, 1.0
    if truth.slip == "axes":
        return channel[:-1] + ("y" if channel[-1] == "x" else "x"), on, 1.0
    if truth.slip == "parts":
        return channel, "tool" if on == "workpiece" else "workpiece", 1.0
    return channel, on, -1.0 if truth.slip == "sign" and channel.endswith("y") else 1.0


def _left(model: Model, effect: Any, makers: Mapping, tests: Sequence[tuple[float, float]], names: Sequence[str]) -> Any:
    """values -> share of the channels' own sizes that the effect leaves, when the base parameters have made up for it."""
    flutes = model.cutter.flutes
    cuts = [Cut(rpm * RPM, depth, 0.1e-3, 3 * flutes, 12 * flutes, 6 * flutes) for rpm, depth in tests[:2]]

    def records(one: Model, late: float = 0.0) -> np.ndarray:
        found = []
        for cut in cuts:
            turn = 2 * math.pi / cut.spindle_speed
            sampling = Sampling(RATE, round(18 * turn * RATE), 0.01 + late * turn)
            found.append(predict_cuts([one], [cut], [sampling], names, catalogue=makers)[0])
        whole = np.concatenate([one - one.mean(axis=1, keepdims=True) for one in found], axis=1)
        return whole / size if size is not None else whole

    size = None
    size = np.maximum(records(model).std(axis=1, keepdims=True), 1e-30)
    plain = records(model)
    freed = [path for path in model.base_parameters if path.rpartition(".")[2] in (*OFF, "direction", "mass")][1:]
    slopes = [(records(model.with_values({path: model.value(path) + 1e-4 * max(abs(model.value(path)), 0.1)})) - plain).ravel()
              for path in freed] + [(records(model, 1e-4) - plain).ravel()]
    basis = np.linalg.qr(np.stack([one for one in slopes if np.abs(one).max() > 0], axis=1))[0]

    def left(values: Mapping[str, float]) -> float:
        moved = (records(model.with_effect(effect.name, **values)) - plain).ravel()
        rest = moved - basis @ (basis.T @ moved)
        found = float(np.linalg.norm(rest) / np.linalg.norm(plain))
        return found if math.isfinite(found) else math.inf

    return left


def _strength(random: np.random.Generator, model: Model, effect: Any, makers: Mapping, tests: Sequence[tuple[float, float]],
              sensors: Sequence[tuple[str, str]]) -> dict[str, float]:  # fmt: skip
    """The effect's parameters, its strength such that it leaves a drawn share of the records unexplained."""
    wanted = math.exp(random.uniform(math.log(WEAKEST), math.log(STRONGEST)))
    held = {}
    for one in effect.parameters:
        if not one.vanishes:
            low, high = HELD.get(effect.name, {}).get(one.name, (one.example, one.example))
            held[one.name] = float(random.uniform(-1.5, 1.5) if one.name == "direction" else random.uniform(low, high))
    names = tuple(motion_channel(*one) for one in sensors)
    left = _left(model, effect, makers, tests, names)

    def values(amount: float) -> dict[str, float]:
        return held | {one.name: min(max(one.neutral + amount * (one.example - one.neutral), one.bounds[0]), one.bounds[1])
                       for one in effect.parameters if one.vanishes}

    known = effect.name in catalogue()
    low, high = math.log(1e-4), math.log(LIMIT if known else UNLIMITED)
    for _ in range(TRIED if known else 2 * TRIED):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if left(values(math.exp(middle))) < wanted else (low, middle)
    return values(math.exp(low))


def measured(truth: Hidden, makers: Mapping) -> list[Record]:
    """The records as the user has them. ValueError where a cut ran away."""
    names = [motion_channel(*one) for one in truth.sensors]
    makers = makers if truth.kind == "unknown" else catalogue()
    random, found, flutes = np.random.default_rng([5757, truth.seed, 1]), [], truth.model.cutter.flutes
    sizes: np.ndarray | None = None
    for number, (rpm, depth) in enumerate(truth.tests):
        first = number % flutes
        idle, cut, ring = (flutes * part for part in COURSE)
        speed = rpm * RPM * (1 + 5e-4 * random.uniform(-1, 1))
        stated = Cut(speed, depth, 0.1e-3, idle + first, cut, ring)
        cutter, pitches, rate = truth.model.cutter, truth.model.cutter.pitches, RATE
        turned = (*pitches[first:], *pitches[:first]) if cutter.pitch_angles else ()
        model = replace(truth.model, cutter=replace(cutter, pitch_angles=turned))
        clean = _simulated(model, stated, whole_cut_sampling(stated, flutes, rate), names, makers)
        values = np.array([clean.channels[name] for name in names])
        if not np.isfinite(values).all() or len(values[0]) < 300 or np.abs(values).max() > 1e4:
            raise ValueError("a test ran away")
        sizes = values.std(axis=1) if sizes is None else sizes
        noise = truth.noise * sizes[:, None]
        drift = 3.0 * random.standard_normal((len(names), 1)) + 2.0 * np.sin(0.7 * clean.time + random.uniform(0, 6))
        values = values + noise * (random.standard_normal(values.shape) + drift)
        late = int(random.integers(0, 60))
        ahead = sum(pitches[1 : first + 1]) - first * truth.model.cutter.pitch
        marks = clean.marks - (1.1 + ahead) / speed + random.normal(0, 1e-6)
        marks = marks[np.isfinite(marks) & (marks >= clean.time[late])] if truth.marked else np.empty(0)
        channels, on_tool = {}, []
        for (channel, on), row in zip(truth.sensors, values, strict=True):
            label, part, sign = said_to_be(truth, channel, on)
            label = label if label not in channels else f"{label}_2"
            channels[label] = sign * row[late:]
            on_tool += [label] if part == "tool" else []
        teeth = truth.believed.cutter.flutes if truth.slip == "flutes" else flutes
        conditions = {"spindle_speed": rpm * RPM, "axial_depth_of_cut": depth, "feed_per_tooth": 0.1e-3,
                      "feed_per_revolution": 0.1e-3 * teeth}
        units = {name: UNITS[quantity_of(name)] for name in channels}
        recording = Recording(channels, rate, units, "synthetic", clean.time[late], marks, conditions=conditions,
                              on_tool=tuple(on_tool))
        found.append(Record(f"{number + 1}_{rpm:.0f}rpm", "cut", recording, conditions, (), feed=Feed(0.1e-3, "tooth")))
    return found


def _simulated(model: Model, cut: Cut, sampling: Sampling, names: Sequence[str], makers: Mapping) -> Recording:
    if model.cutter.pitch_angles:
        return fast.simulate(model, cut, sampling, channels=tuple(names), catalogue=makers, steps=FINE)
    return mujoco_engine.simulate(model, cut, sampling, channels=tuple(names), catalogue=makers)
