"""Frequency and damping against amplitude, against closed forms and a brute-force integration."""

import json
import math

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from testbed.analysis.comparison.amplitude import amplitude_dependence, course, free_decays
from testbed.analysis.comparison.compare_plots import by_amplitude
from testbed.analysis.fit.drift import drift_basis
from testbed.analysis.fit.observed import Observed
from testbed.analysis.records.segments import Segment
from testbed.analysis.report.constants import add_amplitude
from testbed.analysis.report.page import Page

FREQUENCY, RATE, START, NOISE = 147.0, 12800.0, 1e-4, 1e-6
OMEGA = 2 * math.pi * FREQUENCY


def decay(*, zeta=0.003, cubic=0.0, friction=0.0, quadratic=0.0, duration=0.6, noise=NOISE, seed=0):
    """A free decay with offset and white noise; cubic (1/(m^2 s^2)), friction (m/s^2), quadratic (1/m) over the mass."""

    def slope(_, state):
        x, v = state
        rub = friction * math.tanh(v / (1e-3 * START * OMEGA))
        return [v, -(OMEGA**2) * x - 2 * zeta * OMEGA * v - cubic * x**3 - rub - quadratic * v * abs(v)]

    time = np.arange(int(duration * RATE)) / RATE
    step = 2e-4 if friction else np.inf
    found = solve_ivp(slope, (0, duration), [START, 0.0], t_eval=time, rtol=1e-8, atol=1e-12, max_step=step)
    return found.y[0] + 3e-6 + noise * np.random.default_rng(seed).standard_normal(time.size)


def test_a_linear_structure_is_constant():
    found = amplitude_dependence(decay(), RATE)
    assert found.frequency_verdict == "constant" and found.damping_verdict == "constant"
    assert found.small_frequency == pytest.approx(FREQUENCY, rel=1e-5)
    assert found.viscous / OMEGA == pytest.approx(0.003, rel=0.01)


@pytest.mark.parametrize("share", [0.01, -0.004])
def test_a_cubic_spring_has_duffing_s_backbone(share):
    cubic = share * OMEGA**2 / START**2
    found = amplitude_dependence(decay(cubic=cubic), RATE)
    assert found.frequency_verdict == ("rises" if share > 0 else "falls") and found.damping_verdict == "constant"
    expected = FREQUENCY * 3 / 8 * cubic / OMEGA**2  # omega = omega_0 (1 + 3/8 alpha A^2 / omega_0^2)
    assert found.bend == pytest.approx(expected, rel=0.02)
    assert found.small_frequency == pytest.approx(FREQUENCY, rel=2e-5)


@pytest.mark.parametrize("zeta", [0.0, 0.001])
def test_dry_friction_drops_by_equal_steps(zeta):
    friction = 4e-3 * START * OMEGA**2
    found = amplitude_dependence(decay(zeta=zeta, friction=friction), RATE)
    assert found.damping_verdict == "dry friction" and found.frequency_verdict == "constant"
    assert found.friction == pytest.approx(2 * friction / (math.pi * OMEGA), rel=0.04)  # 4 F / k a cycle
    if zeta == 0.0:
        steps = np.diff(found.course.amplitude)
        assert steps.std() < 0.05 * abs(steps.mean())


def test_quadratic_damping_is_proportional_to_amplitude():
    found = amplitude_dependence(decay(zeta=0.002, quadratic=30.0), RATE)
    assert found.damping_verdict == "quadratic damping" and found.frequency_verdict == "constant"
    assert found.quadratic == pytest.approx(4 * 30.0 * OMEGA / (3 * math.pi), rel=0.03)
    assert found.viscous / OMEGA == pytest.approx(0.002, rel=0.05)


def test_noise_biases_neither_amplitude_nor_damping():
    time = np.arange(7680) / RATE
    clean = START * np.exp(-0.003 * OMEGA * time) * np.cos(OMEGA * time)
    random = np.random.default_rng(7)
    ratios, rates = [], []
    for _ in range(16):
        seen = course(clean + 5e-6 * random.standard_normal(time.size), RATE)
        last = seen.amplitude[7] / (START * math.exp(-0.003 * OMEGA * seen.time[7]))
        ratios.append(last)
        rates.append(-np.polyfit(seen.time[:8], np.log(seen.amplitude[:8]), 1)[0] / OMEGA)
    assert np.mean(ratios) == pytest.approx(1.0, abs=3.5 * np.std(ratios) / 4)
    assert np.mean(rates) == pytest.approx(0.003, abs=3.5 * np.std(rates) / 4)


def test_false_alarms_are_as_rare_as_promised():
    time = np.arange(7680) / RATE
    random = np.random.default_rng(11)
    alarms = np.zeros(2)
    for phase in range(40):
        clean = START * np.exp(-0.003 * OMEGA * time) * np.cos(OMEGA * time + phase)
        found = amplitude_dependence(clean + NOISE * random.standard_normal(time.size), RATE)
        alarms += [found.frequency_verdict != "constant", found.damping_verdict != "constant"]
    assert (alarms <= 6).all()  # 2 expected of 40 at the most


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "values", [np.zeros(4000), np.ones(300), np.ones(1), 1e-6 * np.random.default_rng(0).standard_normal(8000)]
)
def test_what_is_no_decay_is_refused(values):
    with pytest.raises(ValueError):
        amplitude_dependence(values, RATE)


def observed(values, kind, segments, channel="displacement"):
    return Observed("r", kind, (channel,), values[None], RATE, 0.0, np.array([NOISE]), "idle", drift_basis(len(values)),
                    segments, (kind,))


def test_only_the_free_part_of_a_moving_channel_is_used():
    values = decay(cubic=0.01 * OMEGA**2 / START**2)
    end = len(values) / RATE
    before = np.concatenate([1e-4 * np.sin(900 * np.arange(3000) / RATE), values])
    shift = 3000 / RATE
    segments = (Segment("steady", 0.0, shift), Segment("ring-down", shift, shift + end))
    (found,) = free_decays([observed(before, "ring-down", segments)])
    assert found.frequency_verdict == "rises" and found.name == "r" and found.unit == "m"
    assert free_decays([observed(values, "excited", ())]) == ()
    assert free_decays([observed(values, "cut", (Segment("ring-down", 0, end),), "force_x")]) == ()


@pytest.mark.parametrize(("channels", "units", "said", "factors"), [
    (("displacement",), {"displacement": "m"}, "µm", (1e6,)), (("displacement",), {"displacement": "V"}, "V", (1.0,)),
    (("displacement", "velocity"), {"displacement": "m", "velocity": "m/s"}, "µm, mm/s", (1e6, 1e3))])
def test_each_amplitude_is_drawn_in_its_channel_s_own_unit(channels, units, said, factors):
    decays = [amplitude_dependence(decay(), RATE, channel, channel) for channel in channels]
    figure = Figure()
    by_amplitude(figure, decays, units)
    left = figure.axes[0]
    assert left.get_xlabel() == f"amplitude [{said}]"
    for drawn, one, factor in zip(left.containers, decays, factors, strict=True):
        assert drawn.lines[0].get_xdata() == pytest.approx(one.amplitude * factor)
    page = Page("decays")
    add_amplitude(page, decays, units)
    assert json.dumps(f"amplitude [{said}]") in page.html()
