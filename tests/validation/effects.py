"""The catalogue: both engines on every effect at its example value, the order of integration, and the cost of a period."""

from __future__ import annotations

import time
from dataclasses import replace
from types import ModuleType

import numpy as np

from testbed.cut import Sampling
from testbed.effect import catalogue
from testbed.engines import fast, mujoco_engine
from testbed.machine import Cutter, Model
from tests.validation.claims import FLEXURE, Claim, Section, rpm
from tests.validation.engines import STABLE, difference, motion

AGREEMENT, ORDER = 1e-6, 3.5
COARSE = {fast: (24, 48), mujoco_engine: (30, 60)}
FINE = {fast: 800, mujoco_engine: 480}
KINKED = 4  # times as many steps where a law has kinks


def example(name: str) -> Model:
    """The flexure with one effect at its example value; two teeth where the effect is a difference between teeth."""
    model = FLEXURE.with_effect(name, **catalogue()[name].example())
    return replace(model, cutter=Cutter(2)) if name == "runout" else model


def order(engine: ModuleType, model: Model, reference: np.ndarray) -> float:
    """Order between two step counts; NaN where the error is at round-off already."""
    few, many = COARSE[engine]
    errors = [difference(motion(engine, model, STABLE, steps), reference) for steps in (few, many)]
    return float(np.log2(errors[0] / errors[1])) if errors[1] > 1e-12 else float("nan")


def microseconds(model: Model, runs: int = 20, general: bool = False) -> float:
    """Time of one simulated tooth passing period in the fast engine, at its own step, without samples; best of five."""
    cut, best = rpm(3810, 2.9, passes=60), float("inf")
    for _ in range(6):
        begin = time.perf_counter()
        fast.simulate_batch([model] * runs, [cut] * runs, [Sampling(1.0, 1)] * runs, general=general)
        best = min(best, time.perf_counter() - begin)
    return best / runs / 60 * 1e6


def check() -> Section:
    """The section of the table."""
    rows, worst, wrong, slow = [], 0.0, [], []
    linear, base = microseconds(FLEXURE), microseconds(FLEXURE, general=True)
    for name, effect in catalogue().items():
        model = example(name)
        more = 1 if effect.smooth else KINKED
        reference = motion(fast, model, STABLE, more * FINE[fast])
        apart = difference(motion(mujoco_engine, model, STABLE, more * FINE[mujoco_engine]), reference)
        found = {engine: order(engine, model, reference) for engine in COARSE}
        cost = microseconds(model)
        without = motion(fast, model.without_effect(name), STABLE, FINE[fast])
        both = min(without.size, reference.size)
        moved = difference(reference[:both], without[:both])
        if apart > AGREEMENT:
            wrong.append(f"{name} {apart:.1g}")
        if effect.smooth and min(found.values()) < ORDER:
            slow.append(f"{name} {min(found.values()):.1f}")
        worst = max(worst, apart)
        rows.append((name, "yes" if effect.smooth else "no", f"{moved:.2g}", f"{apart:.1e}",
                     f"{found[fast]:.1f}", f"{found[mujoco_engine]:.1f}", f"{cost:.2f}", f"{cost / linear:.1f}"))
    kept = len(rows) - len(wrong)
    claims = (
        Claim("engines agree with each effect on, 480 against 800 steps (4 times as many at kinks)", f"all to {AGREEMENT:g}",
              f"{kept} of {len(rows)}", not wrong, "; ".join(wrong)),
        Claim("order of integration with each smooth law, both engines", f">= {ORDER:g}",
              "all" if not slow else f"{len(slow)} below", not slow, "; ".join(slow)),
    )
    header = ("effect", "smooth law", "moves the record by", "engines differ by", "order, fast", "order, MuJoCo",
              "us a period", "times the base")
    title = f"Each effect (base: {linear:.2f} us a period in the linear kernel, {base:.2f} us in the general one)"
    return Section("Catalogue of effects", claims, ((title, header, tuple(rows)),))
