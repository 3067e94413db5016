"""What every effect of the catalogue owes on a machine of four modes in the plane, in both engines and under unequal teeth.

As `test_effect_contract`, which asks the same of the flexure: nothing here treats an effect by its name but where it is slow.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.catalogue import catalogue
from testbed.cut import Cut, whole_cut_sampling
from testbed.engines import fast, mujoco_engine
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from tests.engines.test_plane_engine import apart

EFFECTS = catalogue()
MODES = (Mode(2.573, 146.4, 0.0032), Mode(1.8, 205.0, 0.01, math.pi / 2, "tool"), Mode(3.0, 310.0, 0.02, 0.6, "tool"),
         Mode(2.2, 402.0, 0.015, 2.2))  # fmt: skip
MODEL = Model(Structure.of(MODES), Cutter(2), Cutting())
CUT = Cut(3810 * math.pi / 30, 0.5e-3, idle_passes=1, passes=12, ring_down_passes=2, initial_displacement=3e-4,
          length_cut_before=0.02)  # fmt: skip
SAMPLING = whole_cut_sampling(CUT, 2, 12800.0)
CHANNELS = ("displacement_x", "displacement_y", "tool_displacement_x", "tool_displacement_y")


def motion(model, simulate=fast.simulate, steps=None):
    """All four motions, up to the end of the last pass."""
    record = simulate(model, CUT, SAMPLING, channels=CHANNELS, steps=steps)
    assert record.outcome == "ok"
    found = np.array([record.channels[name] for name in CHANNELS])
    return found[:, SAMPLING.start + np.arange(SAMPLING.count) / SAMPLING.rate <= 0.99 * record.pass_times[-1]]


def difference(one, other):
    """`apart` over what both have."""
    count = min(one.shape[1], other.shape[1])
    return apart(one[:, :count], other[:, :count])


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_is_nothing_when_neutral_and_seen_when_not(name):
    effect, base = EFFECTS[name], motion(MODEL)
    assert np.abs(base).max() > 1e-6
    if effect.parameters:
        assert np.array_equal(motion(MODEL.with_effect(name, **effect.neutral())), base)
    alive = MODEL.with_effect(name, **effect.example())
    assert difference(motion(alive), base) > 1e-3
    assert np.array_equal(motion(alive), motion(alive))


@pytest.mark.parametrize("name", EFFECTS)
def test_the_engines_agree(name):
    model = MODEL.with_effect(name, **EFFECTS[name].example())
    fine = 1 if EFFECTS[name].smooth else 8
    ours, theirs = motion(model, steps=160 * fine), motion(model, mujoco_engine.simulate, 160 * fine)
    assert difference(theirs, ours) < 1e-6


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.smooth])
def test_a_smooth_law_keeps_the_order(name):
    model = MODEL.with_effect(name, **EFFECTS[name].example())
    states = [fast.simulate_batch([model], [CUT], [SAMPLING], steps=steps) for steps in (40, 160, 640)]
    scale = np.array([1.0, 1e-3])
    errors = [apart(one.pass_states[0] * scale, states[2].pass_states[0] * scale) for one in states[:2]]
    order = math.log(errors[0] / errors[1], 4.0)
    assert order > (1.75 if name == "chip_force_exponent" else 3.5) or errors[0] < 1e-9, (order, errors)


@pytest.mark.parametrize("name", EFFECTS)
def test_under_teeth_of_all_but_equal_pitch_an_effect_is_what_it_is_under_equal_ones(name):
    """Two roads to one motion: the surface at the grid's own points, and read between them."""
    effect, steps = EFFECTS[name], 640
    equal = MODEL.with_effect(name, **effect.example())
    half = math.radians(180.0)
    nearly = replace(equal, cutter=Cutter(2, pitch_angles=(half - 1e-10, half + 1e-10)))
    assert nearly.cutter.pitch_angles
    assert difference(motion(nearly, steps=steps), motion(equal, steps=steps)) < (1e-6 if effect.smooth else 1e-4)
