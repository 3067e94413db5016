"""What `testbed effects --new NAME` writes: an effect's file that works as it stands, and its test."""

EFFECT = '''"""TITLE: say here what the effect is.

    F = -c v                    the law, with its symbols

Source: author (year), title, journal, doi.

Valid: say where the law holds, and where it does not.

Start of a fit: say how a first guess of c is read off a measurement.
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="TITLE",
    parameters=(
        # at `neutral` the effect is nothing at all; a parameter that cannot switch it off alone has vanishes=False
        Parameter("coefficient", "c", "N s/m", "strength of the effect",
                  neutral=0.0, bounds=(0.0, 1.0e4), example=10.0, start=1.0),
    ),
    law="F = -c v",
    source="author (year), title, doi",
    validity="say where the law holds",
    leaves="say what it leaves in a measurement",
    confused_with=(("process_damping", "say which test cut tells the two apart"),),
)


def structure_force(velocity, coefficient):
    # a force on the structure along x, N; arguments are asked for by name: `testbed effects --hooks` lists them all.
    # Numbers and the math module only: the function is compiled.
    return -coefficient * velocity
'''

TEST = '''"""Does NAME do what its law says? Run: python -m pytest test_NAME.py"""

import math
from pathlib import Path

import numpy as np
import pytest

from testbed.cut import Cut, whole_cut_sampling
from testbed.catalogue import catalogue
from testbed.engines import fast
from testbed.machine import Cutter, Cutting, Model, Structure

EFFECTS = catalogue(Path(__file__).resolve().parent)
EFFECT = EFFECTS["NAME"]
MODEL = Model(Structure(2.573, 146.4, 0.0032), Cutter(2), Cutting())
CUT = Cut(3810 * 2 * math.pi / 60, 0.8e-3, passes=12, ring_down_passes=2, initial_displacement=3e-4)


def motion(model, cut=CUT, steps=None):
    sampling = whole_cut_sampling(cut, 2, 12800.0)
    return fast.simulate(model, cut, sampling, steps=steps, catalogue=EFFECTS).channels["displacement"]


def test_at_its_neutral_values_it_is_nothing():
    assert np.array_equal(motion(MODEL.with_effect("NAME", **EFFECT.neutral())), motion(MODEL))


def test_at_its_example_values_it_is_seen():
    base = motion(MODEL)
    assert np.abs(motion(MODEL.with_effect("NAME", **EFFECT.example())) - base).max() > 1e-3 * np.abs(base).max()


@pytest.mark.skipif(not EFFECT.smooth, reason="its law has kinks")
def test_smaller_steps_converge_at_the_fourth_order():
    model = MODEL.with_effect("NAME", **EFFECT.example())
    reference = motion(model, steps=320)
    coarse, fine = (np.abs(motion(model, steps=steps) - reference).max() for steps in (20, 40))
    assert math.log2(coarse / fine) > 3.5 or coarse < 1e-12


def test_against_the_closed_form():
    # replace it by your own: with F = -c v a free vibration decays at (c_0 + c) / (2 m)
    free = Cut(CUT.spindle_speed, 0.0, passes=0, ring_down_passes=60, initial_displacement=3e-4)
    signal = motion(MODEL.with_effect("NAME", coefficient=10.0), free)
    peaks = np.flatnonzero((signal[1:-1] > signal[:-2]) & (signal[1:-1] >= signal[2:])) + 1
    decay = -np.polyfit(peaks / 12800.0, np.log(signal[peaks]), 1)[0]
    assert decay == pytest.approx((MODEL.structure.damping + 10.0) / (2 * MODEL.structure.mass), rel=0.01)
'''
