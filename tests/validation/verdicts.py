"""The linear theory's verdict against the growth that the fast engine shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.temporal_elements import characteristic_multipliers
from testbed.cut import Cut, Sampling
from testbed.engines import fast
from testbed.machine import Model
from tests.validation.claims import Claim, Section
from tests.validation.multipliers import random_point

PASSES = 400
MARGIN = 0.01


def simulated_modulus(model: Model, cut: Cut) -> float:
    """|mu| from the growth of the motion from tooth to tooth over the later passes, by the fast engine.

    A feed and a start that are next to nothing leave the homogeneous equation and room for 150 decades of growth.
    """
    course = replace(cut, passes=PASSES, feed_per_tooth=1e-300, initial_displacement=1e-150)
    states = fast.simulate_batch([model], [course], [Sampling(1.0, 1)]).pass_states[0]
    size = np.hypot(states[:, 0] * model.structure.natural_frequency_rad, states[:, 1])
    bad = np.flatnonzero(~np.isfinite(size) | (size < 1e-250))
    last = int(bad[0]) if bad.size else size.size
    first = last // 3
    return float(np.exp(np.polyfit(np.arange(first, last), np.log(size[first:last]), 1)[0]))


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
