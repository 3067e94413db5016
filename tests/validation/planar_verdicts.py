"""Machines in x and y: what the multipliers foretell against the motion that the fast engine simulates.

The difference of two runs that begin apart obeys the linear equation without the feed. It grows or dies as the largest
multiplier says; engine and multipliers share no code.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.linear.planar_multipliers import cut_multipliers
from testbed.cut import Cut, Sampling
from testbed.engines import fast
from tests.validation.claims import Claim, Section, below
from tests.validation.planar_charts import model_of, random_machine

MACHINES = 200
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


def one(seed: int) -> tuple[float, float] | None:
    """(modulus per tooth passing, factor simulated) of a random machine away from its border; None where it lies near."""
    random = np.random.default_rng([56, seed])
    machine, typical = random_machine(random, most_modes=4)
    model = model_of(machine)
    cut = Cut(machine.speed, typical * 10 ** random.uniform(-0.5, 0.9), 5e-5)
    try:
        values, _, passes = cut_multipliers(model, cut, 1e-6)
    except ArithmeticError:
        return None
    modulus = abs(values[0]) ** (1.0 / passes)
    if abs(modulus - 1.0) < AWAY or modulus < 0.05:
        return None
    whole = math.log(LARGEST_GROWTH if modulus > 1.0 else 1.0 / SMALLEST) / abs(math.log(modulus))
    turns = max(3, math.ceil(min(whole, MOST_PASSES) / model.cutter.flutes))
    return modulus, growth(model, cut, turns * model.cutter.flutes)


def check() -> Section:
    """So many machines away from the border."""
    found, seed = [], 0
    while len(found) < MACHINES:
        pair = one(seed)
        seed += 1
        if pair is not None:
            found.append(pair)
    wrong = [(a, b) for a, b in found if (a > 1.0) != (b > 1.0)]
    error = np.array([abs(b - a) / a for a, b in found])
    return Section(
        "Machines in x and y: multipliers against the simulated motion",
        (Claim("same verdict", f"{MACHINES} of {MACHINES}", f"{MACHINES - len(wrong)} of {MACHINES}", not wrong,
               f"{sum(a > 1.0 for a, _ in found)} unstable"),
         below("growth a tooth passing, median error", float(np.median(error)), 0.01),
         Claim("the same, 95 of 100 within", "told", f"{np.quantile(error, 0.95):.2g}", None,
               "few passes before a run is given up, and beats of two multipliers of like size")),
        remark=f"1 to 4 modes, 1 to 6 teeth of equal and unequal pitch, helix; moduli within {AWAY:g} of 1 left out.")
