import math

import numpy as np
import pytest

from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.effects.base_flexure import flexure, samples, stable_cut


@pytest.mark.parametrize("time_constant", [1e-6, 2e-4, 5e-3])
@pytest.mark.parametrize("frequency", [146.4, 900.0])
def test_amplitude_and_phase_of_a_first_order_lag(time_constant, frequency):
    rate, w = 12800.0, 2 * math.pi * frequency
    time = np.arange(20_000) / rate
    lagged = catalogue()["sensor_lag"].hooks["measure"](np.sin(w * time), w * np.cos(w * time), rate, time_constant)
    basis = np.column_stack([np.sin(w * time), np.cos(w * time)])[-5000:]
    a, b = np.linalg.lstsq(basis, lagged[-5000:], rcond=None)[0]
    # a cubic through values and rates misses a sine by (w h)^4 / 384
    error = 2 * (w / rate) ** 4 / 384 + 1e-9
    assert math.hypot(a, b) == pytest.approx(1 / math.hypot(1, w * time_constant), abs=error)
    error *= math.hypot(1, w * time_constant)
    assert math.atan2(b, a) == pytest.approx(-math.atan(w * time_constant), abs=error)


def test_a_constant_and_a_ramp_pass_as_they_must():
    hook = catalogue()["sensor_lag"].hooks["measure"]
    np.testing.assert_allclose(hook(np.full(50, 3.0), np.zeros(50), 1000.0, 0.01), 3.0, rtol=1e-13)
    time = np.arange(400) / 1000.0
    ramp = hook(time, np.ones(400), 1000.0, 0.01)
    np.testing.assert_allclose(ramp, time - 0.01 * (1 - np.exp(-time / 0.01)), atol=1e-14)


def test_record_of_a_cut_does_not_depend_on_the_sampling_rate():
    cut = stable_cut(10)
    model = flexure(sensor_lag={"time_constant": 2e-4})
    coarse = fast.simulate(model, cut, samples(cut, 12800.0), steps=200).channels["displacement"]
    fine = fast.simulate(model, cut, samples(cut, 128000.0), steps=200).channels["displacement"][::10]
    length = min(len(coarse), len(fine))
    np.testing.assert_allclose(coarse[:length], fine[:length], atol=2e-5 * np.abs(fine).max())
    plain = fast.simulate(flexure(), cut, samples(cut, 12800.0), steps=200).channels["displacement"]
    assert np.abs(coarse - plain).max() > 0.05 * np.abs(plain).max()
