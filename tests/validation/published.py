"""The five published cuts: verdict of temporal elements and of simulated once-per-tooth samples with contact loss."""

from __future__ import annotations

import math

from testbed.analysis.linear.published import PUBLISHED, PublishedTest, linear_multipliers
from testbed.analysis.linear.stability import classify
from testbed.analysis.multipliers.verdict import SampleVerdict, simulated_verdict
from testbed.cut import Cut, Sampling
from testbed.engines import fast
from tests.validation.claims import PAPER, Claim, Section

PASSES = 600  # case B grows by 1.3 % a tooth: it needs hundreds of teeth to show what it grows into
STEPS = 40


def simulated(test: PublishedTest) -> SampleVerdict:
    """What the simulated once-per-tooth samples of a test show, where the tooth may leave the work."""
    cut = Cut(test.spindle_speed, test.axial_depth_of_cut, passes=PASSES)
    model = PAPER.with_effect("contact_loss")
    states = fast.simulate_batch([model], [cut], [Sampling(1.0, 1)], steps=STEPS).pass_states[0]
    return simulated_verdict(states[:, 0])


def check() -> Section:
    """The section of the table."""
    rows, right = [], [0, 0]
    for test in PUBLISHED:
        multipliers, seen = linear_multipliers(PAPER, test), simulated(test)
        linear = classify(multipliers)
        right[0] += linear == test.outcome
        right[1] += seen.outcome == test.outcome
        rows.append((test.name, f"{test.spindle_speed * 30 / math.pi:.0f}", f"{test.axial_depth_of_cut * 1e3:g}",
                     test.outcome, f"{multipliers[0]:.5f}", f"{abs(multipliers[0]):.5f}", linear,
                     f"{seen.outcome}: {seen.reason}"))
    return Section("Published experiments", (
        Claim("verdict by temporal finite elements", "5 of 5", f"{right[0]} of 5", right[0] == 5),
        Claim("verdict by simulated once-per-tooth samples, with contact loss", "5 of 5", f"{right[1]} of 5",
              right[1] == 5)),
        (("Cases", ("case", "rpm", "mm", "experiment", "largest multiplier", "modulus", "elements", "simulated"),
          tuple(rows)),))
