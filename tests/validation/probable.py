"""Chances of stability against machines that nobody told: campaigns simulated, fitted, and every chance held against the truth.

Cells lie about the limit of the fitted machine, where chances are neither 0 nor 1; those of one machine are right or wrong
together, so that the number of machines, not of cells, says how well a share is known.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from functools import partial

import numpy as np

from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.observe import observe
from testbed.analysis.linear.stability import sharpened_limit, stability_chart
from testbed.analysis.probable.chance import by_surface, chance_of, each_drawn
from testbed.analysis.probable.posterior import posterior, why_no_chance
from testbed.api.probable import filled
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.workshop import RPM
from tests.support.synthetic_campaign import synthetic_record
from tests.validation.claims import Claim, Section

MACHINES, DAMPED = 40, 5
BINS = ((0.0, 0.2), (0.2, 0.5), (0.5, 0.8), (0.8, 0.9), (0.9, 1.0))
SPEEDS, DEPTHS, DRAWS, CUTS = 12, 9, 200, 3
REACH, FEW = 2.5, 30  # standard deviations of the limit, to which the cells lie on either side of it; draws that tell these
MOST = 30.0
EVERY = catalogue()
Cells = list[tuple[float, bool]]


def machine(random: np.random.Generator) -> tuple[Model, Model]:
    """A machine, and what its user believes of it."""
    frequency, damping = float(random.uniform(90, 400)), float(10 ** random.uniform(-2.4, -1.7))
    tangential, ratio, flutes = float(random.uniform(4e8, 1.2e9)), float(random.uniform(0.25, 0.45)), int(random.integers(1, 4))
    cutting = partial(Cutting, "up-milling" if random.integers(2) else "down-milling", float(random.uniform(0.1, 0.25)))
    mass = float(random.uniform(0.5, 4.0))
    truth = Model(Structure(mass, frequency, damping), Cutter(flutes), cutting(tangential, ratio * tangential))
    off = random.uniform(-1, 1, 4) * (0.004, 0.2, 0.1, 0.1)
    return truth, Model(Structure(mass, frequency * (1 + off[0]), damping * (1 + off[1])), Cutter(flutes),
                        cutting(tangential * (1 + off[2]), ratio * tangential * (1 + off[3])))


def limits(model: Model, speeds: np.ndarray) -> np.ndarray:
    """Limits (m) of the linear machine at some speeds; NaN where they are above MOST times the least that it may have."""
    return sharpened_limit(stability_chart(model, speeds, least_limit(model) * np.linspace(0.2, MOST, 120)), model)


def least_limit(model: Model) -> float:
    """About the least depth (m) at which the machine chatters."""
    return model.structure.stiffness * model.structure.damping_ratio / model.cutting.tangential_coefficient


def campaign(truth: Model, random: np.random.Generator, seed: int) -> list:
    """A few stable cuts, with noise that leaves the coefficients a few per cent."""
    structure, flutes, found = truth.structure, truth.cutter.flutes, []
    for number in range(CUTS):
        speed = 2 * math.pi * structure.natural_frequency / (flutes * random.uniform(1.6, 3.4))
        limit = limits(truth, np.array([speed]))[0]
        depth = float(random.uniform(0.4, 0.8) * (limit if math.isfinite(limit) else MOST * least_limit(truth)))
        size = depth * truth.cutting.tangential_coefficient * 1e-4 / structure.stiffness
        record = synthetic_record(fast.simulate, truth, speed / RPM, depth, 10 * seed + number, course=(8, 25, 12),
                                  noise=size * random.uniform(0.1, 0.4), rate=25 * structure.natural_frequency)
        found.append(observe(record, truth))
    return found


def cells(model: Model, known, wanted: Callable, road: Callable, random: np.random.Generator, seed: int) -> Cells:
    """(chance, whether it is stable) of cells about the limit of a fitted machine. wanted: the true chart."""
    low, high = (2 * math.pi * model.structure.natural_frequency / (model.cutter.flutes * share) for share in (3.4, 1.6))
    speeds, linear, found = random.uniform(low, high, SPEEDS), known.without_effects(), []
    spread = np.std([limits(linear.at(values), speeds) for values in linear.drawn(FEW, seed)], axis=0)
    for speed, limit, size in zip(speeds, limits(model, speeds), spread, strict=True):
        if not math.isfinite(limit + size):  # none within reach: stable for certain
            continue
        depths = np.maximum(limit + size * np.linspace(-REACH, REACH, DEPTHS), 0.1 * limit)
        chance = chance_of(road(known, np.array([speed]), depths, DRAWS, seed)).probability[:, 0]
        stable = wanted(np.array([speed]), depths).classes[:, 0] == 0
        found += [(float(one), bool(right)) for one, right in zip(chance, stable, strict=True) if math.isfinite(one)]
    return found


def one(seed: int, damped: bool = False) -> dict[str, Cells | str]:
    """Chances of a machine; where process damping is hidden, as if nothing were missing, and once it is added."""
    random = np.random.default_rng([59, seed, damped])
    truth, believed = machine(random)
    if damped:
        tangential = truth.cutting.tangential_coefficient
        truth = truth.with_effect("process_damping", coefficient=float(random.uniform(2e-4, 6e-4)) * tangential)
    records = campaign(truth, random, seed)
    wanted = partial(filled, truth, catalogue=EVERY)
    plain = partial(each_drawn, stability_chart)

    def asked(model: Model, road: Callable) -> tuple[str, Cells]:
        found = compare(predict, records, model, EVERY)
        told = posterior(found.fitter, found.fit, found.parameters, model, EVERY)
        middle = told.known.without_effects().model
        return why_no_chance(found), cells(middle, told.known, wanted, road, np.random.default_rng(seed), seed)

    why, first = asked(believed, plain)
    if not damped:
        return {"refused": why} if why else {"given": first}
    added = believed.with_effect("process_damping", coefficient=float(0.5 * truth.value("process_damping.coefficient")))
    again, after = asked(added, partial(by_surface, partial(filled, catalogue=EVERY)))
    return {"refused": why, "as if nothing were missing": first, **({} if again else {"once it is added": after})}


def counted(found: Cells) -> list[tuple[str, str, str, str]]:
    """By bins of the chance: cells, their mean chance, the share that is stable."""
    chance, stable = np.array([one for one, _ in found]), np.array([one for _, one in found])
    rows = []
    for low, high in BINS:
        some = (chance >= low) & ((chance < high) | (high == 1.0))
        means = (f"{chance[some].mean():.1%}", f"{stable[some].mean():.1%}") if some.any() else ("-", "-")
        rows.append((f"{100 * low:.0f} to {100 * high:.0f} %", str(int(some.sum())), *means))
    return rows


def check(machines: int = MACHINES, damped: int = DAMPED) -> Section:
    """The section of the table."""
    return counted_section([one(seed) for seed in range(machines)], [one(seed, True) for seed in range(damped)])


def doubt(found: list[Cells], again: int = 500) -> float:
    """Standard error of (share stable - mean chance) of the cells of 90 to 100 %, machines drawn again from those there are."""
    random, gaps = np.random.default_rng(1), []
    for _ in range(again):
        some = [cell for place in random.integers(0, len(found), len(found)) for cell in found[place] if cell[0] >= 0.9]
        gaps += [np.mean([right for _, right in some]) - np.mean([chance for chance, _ in some])] if some else []
    return float(np.std(gaps))


def counted_section(found: list[dict[str, Cells | str]], hidden: list[dict[str, Cells | str]]) -> Section:
    """The section, from answers of `one` without and with a hidden effect."""
    machines, damped = len(found), len(hidden)
    cells_of = [each["given"] for each in found if each.get("given")]
    given = [cell for each in found for cell in each.get("given", ())]
    sure = [right for chance, right in given if chance >= 0.9]
    share = float(np.mean(sure)) if sure else math.nan
    mean = float(np.mean([chance for chance, _ in given if chance >= 0.9])) if sure else math.nan
    refused = sum("refused" in each for each in found)
    told = sum(bool(each["refused"]) for each in hidden)
    claims = (
        Claim("cells of a chance of 90 to 100 %: share that is stable, against their mean chance", "within 3 points",
              f"{share:.1%} for {mean:.1%}", abs(share - mean) <= 0.03,
              f"{len(sure)} cells of {len(cells_of)} machines with a limit within reach; the difference is known to "
              f"{100 * doubt(cells_of):.0f} points; {refused} of {machines} machines got no chance"),
        Claim("machines with a hidden process damping that get no chance before it is added", "those whose records show it",
              f"{told} of {damped}", None, "what loud noise hides is not missed; tables below: chances taken all the same"),
    )
    header = ("chance", "cells", "mean chance", "stable")
    tables = [(f"{machines - refused} machines without a hidden effect", header, tuple(counted(given)))]
    for name in ("as if nothing were missing", "once it is added"):
        some = [cell for each in hidden for cell in each.get(name, ())]
        tables.append((f"{damped} machines with process damping, {name}", header, tuple(counted(some))))
    return Section("Chance of stability", claims, tuple(tables),
                   f"Machines of one mode, 1 to 3 flutes; of each {CUTS} stable cuts with a tachometer and loud noise, a third "
                   f"of the motion to all of it; {DRAWS} machines drawn. Cells: up to {SPEEDS} speeds, {DEPTHS} depths within "
                   f"{REACH:g} standard deviations of the limit, where there is one.")


if __name__ == "__main__":
    print(check(*map(int, sys.argv[1:])))
