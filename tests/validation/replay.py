"""A published setting replayed: how many cuts until one removes nearly as much as the machine allows?

The machine, and what is believed of it before the first cut (specific force 1800 N/mm^2 +- 20 %, frequencies anywhere between
1 and 2 kHz, stiffness 5e6 +- 1e6 N/m, damping ratio 0.03 +- 0.01), are published; each run draws its model.yaml from that.
A cut is made by MuJoCo and measured with noise, `testbed chart --campaign` fits all cuts so far, and the cut it recommends at a
risk of 5 % is the next. Beside it: the cut whose stability is least certain is the next, with the same fits; and a shop
without a model, which raises the depth at each speed until it chatters.

`python -m tests.validation.replay [--count N] [--workers N]` runs what is not run yet, some minutes of processor each; every
run is a line of replay.jsonl. `tests.validation.run replay` counts them.
"""

# ruff: noqa: E402 - the number of threads is read when numpy is imported
from __future__ import annotations

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

import json
import math
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import testbed
from testbed.analysis.linear.stability import stability_chart
from testbed.engines import mujoco_engine
from testbed.files.campaign import Campaign, Record
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from tests.support.planar_campaign import RPM, planar_campaign
from tests.validation.blind.judge import answered, known_seeds, options_of
from tests.validation.claims import Claim, Section

RESULTS = Path(__file__).with_suffix(".jsonl")
SPEEDS, DEPTHS = np.arange(5000, 10_001, 250) * RPM, np.arange(1, 16) * 1e-4  # rad/s, m
NEARLY, RISK, DRAWS, MOST_CUTS = 0.9, 0.05, 60, 8
FORCE_ANGLE = math.radians(68)
SENSORS = (("displacement_x", "tool"), ("displacement_y", "tool"))
COURSE, RATE = (8, 40, 20), 20_000.0  # revolutions of idling, cutting, ringing down; Hz
ROADS = ("recommended", "least certain")
Cell = tuple[int, int]  # row of the depth, column of the speed


def machine(modes: list[tuple[float, float, float]], force: float) -> Model:
    """The cutter in a tool with the same modes (Hz, N/m, damping ratio) in x and y; force: specific, N/m^2."""
    both = [Mode(stiffness / (2 * math.pi * frequency) ** 2, frequency, ratio, direction, "tool")
            for frequency, stiffness, ratio in modes for direction in (0.0, 0.5 * math.pi)]
    cutting = Cutting("down-milling", 0.25, force * math.sin(FORCE_ANGLE), force * math.cos(FORCE_ANGLE))
    return Model(Structure.of(both), Cutter(4, 12e-3), cutting)


TRUTH = machine([(1243.0, 2.92e6, 0.0619), (1747.0, 1.2e7, 0.0288)], 2160e6)


def believed(seed: int) -> Model:
    """A model.yaml drawn from what is believed before the first cut, with its deviations."""
    random = np.random.default_rng([59, 4, seed])
    frequencies = np.sort(random.uniform(1000.0, 2000.0, 2))
    modes = [(float(frequency), max(2e6, random.normal(5e6, 1e6)), max(0.01, random.normal(0.03, 0.01)))
             for frequency in frequencies]
    model = machine(modes, 1800e6 * max(0.4, random.normal(1.0, 0.2)))
    shares = {"natural_frequency": 1000.0 / math.sqrt(12.0), "damping_ratio": 0.01, "stiffness": 1e6}
    spreads = [(f"modes[{place}].{name}", size) for place in range(4) for name, size in shares.items()]
    spreads += [(name, 0.2 * getattr(model.cutting, name)) for name in ("tangential_coefficient", "normal_coefficient")]
    return replace(model, spreads=tuple(spreads))


def rates() -> tuple[np.ndarray, np.ndarray]:
    """Of every cell (B, S): whether the true machine is stable, and speed times depth, to which the removal rate goes."""
    return stability_chart(TRUTH, SPEEDS, DEPTHS).classes == 0, DEPTHS[:, None] * SPEEDS


def without_model() -> list[int]:
    """Cuts until a cut is good, speeds taken from the slowest and from the fastest, depths raised until one chatters."""
    (stable, rate), counts = rates(), []
    enough = NEARLY * rate[stable].max()
    for columns in (range(SPEEDS.size), reversed(range(SPEEDS.size))):
        made, done = 0, False
        for column in columns:
            for row in range(DEPTHS.size):
                made += not done
                done |= bool(stable[row, column] and rate[row, column] >= enough)
                if not stable[row, column]:
                    break
        counts.append(made)
    return counts


def run(seed: int) -> dict[str, Any]:
    """One belief, both roads: the cuts made, and how many until one was good, or None."""
    begun, told = time.process_time(), {"seed": seed}
    for road in ROADS:
        told[road] = _road(road, believed(seed), seed)
    return told | {"processor": round(time.process_time() - begun)}


def _road(road: str, model: Model, seed: int) -> dict[str, Any]:
    stable, rate = rates()
    enough = NEARLY * rate[stable].max()
    cuts: list[Cell] = []
    records: list[Record] = []
    told: dict[str, Any] = {"cuts": [], "count": None, "without chances": 0}
    while len(cuts) < MOST_CUTS:
        best, chance = _chart(records, model)
        told["without chances"] += best is None and bool(records)
        good = best is not None and bool(stable[best] and rate[best] >= enough)
        cell = best if good else _next(road, best, chance, cuts) or _planned(records, model, cuts)
        cuts.append(cell)
        told["cuts"].append([round(float(SPEEDS[cell[1]] / RPM)), round(float(DEPTHS[cell[0]] * 1e3), 2), bool(stable[cell])])
        if good:
            return told | {"count": len(cuts)}
        records += _made(cell, 1000 * seed + len(cuts), len(cuts))
    return told


def _made(cell: Cell, seed: int, number: int) -> list[Record]:
    """The cut made on the true machine, and measured."""
    row, column = cell
    made = planar_campaign(mujoco_engine.simulate, TRUTH, [(SPEEDS[column] / RPM, DEPTHS[row])], SENSORS, seed, COURSE,
                           rate=RATE)
    return [replace(record, name=f"{number}_{record.name}") for record in made]


def _chart(records: list[Record], model: Model) -> tuple[Cell | None, np.ndarray | None]:
    """The cell recommended, and the chance of every cell, of what is known after these records."""
    campaign = Campaign("replay", tuple(records)) if records else None
    found = testbed.chart(model, SPEEDS.tolist(), DEPTHS.tolist(), campaign=campaign, risk=RISK, draws=DRAWS, progress=False)
    return None if found.recommended is None else _cell(found.recommended), found.stable_probability


def _cell(cut: Any) -> Cell:
    return int(np.argmin(abs(DEPTHS - cut.axial_depth_of_cut))), int(np.argmin(abs(SPEEDS - cut.spindle_speed)))


def _next(road: str, best: Cell | None, chance: np.ndarray | None, made: list[Cell]) -> Cell | None:
    """The cut recommended, where it removes more than those made; before any is made, if none is, the most likely stable one.

    Of the other road the cut of which it is least certain whether it is stable. A shallow one where the records give no chance.
    None where the plan is to be asked.
    """
    rate = rates()[1]
    if chance is None:
        return 0, next(column for column in range(0, SPEEDS.size, 4) if (0, column) not in made)
    if road == "recommended" and best is not None and rate[best] > max((rate[one] for one in made), default=0.0):
        return best
    if road == "recommended" and made:
        return None
    wanted = np.nan_to_num(chance) if road == "recommended" else -abs(np.nan_to_num(chance) - 0.5)
    for one in made:
        wanted[one] = -1.0
    row, column = np.unravel_index(int(np.argmax(wanted)), wanted.shape)
    return int(row), int(column)


def _planned(records: list[Record], model: Model, made: list[Cell]) -> Cell:
    """The most telling cut at the same risk; where none is planned, the shallowest at the middle speed."""
    found = testbed.plan(Campaign("replay", tuple(records)), model, SPEEDS.tolist(), DEPTHS.tolist(), risk=RISK, draws=DRAWS,
                         count=len(made) + 1, progress=False)
    return next((cell for cell in map(_cell, found.next) if cell not in made), (0, SPEEDS.size // 2))


def check() -> Section:
    """The section of the table, of the runs that were made."""
    rows = [json.loads(line) for line in RESULTS.read_text().splitlines()]
    counts = {road: [row[road]["count"] or MOST_CUTS + 1 for row in rows] for road in ROADS}
    chattered = {road: [sum(not calm for _, _, calm in row[road]["cuts"]) for row in rows] for road in ROADS}
    ours, other = ROADS
    shop = without_model()
    claims = (
        Claim("cuts until one removes 90 % of the most, by what is recommended: fewer than without a model", f"< {min(shop)}",
              _spread(counts[ours]), max(counts[ours]) < min(shop),
              f"without a model: {shop[0]} from the slowest speed, {shop[1]} from the fastest, a cut each"),
        Claim("fewer than by the least certain cut, mean", f"< {np.mean(counts[other]):.2f}", _spread(counts[ours]),
              np.mean(counts[ours]) < np.mean(counts[other]), f"least certain: {_spread(counts[other])}"),
        Claim("no more than by the least certain cut, worst run", f"<= {max(counts[other])}", str(max(counts[ours])),
              max(counts[ours]) <= max(counts[other]),
              f"a run ends after {MOST_CUTS} cuts and counts {MOST_CUTS + 1} then"),
        Claim("of the cuts made, those that chatter, by what `chart` recommends", f"<= {RISK:.0%}",
              _share(rows, ours), sum(chattered[ours]) <= RISK * sum(len(row[ours]["cuts"]) for row in rows),
              f"least certain: {_share(rows, other)}"),
    )
    table = ("Run by run", ("seed", *ROADS, "processor"),
             tuple((str(row["seed"]), *(_way(row[road]) for road in ROADS), f"{row['processor']} s") for row in rows))
    return Section("A published setting replayed", claims, (table,),
                   f"{len(rows)} runs. Cuts as rpm / mm, those that chatter with a cross. The last is the one "
                   "recommended, stable, and within 10 % of the largest removal rate of "
                   f"{SPEEDS.size} speeds x {DEPTHS.size} depths. Seeds 8 and 9 were given up after a quarter of an hour each.")


def _spread(counts: list[int]) -> str:
    return f"mean {np.mean(counts):.2f}, worst {max(counts)}"


def _share(rows: list[dict[str, Any]], road: str) -> str:
    cuts = [calm for row in rows for _, _, calm in row[road]["cuts"]]
    return f"{sum(not calm for calm in cuts)} of {len(cuts)}"


def _way(told: dict[str, Any]) -> str:
    return ", ".join(f"{rpm} / {depth:g}{'' if calm else ' x'}" for rpm, depth, calm in told["cuts"])


def main(arguments: list[str]) -> int:
    """Run what is not run yet."""
    options = options_of(arguments, __doc__, 50, 0)
    asked = set(range(options.first, options.first + options.count)) - known_seeds(RESULTS)
    for row in answered(run, sorted(asked), RESULTS, options.workers):
        print(row["seed"], *(row[road]["count"] for road in ROADS), row["processor"], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
