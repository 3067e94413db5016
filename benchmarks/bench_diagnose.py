"""How long a diagnosis takes:  python benchmarks/bench_diagnose.py [CASE ...]  writes benchmarks/DIAGNOSE.md.

Campaigns of eight cuts of about 2 s at 12.8 kHz, made by MuJoCo with 1 um of noise, each diagnosed with the whole catalogue
after one that does not count (it may compile). Processor time is told beside that by the clock, which other work lengthens.
"""

# ruff: noqa: E402 - the number of threads is read when numpy is imported
from __future__ import annotations

import argparse
import os
import sys
import time
from functools import partial
from pathlib import Path

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from testbed.analysis.fit.observe import observe
from testbed.analysis.search.diagnose import diagnose
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import mujoco_engine
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

LAWS = ROOT / "tests" / "validation" / "blind" / "laws"  # of no catalogue
CASES = ((), ("edge_force",), ("dry_friction",), ("process_damping", "cubic_stiffness"), ("chip_force_exponent", "sensor_lag"),
         ("quintic_stiffness",))
STRENGTHS = {"process_damping": {"coefficient": 1.6e5}, "cubic_stiffness": {"coefficient": 2e13}}
TARGET_S = 60.0
TARGET = Path(__file__).resolve().parent / "DIAGNOSE.md"
HEADER = ("hidden", "answer", "error / noise floor", "processor s", "s by the clock", f"target {TARGET_S:.0f} s")


def campaign(hidden: tuple[str, ...]):
    """Eight cuts by MuJoCo with these effects, made ready for a fit of the believed model."""
    makers, model = catalogue(LAWS), TRUE
    for name in hidden:
        model = model.with_effect(name, **makers[name].example() | STRENGTHS.get(name, {}))
    records = synthetic_campaign(partial(mujoco_engine.simulate, catalogue=makers), model, seed=7)
    return [observe(record, BELIEVED) for record in records]


def row(hidden: tuple[str, ...]) -> tuple[str, ...]:
    """One line of the table."""
    known, records = catalogue(), campaign(hidden)
    begun, clock = time.process_time(), time.perf_counter()
    found = diagnose(plant_of(known), records, BELIEVED, known)
    processor, clock = time.process_time() - begun, time.perf_counter() - clock
    answer, left = " + ".join(found.effects) or "none", found.with_effects / found.noise_floor
    if found.form is not None:
        answer, left = f"{found.form.effect} to the power of {found.form.value:.2f}", found.form.left
    return (" + ".join(hidden) or "nothing", f"{found.verdict}: {answer}", f"{left:.3f}", f"{processor:.0f}", f"{clock:.0f}",
            "met" if clock < TARGET_S else "MISSED")


def case_of(text: str) -> tuple[str, ...]:
    """The effects named in "nothing" or "one+another"; argparse.ArgumentTypeError for one that no catalogue has."""
    names = tuple(name for name in text.split("+") if name != "nothing")
    known = catalogue(LAWS)
    if unknown := [name for name in names if name not in known]:
        raise argparse.ArgumentTypeError(f"no effect {unknown[0]!r}; there are {', '.join(sorted(known))}")
    return names


def main() -> None:
    """Measure, print and, when no case was chosen, write."""
    parser = argparse.ArgumentParser(description="How long a diagnosis takes; without a CASE the table is written anew.")
    parser.add_argument("case", nargs="*", type=case_of, metavar="CASE", help="hidden: nothing, edge_force, one+another")
    chosen = parser.parse_args().case
    cases = chosen or list(CASES)
    load = os.getloadavg()[0]
    row(("edge_force",))
    rows = []
    for case in cases:
        rows.append(row(case))
        print(*rows[-1], sep=" | ", flush=True)
    if chosen:
        return
    lines = ["| " + " | ".join(one) + " |" for one in (HEADER, ("---",) * len(HEADER), *rows)]
    head = ("Written by `python benchmarks/bench_diagnose.py`: eight records of about 2 s at 12.8 kHz, made by MuJoCo, 1 um\n"
            f"of noise, the whole catalogue. Load of the machine when it began: {load:.1f} on {os.cpu_count()} cores.")
    TARGET.write_text("\n".join(["# How long a diagnosis takes", "", head, "", *lines, ""]))


if __name__ == "__main__":
    main()
