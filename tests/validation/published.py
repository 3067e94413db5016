"""The five published cuts: verdict of temporal elements and of simulated once-per-tooth samples with contact loss."""

from __future__ import annotations

import numpy as np

from analysis.delay_equation import milling_equation
from analysis.stability import classify
from analysis.temporal_elements import characteristic_multipliers
from testbed.cut import Cut, Sampling
from testbed.engines import fast
from testbed.machine import Model
from tests.validation.claims import PAPER, Claim, Section, rpm

CASES = (("A", 3050, 2.7, "neimark_sacker"), ("B", 3565, 2.1, "neimark_sacker"), ("C", 3635, 2.0, "flip"),
         ("D", 3810, 2.9, "stable"), ("E", 2850, 2.9, "stable"))
PASSES, LATE, STILL = 600, 60, 1e-3


def once_per_tooth_verdict(model: Model, cut: Cut) -> str:
    """What the late once-per-tooth samples do: stay (stable), alternate (flip), or go round (neimark_sacker).

    A small stroke beside the first periods' counts as staying; chatter fills its size only after hundreds of passes.
    """
    states = fast.simulate_batch([model], [cut], [Sampling(1.0, 1)], steps=40).pass_states[0]
    samples = states[-LATE:, 0]
    spread = float(np.ptp(samples))
    if spread < STILL * cut.feed_per_tooth:
        return "stable"
    once, twice = np.abs(np.diff(samples)).mean(), np.abs(samples[2:] - samples[:-2]).mean()
    return "flip" if twice < 0.05 * once else "neimark_sacker"


def check() -> Section:
    """The section of the table."""
    lossy = PAPER.with_effect("contact_loss")
    rows, right = [], [0, 0]
    for name, speed, depth, published in CASES:
        cut = rpm(speed, depth, passes=PASSES)
        multipliers = characteristic_multipliers(milling_equation(PAPER, cut), 20)
        linear, simulated = classify(multipliers), once_per_tooth_verdict(lossy, cut)
        right[0] += linear == published
        right[1] += simulated == published
        rows.append((name, f"{speed}", f"{depth:g}", published, f"{multipliers[0]:.5f}", f"{abs(multipliers[0]):.5f}",
                     linear, simulated))
    return Section("Published experiments", (
        Claim("verdict by temporal finite elements", "5 of 5", f"{right[0]} of 5", right[0] == 5),
        Claim("verdict by simulated once-per-tooth samples, with contact loss", "5 of 5", f"{right[1]} of 5",
              right[1] == 5)),
        (("Cases", ("case", "rpm", "mm", "experiment", "largest multiplier", "modulus", "elements", "simulated"),
          tuple(rows)),))
