"""Charts of machines with modes in x and y and teeth of any pitch against collocation that shares no code (second_road.py)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from testbed.analysis.linear.stability import sharpened_limit, stability_chart
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from tests.support.second_road import Planar, planar_multipliers
from tests.validation.charts import compared, section
from tests.validation.claims import Section

MACHINES, DEPTHS = 200, 10
LOOKED_AT = 2  # depths of each machine at which the largest multipliers are compared


def model_of(machine: Planar) -> Model:
    """The machine in the project's words; every other mode is the tool's."""
    entry, leave = machine.angles
    modes = [Mode(*mode, on="tool" if place % 2 else "workpiece") for place, mode in enumerate(machine.modes)]
    return Model(Structure.of(modes), Cutter(len(machine.pitches), machine.diameter, machine.helix, machine.pitches),
                 Cutting("up-milling" if machine.up else "down-milling", min((leave - entry) / (2 * math.pi), 0.5),
                         machine.tangential, machine.normal))


def random_machine(random: np.random.Generator, most_modes: int = 8, most_swings: float = 25.0) -> tuple[Planar, float]:
    """A machine of 1 to 8 modes and 1 to 6 flutes, with up to so many swings of its fastest mode a revolution; and a depth near
    its limit, m."""
    teeth, count = int(random.integers(1, 7)), int(random.integers(1, most_modes + 1))
    radial, helix = 10 ** random.uniform(-1.5, 0.0), float(random.choice([0.0, random.uniform(0.1, 0.8)]))
    pitches = np.full(teeth, 2 * math.pi / teeth)
    if teeth > 1 and random.integers(2):
        pitches *= 1 + random.uniform(-0.15, 0.15, teeth)
        pitches *= 2 * math.pi / pitches.sum()
    lowest, stiffness = 10 ** random.uniform(2.0, 3.2), 10 ** random.uniform(6.0, 7.5)
    axes = [0.0, 0.5 * math.pi] if random.integers(2) else list(random.uniform(-math.pi, math.pi, count))
    modes = []
    for place in range(count):
        frequency = lowest * 10 ** random.uniform(0.0, 0.7)
        modes.append((stiffness * 10 ** random.uniform(-0.3, 0.5) / (2 * math.pi * frequency) ** 2, frequency,
                      10 ** random.uniform(-2.3, -1.1), float(axes[place % len(axes)])))
    tangential = 10 ** random.uniform(8.7, 9.3)
    machine = Planar(tuple(modes), tuple(float(pitch) for pitch in pitches), helix, 16e-3, bool(random.integers(2)), radial,
                     tangential, tangential * random.uniform(0.1, 0.6), 1.0)
    fastest = max(mode[1] for mode in modes)
    machine = replace(machine, speed=2 * math.pi * fastest / 10 ** random.uniform(0.2, math.log10(most_swings)))
    entry, leave = machine.angles
    soft = min(2 * mass * damping * (2 * math.pi * frequency) ** 2 for mass, frequency, damping, _ in modes)
    mean = max(teeth * (leave - entry) / (2 * math.pi), 0.05) * 0.5 * tangential
    return machine, soft / mean * 10 ** random.uniform(-0.3, 0.6)


def one(seed: int) -> dict[str, float]:
    """`compared` of one machine, by the modulus per tooth passing."""
    random = np.random.default_rng([55, seed])
    machine, typical = random_machine(random)
    model, teeth = model_of(machine), len(machine.pitches)
    chart = stability_chart(model, np.array([machine.speed]), typical * np.linspace(0.15, 2.5, DEPTHS))

    def largest(depth: float, finer: float = 1.0) -> np.ndarray:
        return np.abs(planar_multipliers(machine, depth, finer)[:1]) ** (1 / teeth)

    def apart(value: complex, exact: np.ndarray) -> float:
        return abs(abs(value) - exact[0])

    return compared(chart, sharpened_limit(chart, model)[0], random.choice(DEPTHS, LOOKED_AT, replace=False), largest, apart)


def check(machines: int = MACHINES) -> Section:
    """The section of the table."""
    return section("Charts of machines in x and y", "largest multiplier's modulus per tooth passing",
                   [one(seed) for seed in range(machines)],
                   f"{machines} random machines of 1 to 8 modes along x and y or in any direction, on tool and workpiece, "
                   f"1 to 6 teeth of equal and unequal pitch, straight and helical, up and down, {DEPTHS} depths each.")
