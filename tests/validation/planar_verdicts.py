"""Machines in x and y: what the multipliers foretell against the motion that the fast engine simulates.

The difference of two runs that begin apart obeys the linear equation without the feed. It grows or dies as the largest
multiplier says; engine and multipliers share no code. So does that of a loop with an effect that is linear in the motion; there
both take the force from the effect's file.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.api.multipliers import of_cut
from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling
from testbed.engines import fast
from testbed.machine import Model
from testbed.problem import InputProblem
from tests.validation.claims import Claim, Section, below
from tests.validation.planar_charts import model_of, random_machine

CATALOGUE = catalogue()
MACHINES, WITH_EFFECTS = 200, 100
EFFECTS = ("process_damping", "second_mode", "runout")
AWAY = 0.02  # per tooth passing, from a modulus of 1
LARGEST_GROWTH, SMALLEST = 1e3, 1e-6  # of the difference over the first one: beyond, rounding or the engine's limit ends it
MOST_PASSES = 2000
LOOKED_AT = 12  # stretches of the run over which the growth is fitted, the first third left out
BEGUN = 1e-3  # m/s, of the first mode


def growth(model, cut: Cut, passes: int) -> float:
    """Factor by which the difference of two motions grows from one tooth passing to the next, by least squares."""
    flutes = model.cutter.flutes
    period = cut.tooth_passing_period(flutes)
    fastest = max(mode.natural_frequency for mode in model.structure.modes)
    sampling = Sampling(max(8.0 * fastest, 16.0 / period), math.floor(passes * period * max(8.0 * fastest, 16.0 / period)))
    channels = tuple(f"{place}displacement_{axis}" for place in ("", "tool_") for axis in "xy")
    runs = [fast.simulate(model, Cut(cut.spindle_speed, cut.axial_depth_of_cut, cut.feed_per_tooth, passes=passes,
                                     initial_velocity=begun), sampling, channels=channels) for begun in (0.0, BEGUN)]
    apart = [np.asarray(runs[1].channels[name]) - np.asarray(runs[0].channels[name]) for name in channels]
    size = np.sqrt(sum(one**2 for one in apart))
    size = size[np.isfinite(size)]  # up to where a run that grows is given up
    first = len(size) // 3
    parts = np.array_split(np.arange(first, len(size)), LOOKED_AT)
    level = np.array([np.sqrt(np.mean(size[part] ** 2)) for part in parts])
    middle = np.array([part.mean() for part in parts]) / sampling.rate / period
    return math.exp(np.polyfit(middle, np.log(level), 1)[0])


def with_effect(model: Model, random: np.random.Generator) -> Model:
    """The machine with one of the effects that are linear in the motion."""
    name, lowest = EFFECTS[int(random.integers(len(EFFECTS)))], min(mode.natural_frequency for mode in model.structure.modes)
    values = {"process_damping": {"coefficient": model.cutting.tangential_coefficient * 10 ** random.uniform(-4.0, -3.0)},
              "second_mode": {"mass_ratio": random.uniform(0.1, 0.8), "frequency": lowest * random.uniform(0.6, 2.5),
                              "damping_ratio": 0.02, "direction": random.uniform(-math.pi, math.pi)},
              "runout": {"offset": 1e-5, "direction": 0.3}}[name]
    return model.with_effect(name, **(CATALOGUE[name].neutral() | values))


def one(seed: int, effects: bool = False) -> tuple[float, float] | None:
    """(modulus per tooth passing, factor simulated) of a random machine away from its border; None where it lies near."""
    random = np.random.default_rng([56, seed, effects] if effects else [56, seed])
    machine, typical = random_machine(random, most_modes=4)
    model = with_effect(model_of(machine), random) if effects else model_of(machine)
    cut = Cut(machine.speed, typical * 10 ** random.uniform(-0.5, 0.9), 5e-5)
    try:
        found = of_cut(model, cut, CATALOGUE, "validation")
    except InputProblem:
        return None
    values, passes = found["multipliers"], found["period_passes"]
    modulus = abs(values[0]) ** (1.0 / passes)
    if abs(modulus - 1.0) < AWAY or modulus < 0.05:
        return None
    whole = math.log(LARGEST_GROWTH if modulus > 1.0 else 1.0 / SMALLEST) / abs(math.log(modulus))
    turns = max(3, math.ceil(min(whole, MOST_PASSES) / model.cutter.flutes))
    return modulus, growth(model, cut, turns * model.cutter.flutes)


def away_from_the_border(count: int, effects: bool) -> tuple[list[tuple[float, float]], int]:
    """So many pairs of `one`, and of how many of them the verdicts agree."""
    found: list[tuple[float, float]] = []
    seed = 0
    while len(found) < count:
        pair = one(seed, effects)
        seed += 1
        found += [pair] if pair is not None else []
    return found, sum((a > 1.0) == (b > 1.0) for a, b in found)


def check() -> Section:
    """So many machines away from the border."""
    found, alike = away_from_the_border(MACHINES, False)
    loops, same = away_from_the_border(WITH_EFFECTS, True)
    error, other = (np.array([abs(b - a) / a for a, b in some]) for some in (found, loops))
    return Section(
        "Machines in x and y: multipliers against the simulated motion",
        (Claim("same verdict", f"{MACHINES} of {MACHINES}", f"{alike} of {MACHINES}", alike == MACHINES,
               f"{sum(a > 1.0 for a, _ in found)} unstable"),
         below("growth a tooth passing, median error", float(np.median(error)), 0.01),
         Claim("the same, 95 of 100 within", "told", f"{np.quantile(error, 0.95):.2g}", None,
               "few passes before a run is given up, and beats of two multipliers of like size"),
         Claim(f"with {', '.join(EFFECTS[:-1])} or {EFFECTS[-1]}: same verdict", f"{WITH_EFFECTS} of {WITH_EFFECTS}",
               f"{same} of {WITH_EFFECTS}", same == WITH_EFFECTS, f"{sum(a > 1.0 for a, _ in loops)} unstable"),
         below("the same, growth a tooth passing, median error", float(np.median(other)), 0.01)),
        remark=f"1 to 4 modes, 1 to 6 teeth of equal and unequal pitch, helix; moduli within {AWAY:g} of 1 left out.")
