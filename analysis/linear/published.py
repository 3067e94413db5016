"""The five published milling experiments and what the linear theory says of them.

Source: B. P. Mann and K. A. Young (2006), Proc. R. Soc. A 462, 2145-2160, doi 10.1098/rspa.2005.1677, section 4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.stability import StabilityClass, classify
from testbed.analysis.linear.temporal_elements import characteristic_multipliers
from testbed.cut import Cut
from testbed.machine import Model

ELEMENTS = 20  # multipliers to 1e-6


@dataclass(frozen=True)
class PublishedTest:
    """One experiment: spindle_speed (rad/s), axial_depth_of_cut (m), and the outcome that was observed."""

    name: str
    spindle_speed: float
    axial_depth_of_cut: float
    outcome: StabilityClass


def _test(name: str, rpm: float, millimetres: float, outcome: StabilityClass) -> PublishedTest:
    return PublishedTest(name, rpm * math.pi / 30.0, millimetres * 1e-3, outcome)


PUBLISHED = (
    _test("A", 3050, 2.7, "neimark_sacker"),
    _test("B", 3565, 2.1, "neimark_sacker"),
    _test("C", 3635, 2.0, "flip"),
    _test("D", 3810, 2.9, "stable"),
    _test("E", 2850, 2.9, "stable"),
)


def linear_multipliers(model: Model, test: PublishedTest) -> np.ndarray:
    """Characteristic multipliers of a test by temporal finite elements, largest first."""
    cut = Cut(test.spindle_speed, test.axial_depth_of_cut)
    return characteristic_multipliers(milling_equation(model, cut), ELEMENTS)


def linear_verdict(model: Model, test: PublishedTest) -> StabilityClass:
    """The class of a test's largest multiplier."""
    return classify(linear_multipliers(model, test))
