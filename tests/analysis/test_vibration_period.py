"""The speed of a cut without a tachometer, from its vibration: a wrong one that is stated must not bend what is found."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.multipliers.identify import identify
from testbed.analysis.multipliers.recorded_cut import at_measured_speed
from testbed.analysis.multipliers.vibration_period import vibration_period
from testbed.cut import Cut
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.recording import Recording
from tests.support.independent_simulator import simulate

TRUTH = Model(Structure(2.573, 146.6, 0.0032), Cutter(), Cutting("up-milling", 0.162, 5.5577e8, 1.66731e8))
CUTS = [Cut(rpm * 2 * math.pi / 60, depth * 1e-3, idle_passes=3, passes=50, ring_down_passes=20)
        for rpm, depth in ((3810, 2.9), (2850, 2.9), (4100, 2.2), (3300, 1.2))]
OFF = (0.004, -0.007, 0.011, -0.003)  # of the true speed, by which the stated one differs


def without_marks(noise=5e-7):
    """The cuts' records, of speeds that nobody measured, and the cuts as they are stated."""
    tests = []
    for place, (cut, off) in enumerate(zip(CUTS, OFF, strict=True)):
        record = simulate(TRUTH, cut, noise=noise, seed=40 + place, offset=1e-5, drift=2e-6)
        passes, marks = record.pass_times, record.marks[:0]
        known = {"entry_time": float(passes[3]), "exit_time": float(passes[53])}
        stated = replace(cut, spindle_speed=cut.spindle_speed * (1.0 + off))
        tests.append((replace(record, marks=marks, pass_times=passes[:0], conditions=record.conditions | known), stated))
    return tests


def test_the_speed_is_that_of_the_vibration():
    for (record, stated), cut in zip(without_marks(), CUTS, strict=True):
        found = at_measured_speed(stated, record, 1)
        assert found.spindle_speed == pytest.approx(cut.spindle_speed, rel=2e-4)
        assert found.axial_depth_of_cut == cut.axial_depth_of_cut


@pytest.mark.long
def test_the_machine_is_found_without_a_tachometer_from_wrong_speeds():
    found = identify(replace(TRUTH, structure=replace(TRUTH.structure, damping_ratio=0.006)), without_marks())
    assert all(test.used for test in found.tests) and found.chi_square < 3.0
    for name in ("natural_frequency", "damping_ratio", "tangential_coefficient"):
        one = found.parameters[name]
        assert abs(one.value - TRUTH.value(name)) < 2.0 * (one.high - one.low), name
    assert found.parameters["tangential_coefficient"].value == pytest.approx(5.5577e8, rel=0.01)


def test_unequal_teeth_leave_the_speed_as_it_is():
    """A pattern that recurs with every revolution of three teeth, about a decaying vibration."""
    rate, period, start = 12800.0, 0.0047, 0.1
    time = np.arange(int(0.6 * rate)) / rate
    random = np.random.default_rng(3)
    turn = 2 * math.pi * (time - start) / (3 * period)
    cutting = (time >= start) & (time < start + 90 * period)
    forced = sum(size * np.cos(order * turn + order) for order, size in ((1, 3.0), (2, 1.0), (3, 5.0), (6, 2.0), (9, 1.0)))
    decay = 8.0 * np.exp(-20.0 * (time - start)) * np.cos(2 * math.pi * 163.0 * (time - start))
    values = 1e-6 * (cutting * (forced + decay) + 0.2 * random.standard_normal(time.size))
    record = Recording({"displacement": values}, rate, units={"displacement": "m"}, origin="measured")
    found = vibration_period(record, 1.008 * period, 3, start, start + 90 * period)
    assert found == pytest.approx(period, rel=1e-4)


def test_where_the_vibration_does_not_tell_the_stated_period_stays():
    random = np.random.default_rng(4)
    noise = 1e-6 * random.standard_normal(8000)
    record = Recording({"displacement": noise}, 8000.0, units={"displacement": "m"}, origin="measured")
    assert vibration_period(record, 0.01, 2, 0.1, 0.9) == 0.01  # noise alone
    assert vibration_period(record, 0.01, 2, 0.1, 0.18) == 0.01  # too short
