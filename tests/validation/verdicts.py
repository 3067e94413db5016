"""The linear theory's verdict against the growth that the fast engine shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.delay_equation import milling_equation
from analysis.temporal_elements import characteristic_multipliers
from testbed.cut import Sampling
from testbed.engines import fast
from tests.validation.claims import Claim, Section
from tests.validation.multipliers import random_point

PASSES = 600
MARGIN = 0.01


def simulated_modulus(model, cut) -> float:
    """|mu| from how the difference of two runs grows over the later passes; their difference obeys the linear equation."""
    course = replace(cut, passes=PASSES)
    pushed = replace(course, initial_displacement=1e-9)
    states = fast.simulate_batch([model] * 2, [course, pushed], [Sampling(1.0, 1)] * 2).pass_states
    apart = (states[1] - states[0]) * [model.structure.natural_frequency_rad, 1.0]
    size = np.hypot(*apart.T)
    # a difference below the numbers' own resolution says nothing, nor one that has left the finite
    beside = 1e-9 * np.abs(states).max(axis=(0, 2), initial=0.0, where=np.isfinite(states).all(axis=(0, 2))[None, :, None])
    good = np.flatnonzero(np.isfinite(size) & (size > 1e-5 * beside) & (size > 1e-18))
    last = good[-1] if good.size else 0
    for place in range(len(size)):
        if not np.isfinite(size[place]) or size[place] < 1e-18:
            last = place - 1
            break
    first = last // 2
    return float(np.exp(np.polyfit(np.arange(first, last + 1), np.log(size[first:last + 1]), 1)[0]))


def compare(points: int) -> tuple[int, int, float]:
    """(points compared, verdicts that differ, worst difference of |mu|) over random points off the limit."""
    random = np.random.default_rng(60)
    compared, different, worst = 0, 0, 0.0
    while compared < points:
        model, cut = random_point(random)
        linear = abs(characteristic_multipliers(milling_equation(model, cut), 20)[0])
        if abs(linear - 1.0) <= MARGIN:
            continue
        compared += 1
        simulated = simulated_modulus(model, cut)
        different += (simulated > 1.0) != (linear > 1.0)
        worst = max(worst, abs(simulated - linear))
    return compared, different, worst


def check(points: int = 200) -> Section:
    """The section of the table."""
    compared, different, worst = compare(points)
    return Section("Linear against simulated verdict", (
        Claim(f"same verdict on {compared} random points with ||mu| - 1| > {MARGIN:g}", "all",
              f"{compared - different} of {compared}", different == 0, f"worst difference of |mu|: {worst:.1g}"),))
