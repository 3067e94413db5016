"""Three modes: the receptance is their sum, in the cut, under a hammer, and on a dynamometer."""

import math

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from testbed.catalogue import catalogue
from testbed.cut import Sampling
from testbed.engines import fast, predict
from tests.effects.base_flexure import FEED, FREQUENCY, MASS, ZETA, flexure, stable_cut

SECOND = {"mass_ratio": 0.5, "frequency": 480.0, "damping_ratio": 0.01, "participation": 0.6}
THIRD = {"mass_ratio": 0.3, "frequency": 790.0, "damping_ratio": 0.015, "participation": -0.8}
MODEL = flexure(second_mode=SECOND, third_mode=THIRD)
MODES = [(MASS, FREQUENCY, ZETA, 1.0),
         *((MASS / one["mass_ratio"], one["frequency"], one["damping_ratio"], one["participation"]) for one in (SECOND, THIRD))]


def receptance(w):
    """Motion at the sensor per force at the tool, sum of three modes."""
    return sum(p / (m * ((2 * math.pi * f) ** 2 - w**2 + 2j * z * 2 * math.pi * f * w)) for m, f, z, p in MODES)


def test_the_law_is_the_second_modes_and_is_written_once():
    second, third = (catalogue()[name] for name in ("second_mode", "third_mode"))
    assert set(second.hooks) == set(third.hooks) and third.requires == ("second_mode",)
    assert [one.name for one in second.parameters] == [one.name for one in third.parameters]
    for name, hook in third.hooks.items():
        assert hook.__code__.co_filename == str(second.path), name
    alone, other = (fast.simulate(flexure(**{name: THIRD}), stable_cut(8), Sampling(12800.0, 1500))
                    for name in ("second_mode", "third_mode"))
    np.testing.assert_array_equal(alone.channels["displacement"], other.channels["displacement"])


def test_receptance_at_the_harmonics_of_the_tooth_passing():
    """In the periodic motion the chip is that of a rigid tooth, so the force's Fourier coefficients are known."""
    settled, count = 400, 4096
    cut = stable_cut(settled + 1)
    period, cutting = cut.tooth_passing_period(1), MODEL.cutting
    recording = fast.simulate(MODEL, cut, Sampling(count / period, count, settled * period), steps=300)
    harmonics = np.arange(1, 15)
    motion = np.fft.rfft(recording.channels["displacement"])[harmonics] / count
    points, weights = np.polynomial.legendre.leggauss(60)
    theta = 0.5 * cutting.engagement_angle * (points + 1)
    force = -cut.axial_depth_of_cut * FEED * np.sin(theta) * (
        cutting.tangential_coefficient * np.cos(theta) + cutting.normal_coefficient * np.sin(theta))
    force = np.exp(-1j * np.outer(harmonics, theta)) @ (0.5 * cutting.engagement_angle * weights * force / (2 * math.pi))
    expected = force * receptance(harmonics * cut.spindle_speed)
    np.testing.assert_allclose(motion, expected, atol=2e-6 * np.abs(motion).max())
    assert np.abs(motion[11:13] / expected[11:13] - 1).max() < 2e-3  # beside the third mode, 762 and 825 Hz


def test_a_hammers_blow_against_scipy():
    """Three oscillators side by side, forced by a pulse a millisecond long, against `lsim` with its own matrices."""
    rate, count, finer = 20480.0, 3000, 16
    fine = np.arange(count * finer) / (rate * finer)
    pulse = 500.0 * np.sin(math.pi * np.clip(fine, 0, 2e-3) / 2e-3) ** 2
    force = pulse[::finer]
    found = predict.predict_driven([MODEL], [(0.0, 0.0)], force, rate, ("displacement",))[0, 0]
    A, B, C = np.zeros((6, 6)), np.zeros((6, 1)), np.zeros((1, 6))
    for k, (m, f, z, p) in enumerate(MODES):
        w = 2 * math.pi * f
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0, 1], [-w * w, -2 * z * w]]
        B[2 * k + 1, 0], C[0, 2 * k] = 1 / m, p
    expected = lsim(StateSpace(A, B, C, 0), pulse, fine)[1][::finer]  # straight lines, so sixteen times as many
    np.testing.assert_allclose(found, expected, atol=5e-5 * np.abs(expected).max())  # the cubic between samples: 1.4e-5
    without = predict.predict_driven([MODEL.without_effect("third_mode")], [(0.0, 0.0)], force, rate, ("displacement",))[0, 0]
    assert np.abs(found - without).max() > 0.01 * np.abs(expected).max()


def test_a_dynamometer_reads_the_inertia_forces_of_all_modes_added_up():
    """Not one mode's reading filtered by the other: F + sum of p r (H - 1) F, in either order of the hooks."""
    from testbed.engines.measure import measured_channels

    rate, w = 51200.0, 2 * math.pi * 300.0
    time = np.arange(60_000) / rate
    read = measured_channels(MODEL, catalogue(), {"force_x": np.sin(w * time)}, ("force_x",), Sampling(rate, time.size))
    basis = np.column_stack([np.sin(w * time), np.cos(w * time)])[-20_000:]
    a, b = np.linalg.lstsq(basis, read["force_x"][-20_000:], rcond=None)[0]
    expected = 1.0
    for one in (SECOND, THIRD):
        own = 2 * math.pi * one["frequency"]
        through = own**2 / (own**2 - w**2 + 2j * one["damping_ratio"] * own * w)
        expected += one["participation"] * one["mass_ratio"] * (through - 1)
    assert complex(a, b) == pytest.approx(expected, rel=1e-3)
