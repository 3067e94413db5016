"""Charts of machines with modes in x and y and teeth of any pitch against collocation that shares no code (second_road.py)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from analysis.linear.stability import sharpened_limit, stability_chart
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from tests.second_road import Planar, planar_multipliers
from tests.validation.claims import Claim, Section, below

MACHINES, DEPTHS = 200, 10
NEAR = 0.005  # of the limit
SURE, FINER = 1e-6, 1.3  # a larger difference is asked whether it is the second road's own, by more points
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
    """Worst multiplier over max(1, modulus), cells blank and wrong on the unsafe side, and the verdict on the limit."""
    random = np.random.default_rng([55, seed])
    machine, typical = random_machine(random)
    model, teeth = model_of(machine), len(machine.pitches)
    depths = typical * np.linspace(0.15, 2.5, DEPTHS)
    chart = stability_chart(model, np.array([machine.speed]), depths)
    found = {"worst": 0.0, "blank": 0.0, "unsafe": 0.0, "limit": math.nan, "above": 0.0, "cells": 0.0, "unsure": 0.0}
    for row in random.choice(DEPTHS, LOOKED_AT, replace=False):
        value = abs(chart.largest[row, 0])
        found["cells"] += 1
        if np.isnan(value):
            found["blank"] += 1
            continue
        exact = abs(planar_multipliers(machine, depths[row])[0]) ** (1 / teeth)
        size = max(1.0, exact)
        wrong = abs(value - exact) / size
        again = abs(planar_multipliers(machine, depths[row], FINER)[0]) ** (1 / teeth) if wrong > SURE else exact
        if abs(again - exact) / size > min(0.1 * wrong, 1e-5):
            found["unsure"] += 1
            continue
        found["worst"] = max(found["worst"], wrong)
        found["above"] += wrong > chart.error[row, 0] / size + SURE
        found["unsafe"] += value < 1.0 <= exact
    limit = sharpened_limit(chart, model)[0]
    if np.isfinite(limit):
        around = [abs(planar_multipliers(machine, limit * factor)[0]) for factor in (1 - NEAR, 1 + NEAR)]
        found["limit"] = float(around[0] < 1.0 <= around[1])
    return found


def check(machines: int = MACHINES) -> Section:
    """The section of the table."""
    rows = [one(seed) for seed in range(machines)]
    total = {name: sum(row[name] for row in rows) for name in ("blank", "unsafe", "above", "cells", "unsure")}
    limits = [row["limit"] for row in rows if math.isfinite(row["limit"])]
    bad = [str(seed) for seed, row in enumerate(rows) if row["worst"] > 1e-4 or row["unsafe"] or row["limit"] == 0.0]
    return Section("Charts of machines in x and y", (
        below("largest multiplier's modulus per tooth passing, of max(1, modulus)", max(row["worst"] for row in rows), 1e-4,
              note=f"{total['cells']:.0f} cells, {total['blank']:.0f} blank; in "
                   f"{total['unsure']:.0f} the second road does not agree with itself"),
        Claim("cells called stable that are not", "0", f"{total['unsafe']:.0f} of {total['cells']:.0f}", total["unsafe"] == 0),
        Claim("limits within 0.5 %", "all", f"{sum(limits):.0f} of {len(limits)}", sum(limits) == len(limits)),
        Claim("errors above their estimate by more than 1e-6", "0", f"{total['above']:.0f} of {total['cells']:.0f}",
              total["above"] == 0),
    ), remark=f"{machines} random machines of 1 to 8 modes along x and y or in any direction, on tool and workpiece, 1 to 6 "
              f"teeth of equal and unequal pitch, straight and helical, up and down, {DEPTHS} depths each."
              + (f" Missed: seeds {', '.join(bad)}." if bad else ""))
