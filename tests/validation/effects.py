"""The catalogue: both engines on every effect at its example value, the order of integration, and the cost of a period."""

from __future__ import annotations

import time
from dataclasses import replace
from types import ModuleType

import numpy as np

from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling
from testbed.engines import fast, mujoco_engine
from testbed.machine import Cutter, Model
from tests.validation.claims import FLEXURE, Claim, Section, rpm
from tests.validation.engines import GROWING, STABLE, difference, motion

AGREEMENT, ORDER = 1e-6, 3.5
COARSE = {fast: (24, 48), mujoco_engine: (30, 60)}
FINE = {fast: 800, mujoco_engine: 480}
LEAPING = replace(GROWING, initial_displacement=1.5e-4)  # further than the feed, so that teeth let go from the start
KINKED = 4  # times as many steps where a law has kinks


def example(name: str) -> Model:
    """The flexure with one effect at its example value; two teeth where the effect is a difference between teeth."""
    model = FLEXURE.with_effect(name, **catalogue()[name].example())
    return replace(model, cutter=Cutter(2)) if name == "runout" else model


def order(engine: ModuleType, model: Model, cut: Cut, reference: np.ndarray, smooth: bool) -> float:
    """Order between two step counts; NaN where the error is at round-off already.

    Where a law has kinks the error depends on where they fall within a step, so the counts lie further apart.
    """
    few, many = COARSE[engine]
    many *= 1 if smooth else 8
    errors = [difference(motion(engine, model, cut, steps), reference) for steps in (few, many)]
    return float(np.log(errors[0] / errors[1]) / np.log(many / few)) if errors[1] > 1e-12 else float("nan")


def microseconds(model: Model, runs: int = 20, general: bool = False) -> float:
    """Processor time of one simulated tooth passing period in the fast engine, at its own step, without samples; best of
    five after the first."""
    cut, best = rpm(3810, 2.9, passes=60), float("inf")
    for _ in range(6):
        begin = time.process_time()
        fast.simulate_batch([model] * runs, [cut] * runs, [Sampling(1.0, 1)] * runs, general=general)
        best = min(best, time.process_time() - begin)
    return best / runs / 60 * 1e6


def check() -> Section:
    """The section of the table."""
    rows, worst, wrong, slow = [], 0.0, [], []
    linear, base = microseconds(FLEXURE), microseconds(FLEXURE, general=True)
    for name, effect in catalogue().items():
        model, cut = example(name), LEAPING if name == "contact_loss" else STABLE
        more = 1 if effect.smooth else KINKED
        reference = motion(fast, model, cut, more * FINE[fast])
        apart = difference(motion(mujoco_engine, model, cut, more * FINE[mujoco_engine]), reference)
        found = {engine: order(engine, model, cut, reference, effect.smooth) for engine in COARSE}
        cost = microseconds(model)
        without = motion(fast, model.without_effect(name), cut, FINE[fast])
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
    title = (f"Each effect (base: {linear:.2f} us a period in the linear kernel, {base:.2f} us in the general one; "
             "contact_loss in chatter, runout with two teeth)")
    return Section("Catalogue of effects", claims, ((title, header, tuple(rows)),))
