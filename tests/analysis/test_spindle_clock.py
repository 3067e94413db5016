"""The spindle's clock from marks as machines give them: edges of a digital line, lost marks, false ones."""

import math

import numpy as np
import pytest

from analysis.records.spindle_clock import clock_error, clock_of, digital, smoothed, turns_of

RATE = 12800.0  # samples/s


def edges(turning, count=60):
    """Times of the marks as a digital line shows them: halfway between the two samples around each."""
    return (np.ceil(turning(np.arange(count)) * RATE) - 0.5) / RATE


@pytest.mark.parametrize("rpm", (1200.5, 3050.0, 3810.3, 6010.0, 12000.7))
def test_a_digital_line_at_a_constant_speed_is_steady(rpm):
    period = 60.0 / rpm
    marks = edges(lambda turn: 0.004 + turn * period)
    assert digital(marks, RATE, 0.0)
    found, anchor, steady = clock_of(marks, 1.0 / RATE)
    assert steady
    angle, speed = clock_error(marks, period, anchor, RATE, halfway=True)
    assert abs(found / period - 1.0) < 3.0 * speed
    assert abs(anchor - 0.004) < 3.0 * angle / (2 * math.pi) * period


def test_edges_placed_between_their_samples_are_those_of_no_digital_line():
    assert not digital(0.004 + np.arange(60) * 60.0 / 3810.3, RATE, 0.0)


def test_a_wandering_speed_is_seen_through_the_scatter_of_a_digital_line():
    true = 0.004 + np.arange(60) * 60.0 / 3810.3 + 4e-4 * np.sin(2 * math.pi * np.arange(60) / 30)
    marks = edges(lambda turn: true[turn])
    assert not clock_of(marks, 1.0 / RATE)[2]
    assert np.std(smoothed(marks, 1.0 / RATE) - true) < 0.6 * np.std(marks - true)


def test_turns_are_counted_past_lost_and_false_marks_and_along_a_speed_that_wanders():
    turns = np.arange(40.0)
    marks = 0.1 + turns * 0.02
    lost = np.delete(turns, [7, 8, 30])
    assert turns_of(marks[lost.astype(int)]) == pytest.approx(lost)
    false = np.insert(marks, 20, marks[19] + 0.011)
    assert np.delete(turns_of(false), 20) == pytest.approx(turns)
    slowing = 0.1 + 0.02 * turns * (1.0 + 0.002 * turns)  # no even spacing could count these
    assert turns_of(slowing) == pytest.approx(turns)
