"""What an effect costs: microseconds a simulated tooth pass with each effect, next to the base model.

    python benchmarks/bench_effects.py [--passes 2000]

One core, fast engine, its own choice of steps, displacement only, two flutes, stable cut (3810 rpm, 0.8 mm). The best
of five runs; the first, which may compile, is not counted.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace

from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling
from testbed.engines import fast
from testbed.engines import fast_kernel as fk
from testbed.engines.packing import pack
from testbed.machine import Cutter, Cutting, Model, Structure


def cost(model: Model, passes: int, general: bool) -> tuple[float, int, int]:
    """(microseconds a pass, steps in the cut, steps in free flight)."""
    cut = Cut(3810 * 2 * math.pi / 60, 0.8e-3, passes=passes)
    sampling = Sampling(1.0, 1)
    best = math.inf
    for attempt in range(6):
        started = time.perf_counter()
        result = fast.simulate_batch([model], [cut], [sampling], general=general)
        if attempt:
            best = min(best, time.perf_counter() - started)
    if result.outcome[0] != fk.OUTCOME_OK:
        raise RuntimeError(f"{dict(model.effects)} diverged")
    integers = pack(model, cut, catalogue()).I
    steps, teeth = (integers[place : place + integers[fk.SEGMENTS]] for place in (fk.STEPS, fk.TEETH))
    return 1e6 * best / passes, int(steps[teeth > 0].sum()), int(steps[teeth == 0].sum())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--passes", type=int, default=2000)
    passes = parser.parse_args().passes
    effects = catalogue()
    model = Model(Structure(2.573, 920.0 / (2.0 * math.pi), 0.0032), Cutter(2), Cutting())
    rows = [("(base, linear kernel)", *cost(model, passes, False)),
            ("(base, general kernel)", *cost(model, passes, True))]
    for name, effect in effects.items():
        rows.append((name, *cost(replace(model, effects={name: effect.example()}), passes, False)))
    base = rows[0][1]
    print(f"{'effect':24}{'us a pass':>10}{'x base':>8}{'steps in cut':>14}{'in flight':>11}")
    for name, microseconds, cutting, flight in rows:
        print(f"{name:24}{microseconds:10.2f}{microseconds / base:8.1f}{cutting:14d}{flight:11d}")


if __name__ == "__main__":
    main()
