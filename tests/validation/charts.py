"""Charts of ordinary cutters against Chebyshev collocation that shares no code (tests/support/second_road.py)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from testbed.analysis.linear.stability import StabilityChart, sharpened_limit, stability_chart
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.second_road import Milling, multipliers
from tests.validation.claims import Claim, Section, below

CUTS, DEPTHS = 300, 12
NEAR = 0.005  # of the limit
SURE, FINER = 1e-6, 1.3  # a larger difference is asked whether it is the second road's own, by more points
LOOKED_AT = 4  # depths of each cut at which the largest multipliers are compared


def model_of(machine: Milling) -> Model:
    """The machine in the project's words."""
    entry, leave = machine.angles
    return Model(Structure(machine.mass, machine.frequency, machine.damping),
                 Cutter(machine.teeth, machine.diameter, machine.helix),
                 Cutting("up-milling" if machine.up else "down-milling", min((leave - entry) / (2 * math.pi), 0.5),
                         machine.tangential, machine.normal))


def random_machine(random: np.random.Generator, most: float = 40.0) -> tuple[Milling, float]:
    """A cutter of 1 to 8 teeth, a/D 0.02 to 1, with 0.1 to `most` oscillations in the cut; and a depth near its limit, m."""
    teeth, radial = int(random.integers(1, 9)), 10 ** random.uniform(math.log10(0.02), 0.0)
    helix = float(random.choice([0.0, random.uniform(0.05, 0.9)]))
    frequency, damping = 10 ** random.uniform(1.5, 3.5), 10 ** random.uniform(-2.5, -1.0)
    tangential = 10 ** random.uniform(8.3, 9.3)
    machine = Milling(10 ** random.uniform(-2, 1), frequency, damping, teeth, helix, 20e-3, bool(random.integers(2)), radial,
                      tangential, tangential * random.uniform(0.1, 0.6), 1.0)
    entry, leave = machine.angles
    oscillations = 10 ** random.uniform(-1.0, math.log10(most))
    machine = replace(machine, speed=min(leave - entry, 2 * math.pi / teeth) * frequency / oscillations)
    # the chip's stiffness that damping bears at the least favourable speed, with the teeth in the cut on average
    mean = max(teeth * (leave - entry) / (2 * math.pi), 0.05) * 0.5 * tangential
    return machine, 2 * damping * machine.mass * (2 * math.pi * frequency) ** 2 / mean * 10 ** random.uniform(-0.5, 0.7)


def one(seed: int) -> dict[str, float]:
    """`compared` of one cut; the multiplier itself is asked, its angle too."""
    random = np.random.default_rng([53, seed])
    machine, typical = random_machine(random)
    depths = typical * np.linspace(0.15, 2.5, DEPTHS)
    chart = stability_chart(model_of(machine), np.array([machine.speed]), depths)

    def largest(depth: float, finer: float = 1.0) -> np.ndarray:
        return multipliers(machine, depth, finer)

    def apart(value: complex, exact: np.ndarray) -> float:
        return max(abs(abs(value) - abs(exact[0])), np.abs(exact - value).min())

    rows = random.choice(DEPTHS, LOOKED_AT, replace=False)
    return compared(chart, sharpened_limit(chart, model_of(machine))[0], rows, largest, apart)


def compared(chart: StabilityChart, limit: float, rows: np.ndarray, exact: Callable[..., np.ndarray],
             apart: Callable[[complex, np.ndarray], float]) -> dict[str, float]:
    """Worst multiplier over max(1, modulus), cells blank and wrong on the unsafe side, and whether the limit is one, of a chart
    of one speed.

    exact(depth, finer): the second road's multipliers, largest first. apart: how far a value of the chart is from them.
    """
    found = {"worst": 0.0, "blank": 0.0, "unsafe": 0.0, "limit": math.nan, "above": 0.0, "cells": 0.0, "unsure": 0.0}
    for row in rows:
        value, depth = chart.largest[row, 0], chart.axial_depths[row]
        found["cells"] += 1
        if np.isnan(value):
            found["blank"] += 1
            continue
        true = exact(depth)
        modulus, wrong = abs(true[0]), apart(value, true)
        size = max(1.0, modulus)
        wrong /= size
        own = abs(abs(exact(depth, FINER)[0]) - modulus) / size if wrong > SURE else 0.0
        if own > min(0.1 * wrong, 1e-5):
            found["unsure"] += 1  # rounding in the second road itself, where a long decay or a vast growth stands in the map
            continue
        found["worst"] = max(found["worst"], wrong)
        found["above"] += wrong > chart.error[row, 0] / size + SURE
        found["unsafe"] += abs(value) < 1.0 <= modulus
    if np.isfinite(limit):
        around = [abs(exact(limit * factor)[0]) for factor in (1 - NEAR, 1 + NEAR)]
        found["limit"] = float(around[0] < 1.0 <= around[1])
    return found


def section(title: str, quantity: str, rows: list[dict[str, float]], drawn: str) -> Section:
    """The section of the table that those comparisons make; quantity: what of the multiplier was compared."""
    total = {name: sum(row[name] for row in rows) for name in ("blank", "unsafe", "above", "cells", "unsure")}
    limits = [row["limit"] for row in rows if math.isfinite(row["limit"])]
    bad = [str(seed) for seed, row in enumerate(rows) if row["worst"] > 1e-4 or row["unsafe"] or row["limit"] == 0.0]
    return Section(title, (
        below(f"{quantity}, of max(1, modulus)", max(row["worst"] for row in rows), 1e-4,
              note=f"{total['cells']:.0f} cells, {total['blank']:.0f} blank; in "
                   f"{total['unsure']:.0f} the second road does not agree with itself"),
        Claim("cells called stable that are not", "0", f"{total['unsafe']:.0f} of {total['cells']:.0f}", total["unsafe"] == 0),
        Claim("limits within 0.5 %", "all", f"{sum(limits):.0f} of {len(limits)}", sum(limits) == len(limits)),
        Claim("errors above their estimate by more than 1e-6", "0", f"{total['above']:.0f} of {total['cells']:.0f}",
              total["above"] == 0),
    ), remark=drawn + (f" Missed: seeds {', '.join(bad)}." if bad else ""))


def check(cuts: int = CUTS) -> Section:
    """The section of the table."""
    return section("Charts of ordinary cutters", "largest multiplier", [one(seed) for seed in range(cuts)],
                   f"{cuts} random cuts of 1 to 8 teeth, a/D 0.02 to 1, 0.1 to 40 oscillations in the cut, up and down, "
                   f"straight and helical, {DEPTHS} depths each.")
