"""Which tooth cuts first: teeth are counted from time 0, so a pass more of idling brings another one."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.cut import Cut, Sampling
from testbed.engines import fast, mujoco_engine
from testbed.machine import Cutter
from tests.support.campaign_files import TRUE

SPEED, PITCH = 400.0, math.pi
UNEQUAL = replace(TRUE, cutter=Cutter(flutes=2))


def _cut(simulate, idle, angle):
    """Displacement from the entry on, of two teeth with runout."""
    cut = Cut(SPEED, 0.8e-3, 1e-4, idle, 40, 20)
    sampling = Sampling(12800.0, 4000, idle * PITCH / SPEED)
    return simulate(UNEQUAL.with_effect("runout", offset=8e-6, angle=angle), cut, sampling)


@pytest.mark.parametrize("simulate", [fast.simulate, mujoco_engine.simulate])
def test_a_pass_more_of_idling_brings_the_other_tooth(simulate):
    plain = _cut(simulate, 4, 0.6).channels["displacement"]
    other = _cut(simulate, 5, 0.6).channels["displacement"]
    turned = _cut(simulate, 5, 0.6 + math.pi).channels["displacement"]
    assert np.std(other - plain) > 1e-2 * np.std(plain)
    assert np.std(turned - plain) < 1e-6 * np.std(plain)


@pytest.mark.parametrize("simulate", [fast.simulate, mujoco_engine.simulate])
def test_marks_belong_to_tooth_0(simulate):
    marks = _cut(simulate, 5, 0.6).marks
    assert marks[:3] == pytest.approx([0.0, 2 * PITCH / SPEED, 4 * PITCH / SPEED])
