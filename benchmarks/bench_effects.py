"""What an effect costs: microseconds a simulated tooth pass with each effect, next to the base model.

    python benchmarks/bench_effects.py [--passes 2000]

One core, fast engine, its own choice of steps, displacement only, two flutes, stable cut (3810 rpm, 0.8 mm). The best
of five runs; the first, which may compile, is not counted.
"""

from __future__ import annotations

import argparse
import itertools
import math
import time
from dataclasses import replace

import numpy as np

from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling
from testbed.effect import Effect
from testbed.engines import fast
from testbed.engines import fast_kernel as fk
from testbed.engines.packing import pack
from testbed.machine import CARRIERS, Cutter, Cutting, Mode, Model, Structure

MOTIONS = ("displacement_x", "displacement_y", "tool_displacement_x", "tool_displacement_y")


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


def in_the_plane(modes: int, channels: int, rate: float, effect: Effect | None) -> tuple[float, float]:
    """Milliseconds of processor a record of 2 s takes by the lean kernel, and by the general one.

    modes: on tool and workpiece in turn; channels: displacements; rate: Hz; effect: at the edges, or none.
    """
    structure = Structure.of([Mode(2.5 / (1 + mode), 146.0 * 1.5**mode, 0.01, 0.2 + mode, CARRIERS[mode % 2])
                              for mode in range(modes)])  # fmt: skip
    model = Model(structure, Cutter(2), Cutting("down-milling", 0.2, 6e8, 2e8),
                  effects={} if effect is None else {effect.name: effect.example()})  # fmt: skip
    cut = Cut(3800 * 2 * math.pi / 60, 0.3e-3, idle_passes=10, passes=220, ring_down_passes=20)
    sampling = Sampling(rate, int(2 * rate))
    asked = [fast.CHANNELS[name] for name in MOTIONS[:channels]]
    times = np.empty((6, 2))
    for attempt, road in itertools.product(range(6), range(2)):
        began = time.process_time()
        fast.simulate_batch([model] * 20, [cut] * 20, [sampling] * 20, signals=15, asked=asked, general=road == 1)
        times[attempt, road] = time.process_time() - began
    lean, general = 1e3 * times[1:].min(axis=0) / 20
    return float(lean), float(general)


def main() -> None:
    """Print the tables."""
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
    print(f"\n{'in x and y':52}{'lean, ms':>10}{'general, ms':>13}{'ratio':>7}")
    for name, modes, channels, rate in itertools.product(("", "edge_force", "runout"), (2, 4), (1, 4), (4000.0, 12800.0)):
        lean, general = in_the_plane(modes, channels, rate, effects.get(name))
        what = f"{name or 'no effect'}, {modes} modes, {channels} channels, {rate:g} Hz"
        print(f"{what:52}{lean:10.2f}{general:13.2f}{general / lean:7.1f}")


if __name__ == "__main__":
    main()
