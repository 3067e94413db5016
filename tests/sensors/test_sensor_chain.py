"""The chain of a simulated measurement."""

import math
import pickle

import numpy as np
import pytest

from testbed.recording import Recording
from testbed.sensors.chain import ChannelSensor, SensorChain, shifted_marks


def recording(samples=20_000, rate=10_000.0):
    time = np.arange(samples) / rate
    return Recording({"displacement": 1e-4 * np.sin(900 * time)}, rate, {"displacement": "m"}, "predicted",
                     marks=np.arange(0, samples / rate, 0.02))


def measured(sensor, **chain):
    return SensorChain({"displacement": sensor}, **chain).apply(recording(), np.random.default_rng(1))


def error(sensor):
    return measured(sensor).channels["displacement"] - recording().channels["displacement"]


def test_a_perfect_chain_changes_nothing_but_the_origin():
    found = measured(ChannelSensor())
    assert found.origin == "synthetic" and np.array_equal(error(ChannelSensor()), np.zeros(20_000))
    assert np.array_equal(found.marks, recording().marks)


def test_noise_is_white_and_of_the_stated_rms():
    noise = error(ChannelSensor(noise=2e-6))
    assert np.std(noise) == pytest.approx(2e-6, rel=0.03)
    assert abs(np.mean(noise[1:] * noise[:-1])) < 0.03 * np.var(noise)


def test_quantisation_is_to_whole_counts_and_half_a_count_wrong_at_most():
    sensor = ChannelSensor(bits=8, full_scale=1.28e-3)
    values = measured(sensor).channels["displacement"]
    assert sensor.step == pytest.approx(1e-5)
    assert np.allclose(values / sensor.step, np.rint(values / sensor.step), atol=1e-9)
    assert 0.45 * sensor.step < np.max(np.abs(error(sensor))) <= 0.5 * sensor.step * (1 + 1e-9)


def test_what_is_out_of_range_is_clipped():
    values = measured(ChannelSensor(bits=12, full_scale=5e-5)).channels["displacement"]
    assert np.max(values) == pytest.approx(5e-5, rel=1e-3) and np.min(values) == -np.max(values)


def test_offset_and_drift():
    found = error(ChannelSensor(offset=3e-6, drift=1e-6))
    assert found[0] == pytest.approx(3e-6) and found[10_000] - found[0] == pytest.approx(1e-6)


def test_a_nan_stays_a_nan():
    sensor = ChannelSensor(noise=1e-6, bits=16, full_scale=1e-3)
    values = sensor.apply(np.array([0.0, np.nan]), np.array([0.0, 1.0]), np.random.default_rng(1))
    assert np.isfinite(values[0]) and np.isnan(values[1])


def test_marks_turn_by_the_angle_at_each_revolutions_own_speed():
    marks = np.array([0.0, 0.02, 0.05, 0.07])
    assert shifted_marks(marks, math.pi) == pytest.approx([0.01, 0.035, 0.06, 0.08])
    assert measured(ChannelSensor(), mark_angle=math.pi / 2).marks[3] == pytest.approx(0.065)
    jitter = measured(ChannelSensor(), mark_jitter=1e-5).marks - recording().marks
    assert 5e-6 < np.std(jitter) < 2e-5


def test_the_same_generator_gives_the_same_samples():
    sensor = ChannelSensor(noise=1e-6, bits=16, full_scale=1e-3)
    one, other = measured(sensor), measured(sensor)
    assert np.array_equal(one.channels["displacement"], other.channels["displacement"])
    assert np.std(error(sensor)) > 5e-7


def test_a_chain_travels_between_processes():
    chain = SensorChain({"velocity": ChannelSensor(noise=1e-3)}, mark_angle=0.5)
    assert pickle.loads(pickle.dumps(chain)) == chain


@pytest.mark.parametrize("given", [{"noise": -1.0}, {"bits": 1, "full_scale": 1.0}, {"bits": 16}, {"bits": 40},
                                   {"offset": math.nan}, {"bits": 16, "full_scale": -1.0}])
def test_impossible_sensors(given):
    with pytest.raises(ValueError):
        ChannelSensor(**given)


def test_a_channel_that_was_not_simulated():
    with pytest.raises(KeyError):
        SensorChain({"velocity": ChannelSensor()}).apply(recording(), np.random.default_rng(1))
