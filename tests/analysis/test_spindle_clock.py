"""The spindle's clock from marks as machines give them: edges of a digital line, lost marks, false ones."""

import math

import numpy as np
import pytest

from testbed.analysis.records.spindle_clock import clock_error, clock_of, digital, samples_to_rise, smoothed, turns_of
from testbed.recording import Recording

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


@pytest.mark.parametrize("seed", range(4))
def test_marks_of_a_noisy_threshold_are_steady_and_those_of_a_speed_that_varies_are_not(seed):
    random, turns, period = np.random.default_rng(seed), np.arange(40.0), 60.0 / 2910.0
    scatter = 3e-4 * period * random.standard_normal(turns.size)  # beyond what a constant speed is taken for at once
    true = 0.004 + turns * period
    found, anchor, steady = clock_of(true + scatter)
    assert steady
    angle, speed = clock_error(true + scatter, found, anchor, RATE)
    assert abs(found / period - 1.0) < 3.5 * speed
    assert abs(anchor - 0.004) < 3.5 * angle / (2 * math.pi) * period
    for course in (np.sin(2 * math.pi * turns / 11.3), np.sin(2 * math.pi * turns * 0.37), turns * (turns - 39.0) / 380.0,
                   np.cumsum(random.standard_normal(turns.size)) / 3.0):
        assert not clock_of(true + scatter + 1.5e-3 * period * course)[2]


def test_few_marks_that_scatter_tell_no_constant_speed():
    marks = 0.004 + np.arange(8.0) * 0.02 + 4e-5 * np.array([1, -1, 1, 1, -1, 0.5, -1, 1])
    assert not clock_of(marks)[2]


def placed(true, rise):
    """Times of the marks as a threshold halfway up an edge of `rise` samples is placed between the samples around it."""
    first = np.floor(true * RATE - rise)
    samples = first[:, None] + np.arange(np.ceil(2 * rise) + 4)
    level = np.clip((samples - true[:, None] * RATE) / rise + 0.5, 0.0, 1.0)
    above = np.argmax(level >= 0.5, axis=1)
    low, high = level[np.arange(len(true)), above - 1], level[np.arange(len(true)), above]
    return (samples[np.arange(len(true)), above - 1] + (0.5 - low) / (high - low)) / RATE


@pytest.mark.parametrize("rpm", (2910.3, 3050.0, 5219.7, 11890.7))
def test_edges_as_short_as_a_sample_are_steady_at_a_constant_speed_and_show_one_that_varies(rpm):
    turns, period = np.arange(60.0), 60.0 / rpm
    true = 0.004 + turns * period
    marks = placed(true, 1.0)
    assert np.std(marks - true) > 0.05 / RATE
    found, anchor, steady = clock_of(marks, rate=RATE)
    assert steady
    assert abs(found / period - 1.0) < 1e-5 and abs(anchor - 0.004) < 0.1 / RATE
    for course in (np.sin(2 * math.pi * turns / 11.3), turns * (turns - 59.0) / 870.0):
        assert not clock_of(placed(true + 0.6 / RATE * course, 1.0), rate=RATE)[2]


def test_marks_that_jitter_are_smoothed_and_those_of_a_fast_swing_are_kept():
    turns = np.arange(60.0)
    for course, kept in ((1e-3 * np.sin(2 * math.pi * turns / 23.3), False), (1e-4 * np.sin(2 * math.pi * turns * 0.37), True)):
        true = 0.004 + turns * 60.0 / 2910.3 + course
        marks = placed(true, 1.0)
        found = smoothed(marks, 1.0 / RATE, halfway=False)
        assert not clock_of(marks, rate=RATE)[2]
        if kept:
            assert np.array_equal(found, marks)
        else:
            assert np.std(np.diff(found - true)) < 0.6 * np.std(np.diff(marks - true))
            assert np.allclose(smoothed(true, 1.0 / RATE, halfway=False), true, atol=1e-3 / RATE)


@pytest.mark.parametrize("rise", (1.0, 2.0, 5.0, 12.0))
def test_how_long_an_edge_takes_is_seen_in_its_line_and_widens_the_angle_s_error(rise):
    period, rate = 60.0 / 1830.0, RATE
    time = np.arange(round(40 * period * rate)) / rate
    phase = (time - 0.004) % period * rate
    line = 5.0 * (np.clip(phase / rise, 0.0, 1.0) - np.clip((phase - 60.0) / rise, 0.0, 1.0))
    marks = 0.004 + np.arange(39) * period + 0.5 * rise / rate
    recording = Recording({"tachometer": line}, rate, {"tachometer": "V"}, "measured", marks=marks)
    found = samples_to_rise(recording)
    assert found == pytest.approx(rise, rel=0.05, abs=0.6)
    sharp, angle = (clock_error(marks, period, 0.004, rate, rise=one)[0] for one in (1.0, found))
    late = 2 * math.pi * (0.5 * rise / rate) / period  # of an edge that a filter delays
    assert angle == sharp if rise <= 2.0 else late < 2.0 * angle
    assert samples_to_rise(Recording({"displacement": line}, rate, {"displacement": "m"}, "measured", marks=marks)) == 1.0
