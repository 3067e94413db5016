"""scenario.yaml: read with units and checked; what is wrong is said with its file, line and field.

    name: five tests
    seed: 1
    model: {file: model.yaml}               # or the whole of a model.yaml, written here
    cut: {feed: 0.1016 mm/tooth, idle: 10 rev, cutting: 60 rev, ring_down: 40 rev}
    tests:                                  # or sweep, sample, refine: see testbed.scenario.design_file
      - {spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm}
    random: {damping_ratio: {uniform: [0.002, 0.01]}}   # what every run draws: see testbed.scenario.draws_file
    sensors:
      sampling_rate: 12800 Hz
      displacement: {noise: 0.5 um, bits: 16, range: 1 mm}
      acceleration: {noise: {white: 0.1 g, pink: 0.05 g, hum: 0.02 g}}   # several channels, each with its own sensor
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import create_model

from testbed.catalogue import catalogue as known_effects
from testbed.effect import Effect
from testbed.files.model_file import model_from, read_model
from testbed.files.yaml_text import (
    SAMPLING_RATE,
    Document,
    Path_,
    Strict,
    above_zero,
    at_least_zero,
    did_you_mean,
    in_unit,
    load,
    validate,
)
from testbed.machine import Carrier, Model
from testbed.noise import NoiseRecipe
from testbed.recording import CHANNEL_UNITS, MOTIONS
from testbed.scenario.axis import axis, check_all
from testbed.scenario.design_file import MAX_RUNS, read_design
from testbed.scenario.draws import KINDS, Distribution
from testbed.scenario.draws_file import distribution, read_random
from testbed.scenario.scenario import Course, Engine, Scenario, whole_passes
from testbed.scenario.variables import Variable, value_at
from testbed.sensors.chain import ChannelSensor, SensorChain
from testbed.units import UnitProblem, parse_quantity

MAX_SAMPLES_A_RUN = 50_000_000
MAX_SAMPLES = 40_000_000_000_000  # 80 TB of 16-bit counts
_RATES = {"m": "m/s", "m/s": "m/s^2"}
SENSED = (*MOTIONS, "force_x", "force_y")


class _Spread(Strict):
    displacement: Annotated[float, in_unit("m", at_least_zero)] = 0.0
    velocity: Annotated[float, in_unit("m/s", at_least_zero)] = 0.0


class _Cut(Strict):
    feed: Annotated[float, in_unit("m/tooth", above_zero)] = 0.1016e-3
    idle: Any = "0 rev"
    cutting: Any = "60 rev"
    ring_down: Any = "0 rev"
    initial_displacement: Annotated[float, in_unit("m")] = 0.0
    initial_velocity: Annotated[float, in_unit("m/s")] = 0.0
    spread: _Spread = _Spread()


class _Channel(Strict):
    noise: Any = None
    bits: int = 0
    range: Any = None
    offset: Any = None
    drift: Any = None
    on: Carrier = "workpiece"


class _Timing(Strict):
    sampling_rate: Annotated[float, SAMPLING_RATE] = 12_800.0
    mark_angle: Annotated[float, in_unit("rad")] = 0.0
    mark_jitter: Annotated[float, in_unit("s", at_least_zero)] = 0.0


_CHANNELS: dict[str, Any] = dict.fromkeys(SENSED, (Any, None))
_Sensors: Any = create_model("_Sensors", __base__=_Timing, **_CHANNELS)


class _Engine(Strict):
    name: Engine = "fast"
    steps: int | None = None


class _ScenarioFile(Strict):
    name: str | None = None
    description: str = ""
    seed: int = 0
    model: Any
    cut: Any = None
    tests: Any = None
    sweep: Any = None
    sample: Any = None
    refine: Any = None
    random: Any = None
    repeats: int = 1
    sensors: Any = None
    engine: Any = None


def read_scenario(path: str | Path, catalogue: Mapping[str, Effect] | None = None) -> Scenario:
    """Read scenario.yaml; `path` may also be the name of one of the shipped scenarios.

    Raises InputProblem with file, line and field where anything in it is wrong.
    """
    from testbed.scenarios import find

    return scenario_from(load(find(path)), catalogue)


def scenario_from(document: Document, catalogue: Mapping[str, Effect] | None = None) -> Scenario:
    """The scenario a document holds."""
    given = validate(document, _ScenarioFile)
    if given.seed < 0:
        raise document.problem(("seed",), f"'{given.seed}' must be at least 0", "correct the value")
    if given.repeats < 1:
        raise document.problem(("repeats",), f"'{given.repeats}' must be at least 1", "correct the value")
    effects = known_effects() if catalogue is None else catalogue
    model = _model(document, effects)
    if model.cutter is None:
        raise document.problem(("model",), "has no cutter and cutting", "a scenario cuts: add both to the model")
    engine = validate(document, _Engine, ("engine",)) if given.engine is not None else _Engine()
    if engine.steps is not None and engine.steps < 1:
        raise document.problem(("engine", "steps"), f"'{engine.steps}' must be at least 1", "correct the value")
    rate, chains, drawn = _sensors(document, given.sensors is not None)
    _something_to_sense(document, model, chains[0])
    course = _course(document, given.cut is not None, model.cutter.flutes)
    model, chances = read_random(document, model, effects)
    scenario = Scenario(
        name=given.name or Path(document.file).stem, model=model,
        tests=read_design(document, model, effects, given.seed, course.feed_per_tooth), course=course, sensors=chains,
        sampling_rate=rate, chances=chances, noise_drawn=drawn,
        repeats=given.repeats, seed=given.seed, engine=engine.name, steps=engine.steps, text=document.text,
        file=document.file)
    _check_size(document, scenario)
    return scenario


def _check_size(document: Document, scenario: Scenario) -> None:
    if len(scenario) > MAX_RUNS:
        raise document.problem((), f"asks for {len(scenario)} runs", f"at most {MAX_RUNS} in one scenario")
    if scenario.longest() > MAX_SAMPLES_A_RUN or scenario.longest() * len(scenario) > MAX_SAMPLES:
        raise document.problem((), f"asks for {len(scenario)} runs of {scenario.longest()} samples",
                               "shorten the cut, lower sampling_rate, or split the scenario")


def _model(document: Document, catalogue: Mapping[str, Effect] | None) -> Any:
    given = document.at(("model",))
    if isinstance(given, dict) and "file" not in given:
        return model_from(document, ("model",), catalogue)
    if isinstance(given, dict) and set(given) != {"file"}:
        other = next(key for key in given if key != "file")
        raise document.problem(("model", other), "stands beside file", "give the file alone, or the model written out")
    name = given["file"] if isinstance(given, dict) else given
    if not isinstance(name, str):
        raise document.problem(("model",), "is not a model", "write `file: model.yaml`, or the model itself")
    path = Path(document.file).parent / name
    if not path.is_file():
        raise document.problem(("model",), f"there is no file '{name}' beside the scenario", "check the path")
    return read_model(path, catalogue)


def _course(document: Document, given: bool, flutes: int) -> Course:
    cut = validate(document, _Cut, ("cut",)) if given else _Cut()
    idle, passes, ring_down = (_passes(document, ("cut", name), getattr(cut, name), flutes)
                               for name in ("idle", "cutting", "ring_down"))
    if idle + passes + ring_down == 0:
        raise document.problem(("cut",), "is over before it begins", "give idle, cutting or ring_down, such as 60 rev")
    return Course(cut.feed, idle, passes, ring_down, cut.initial_displacement, cut.initial_velocity,
                  cut.spread.displacement, cut.spread.velocity)


def _passes(document: Document, path: Path_, value: object, flutes: int) -> int:
    try:
        unit = "passes" if re.search(r"pass(es)?\s*$", str(value)) else "revolutions"
        return whole_passes(parse_quantity(value, unit), unit, flutes)
    except UnitProblem as problem:
        raise document.problem(path, problem.what, "write it as revolutions (60 rev) or tooth passes (60 passes)") \
            from None
    except ValueError as problem:
        raise document.problem(path, f"'{value}' {problem}", "correct the value") from None


def _sensors(document: Document, given: bool) -> tuple[float, tuple[SensorChain, ...], tuple[tuple[str, Distribution], ...]]:
    """Sampling rate (Hz), one chain a noise level, and the channels whose white noise every run draws."""
    sensors = validate(document, _Sensors, ("sensors",)) if given else _Sensors()
    names = [name for name in SENSED if getattr(sensors, name) is not None] or ["displacement"]
    levels = {name: _channel(document, ("sensors", name), CHANNEL_UNITS[name])
              if getattr(sensors, name) is not None else (ChannelSensor(),) for name in names}
    count = max(len(level) for level in levels.values())
    for name, level in levels.items():
        if len(level) not in (1, count):
            raise document.problem(("sensors", name, "noise"), f"has {len(level)} levels, another channel {count}",
                                   "give as many, or one")
    return sensors.sampling_rate, tuple(
        SensorChain({name: level[index % len(level)] for name, level in levels.items()},
                    sensors.mark_angle, sensors.mark_jitter) for index in range(count)), _noise_drawn(document, names)


def _channel(document: Document, path: Path_, si: str) -> tuple[ChannelSensor, ...]:
    """One channel's sensor at each of its noise levels."""
    channel = validate(document, _Channel, path)
    numbers = {}
    for name, unit in (("range", si), ("offset", si), ("drift", _RATES.get(si, f"{si}/s"))):
        value = getattr(channel, name)
        try:
            numbers[name] = 0.0 if value is None else parse_quantity(value, unit)
        except UnitProblem as problem:
            raise document.problem((*path, name), problem.what, problem.do) from None
    if bool(channel.bits) != (channel.range is not None):
        missing = "range" if channel.bits else "bits"
        raise document.problem((*path, missing), "is missing", "a converter needs bits and range, such as 16 and 1 mm")
    if channel.on == "tool" and path[-1] not in MOTIONS:
        raise document.problem((*path, "on"), "forces are those on the workpiece", "remove it")
    try:
        sensor = ChannelSensor(0.0, channel.bits, numbers["range"], numbers["offset"], numbers["drift"], on=channel.on)
    except ValueError as problem:
        raise document.problem(path, str(problem), "correct the value") from None
    place = (*path, "noise")
    if channel.noise is None or _is_distribution(channel.noise):
        return (sensor,)
    if isinstance(channel.noise, dict) and "from" not in channel.noise:
        return (_with_recipe(document, place, sensor, si),)
    if isinstance(channel.noise, list) and any(isinstance(item, dict) for item in channel.noise):
        return tuple(_with_recipe(document, (*place, number), sensor, si) for number in range(len(channel.noise)))
    levels = axis(document, place, channel.noise, si)
    check_all(document, place, levels, at_least_zero)
    return tuple(replace(sensor, noise=level) for level in levels)


def _something_to_sense(document: Document, model: Model, chain: SensorChain) -> None:
    """InputProblem for a sensor of motion on what carries no mode that moves its way."""
    for name, sensor in chain.channels.items():
        if name not in MOTIONS:
            continue
        axis = 1 if name.endswith("_y") else 0
        if not model.effects and all(mode.on != sensor.on or mode.shape[axis] == 0.0 for mode in model.structure.modes):
            where = next((one for one in ("workpiece", "tool") for mode in model.structure.modes
                          if mode.on == one and mode.shape[axis] != 0.0), None)
            do = f"give `{name}: {{on: {where}}}`" if where else f"no mode moves along {'xy'[axis]}: leave the channel out"
            raise document.problem(("sensors", name), f"sits on the {sensor.on}, which stands still along {'xy'[axis]}", do)


def _is_distribution(noise: object) -> bool:
    return isinstance(noise, dict) and bool(set(KINDS) & set(noise))


def _noise_drawn(document: Document, names: list[str]) -> tuple[tuple[str, Distribution], ...]:
    """The channels whose noise is given as a distribution."""
    drawn = []
    for name in names:
        given = (document.data.get("sensors") or {}).get(name)
        if isinstance(given, dict) and _is_distribution(given.get("noise")):
            path = ("sensors", name, "noise")
            variable = Variable("noise", CHANNEL_UNITS[name], at_least_zero)
            drawn.append((name, distribution(document, path, variable, 0.0, float("inf"))))
    return tuple(drawn)


def _with_recipe(document: Document, path: Path_, sensor: ChannelSensor, si: str) -> ChannelSensor:
    """The sensor with a noise recipe: `{white: 0.5 um, pink: 0.2 um, hum: 0.1 um, hum_frequency: 50 Hz}`."""
    units = {"white": si, "pink": si, "wander": si, "hum": si, "hum_frequency": "Hz", "spikes": si, "spike_rate": "Hz",
             "lost": "1"}
    given = document.at(path)
    if not isinstance(given, dict):
        raise document.problem(path, f"'{given}' is not a recipe", f"give a mapping of {', '.join(units)}")
    values = {}
    for name, value in given.items():
        if name not in units:
            raise document.problem((*path, name), "unknown kind of noise", did_you_mean(str(name), [*units, *KINDS]))
        values[name] = value_at(document, (*path, name), Variable(name, units[name], at_least_zero), value)
    for height, other in (("spikes", "spike_rate"), ("spike_rate", "spikes")):
        if height in values and other not in values:
            raise document.problem((*path, other), "is missing", "spikes need their height and their rate")
    white = values.pop("white", 0.0)
    try:
        return replace(sensor, noise=white, recipe=NoiseRecipe(**values) if values else None)
    except ValueError as problem:
        raise document.problem(path, str(problem), "correct the value") from None
