import math

import numpy as np
import pytest

from testbed.engines import fast
from tests.effects.base_flexure import flexure, samples, stable_cut

LINE = {"amplitude": 3e-6, "frequency": 50.0, "phase": 0.5}
CHANNELS = ("displacement", "velocity", "acceleration", "force_x")


def added(**effects):
    cut = stable_cut(20, idle_passes=10)
    with_line = fast.simulate(flexure(**effects), cut, samples(cut, 12800.0), channels=CHANNELS)
    without = fast.simulate(flexure(), cut, samples(cut, 12800.0), channels=CHANNELS)
    return with_line.time, {name: with_line.channels[name] - without.channels[name] for name in CHANNELS}


def test_line_and_its_derivatives_are_added_and_the_cut_is_left_alone():
    time, line = added(ambient_vibration=LINE)
    w = 2 * math.pi * LINE["frequency"]
    phase = w * time + LINE["phase"]
    np.testing.assert_allclose(line["displacement"], 3e-6 * np.sin(phase), atol=1e-15)
    np.testing.assert_allclose(line["velocity"], 3e-6 * w * np.cos(phase), atol=1e-12)
    np.testing.assert_allclose(line["acceleration"], -3e-6 * w**2 * np.sin(phase), atol=1e-9)
    np.testing.assert_array_equal(line["force_x"], 0.0)


def test_a_slow_sensor_lags_the_line_too():
    time_constant = 2e-3
    cut = stable_cut(0, idle_passes=200)
    model = flexure(ambient_vibration=LINE, sensor_lag={"time_constant": time_constant})
    recording = fast.simulate(model, cut, samples(cut, 12800.0))
    w = 2 * math.pi * LINE["frequency"]
    basis = np.column_stack([np.sin(w * recording.time + 0.5), np.cos(w * recording.time + 0.5)])[2000:]
    a, b = np.linalg.lstsq(basis, recording.channels["displacement"][2000:], rcond=None)[0]
    assert complex(a, b) / 3e-6 == pytest.approx(1 / (1 + 1j * w * time_constant), rel=1e-6)
