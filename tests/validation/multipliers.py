"""Spectral and temporal finite elements against Chebyshev collocation, and against the numbers of the literature."""

from __future__ import annotations

import numpy as np

from testbed.analysis.linear.collocation import collocation_multipliers
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.spectral_elements import multipliers
from testbed.analysis.linear.temporal_elements import characteristic_multipliers
from testbed.cut import Cut
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.validation.claims import MASS, PAPER, Claim, Section, below, rpm

# (rpm, mm, largest multiplier, its modulus): Chebyshev collocation with 24 nodes, as published to five digits
TABLE = ((3050, 2.7, 0.95768 + 0.65254j, 1.15886), (3565, 2.1, -0.97932 + 0.25732j, 1.01256),
         (3635, 2.0, -1.10151 + 0j, 1.10151), (3810, 2.9, -0.69637 + 0.38921j, 0.79776),
         (2850, 2.9, 0.63601 + 0.27068j, 0.69121))


def random_point(random: np.random.Generator) -> tuple[Model, Cut]:
    """A milling equation with random speed, depth, damping, frequency, immersion and coefficient ratio."""
    tangential = MASS * random.uniform(1e8, 4e8)
    model = Model(Structure(MASS, random.uniform(100, 200), random.uniform(0.002, 0.05)), Cutter(),
                  Cutting("up-milling", random.uniform(0.05, 0.5), tangential, random.uniform(0.1, 0.6) * tangential))
    return model, rpm(random.uniform(2000, 8000), random.uniform(0.2, 3.0))


def largest_difference(points: int) -> tuple[float, float]:
    """Worst |mu| difference over random points, relative above 1: spectral elements, and 20 fixed."""
    random = np.random.default_rng(2006)
    refined, fixed = 0.0, 0.0
    for _ in range(points):
        equation = milling_equation(*random_point(random))
        exact = collocation_multipliers(equation, 30)
        for kind, found in enumerate((multipliers(equation)[0][0],
                                      characteristic_multipliers(equation, 20)[0])):
            error = float(np.min(np.abs(exact - found)) / max(1.0, abs(found)))
            refined, fixed = (max(refined, error), fixed) if kind == 0 else (refined, max(fixed, error))
    return refined, fixed


def table_error() -> float:
    """Worst difference from the published table, of real part, imaginary part and modulus."""
    worst = 0.0
    for speed, depth, largest, modulus in TABLE:
        found = characteristic_multipliers(milling_equation(PAPER, rpm(speed, depth)), 40)[0]
        worst = max(worst, abs(found.real - largest.real), abs(abs(found.imag) - largest.imag),
                    abs(abs(found) - modulus))
    return worst


def check(points: int = 200) -> Section:
    """The section of the table."""
    refined, fixed = largest_difference(points)
    digits = table_error()
    return Section("Multipliers", (
        below(f"spectral elements against collocation, {points} random points", refined, 1e-6,
              note=f"20 temporal elements: {fixed:.1g}"),
        Claim("the published table, five cases", "its five digits (6e-6)", f"{digits:.1e}", digits < 6e-6),
    ))


