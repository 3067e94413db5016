import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from testbed.analysis.fit.effect_start import effect_parameters
from testbed.catalogue import catalogue
from testbed.cut import Sampling
from testbed.engines import fast
from tests.effects.base_flexure import FEED, FREQUENCY, MASS, ZETA, flexure, stable_cut

LENGTH = {"samples": 1000, "rate": 12800.0}  # of a record: Hz
MODE = {"mass_ratio": 0.5, "frequency": 480.0, "damping_ratio": 0.01, "participation": 0.6}


def receptance(w):
    """Motion at the sensor per force at the tool, sum of two modes."""
    w1, w2 = 2 * math.pi * FREQUENCY, 2 * math.pi * MODE["frequency"]
    first = 1 / (MASS * (w1**2 - w**2 + 2j * ZETA * w1 * w))
    m2 = MASS / MODE["mass_ratio"]
    return first + MODE["participation"] / (m2 * (w2**2 - w**2 + 2j * MODE["damping_ratio"] * w2 * w))


def test_receptance_at_the_harmonics_of_the_tooth_passing():
    """In the periodic motion the chip is that of a rigid tooth, so the force's Fourier coefficients are known."""
    settled, count = 400, 4096
    cut, model = stable_cut(settled + 1), flexure(second_mode=MODE)
    period, cutting = cut.tooth_passing_period(1), model.cutting
    recording = fast.simulate(model, cut, Sampling(count / period, count, settled * period), steps=300)
    harmonics = np.arange(1, 13)
    motion = np.fft.rfft(recording.channels["displacement"])[harmonics] / count
    points, weights = np.polynomial.legendre.leggauss(60)
    theta = 0.5 * cutting.engagement_angle * (points + 1)
    force = -cut.axial_depth_of_cut * FEED * np.sin(theta) * (
        cutting.tangential_coefficient * np.cos(theta) + cutting.normal_coefficient * np.sin(theta))
    weighted = 0.5 * cutting.engagement_angle * weights * force / (2 * math.pi)
    force = np.exp(-1j * np.outer(harmonics, theta)) @ weighted
    w = harmonics * cut.spindle_speed
    np.testing.assert_allclose(motion, force * receptance(w), atol=2e-6 * np.abs(motion).max())
    np.testing.assert_allclose(motion[:8], (force * receptance(w))[:8], rtol=1e-4)
    one_mode = 1 / (MASS * ((2 * math.pi * FREQUENCY) ** 2 - w**2))
    assert np.abs(motion[:8] / force[:8] / one_mode[:8] - 1).max() > 0.5  # the second mode is plain to see


def test_first_pass_against_a_direct_integration():
    """Rigid teeth left the first surface, so the first pass is an ordinary differential equation."""
    model, cut = flexure(second_mode=MODE), stable_cut(1)
    cutting = model.cutting
    w1, w2, m2 = 2 * math.pi * FREQUENCY, 2 * math.pi * MODE["frequency"], MASS / MODE["mass_ratio"]

    def right(t, y, on):
        x, v, q, u = y
        th = cut.spindle_speed * t
        coefficient = cutting.tangential_coefficient * math.cos(th) + cutting.normal_coefficient * math.sin(th)
        force = -on * cut.axial_depth_of_cut * coefficient * math.sin(th) * (FEED + x + q)
        return [v, force / MASS - 2 * ZETA * w1 * v - w1**2 * x,
                u, force / m2 - 2 * MODE["damping_ratio"] * w2 * u - w2**2 * q]

    exit_time, period = cutting.engagement_angle / cut.spindle_speed, cut.tooth_passing_period(1)
    first = solve_ivp(right, (0, exit_time), [0, 0, 0, 0], args=(1.0,), rtol=1e-11, atol=1e-16, method="DOP853")
    times = np.linspace(exit_time, 0.999 * period, 40)
    second = solve_ivp(right, (exit_time, period), first.y[:, -1], args=(0.0,), rtol=1e-11, atol=1e-16, method="DOP853",
                       t_eval=times)
    expected = second.y[0] + MODE["participation"] * second.y[2]
    recording = fast.simulate(model, cut, Sampling(39 / (times[-1] - times[0]), 40, times[0]), steps=200)
    assert np.abs(second.y[2]).max() > 1e-7
    np.testing.assert_allclose(recording.channels["displacement"], expected, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize(("quantity", "ratio"), [("force_x", 1.7), ("force_y", 1.0), ("force_y", 0.8)])
def test_dynamometer_reads_through_the_resonance(quantity, ratio):
    hook = catalogue()["second_mode"].hooks["measure"]
    mode = {**MODE, "transverse_ratio": ratio}
    rate, w, w2 = 51200.0, 2 * math.pi * 300.0, 2 * math.pi * MODE["frequency"] * (ratio if quantity == "force_y" else 1.0)
    time = np.arange(100_000) / rate
    true = np.sin(w * time)
    read = hook(true, true, quantity, rate, **mode)
    basis = np.column_stack([np.sin(w * time), np.cos(w * time)])[-20_000:]
    a, b = np.linalg.lstsq(basis, read[-20_000:], rcond=None)[0]
    through = w2**2 / (w2**2 - w**2 + 2j * MODE["damping_ratio"] * w2 * w)
    expected = 1 + MODE["participation"] * MODE["mass_ratio"] * (through - 1)
    assert complex(a, b) == pytest.approx(expected, rel=1e-3)
    np.testing.assert_array_equal(hook(time, time, "displacement", rate, **mode), time)


def test_what_only_force_y_shows_may_be_left_out_and_is_unknown_where_it_is_recorded():
    effect = catalogue()["second_mode"]
    cut, full = stable_cut(2), flexure(second_mode={**MODE, "transverse_ratio": 1.0})
    one, other = (fast.simulate(model, cut, Sampling(12800.0, 200)) for model in (flexure(second_mode=MODE), full))
    np.testing.assert_array_equal(one.channels["displacement"], other.channels["displacement"])
    names = {channels: {free.path for free in effect_parameters(effect, [SimpleNamespace(channels=channels, **LENGTH)])}
             for channels in (("displacement",), ("force_x", "force_y"))}
    assert names["force_x", "force_y"] - names["displacement",] == {"second_mode.transverse_ratio"}
