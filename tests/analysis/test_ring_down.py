"""Free decay and impact tests: closed forms, intervals, and a real hammer test where it is at hand."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from testbed.analysis.multipliers.ring_down import fit_receptance, fit_ring_down, receptance, ring_down
from testbed.recording import Recording

RATE = 12800.0


@pytest.fixture
def measurements():
    given = os.environ.get("TESTBED_MEASUREMENTS")
    folder = Path(given) if given else Path(__file__).resolve().parents[3] / "shared" / "measurements"
    if not (folder / "tap_test").is_dir():
        pytest.skip("no measured hammer test here: set TESTBED_MEASUREMENTS to the folder that holds tap_test")
    return folder


def decay(modes, duration=0.8, noise=0.0, offset=0.0, slope=0.0, seed=0, order=0):
    """Sum of modes (Hz, zeta, amplitude, phase), differentiated `order` times."""
    time = np.arange(int(duration * RATE)) / RATE
    data = offset + slope * time
    for frequency, zeta, amplitude, phase in modes:
        root = 2 * math.pi * frequency * (-zeta + 1j * math.sqrt(1 - zeta**2))
        data = data + (amplitude * root**order * np.exp(root * time + 1j * phase)).real
    return data + noise * np.random.default_rng(seed).standard_normal(time.size)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_one_mode_is_found_exactly_in_displacement_velocity_and_acceleration(order):
    found = fit_ring_down(decay([(146.6, 0.0032, 5e-5, 0.7)], order=order), RATE)
    assert found.natural_frequency[0] == pytest.approx(146.6, rel=1e-7)
    assert found.damping_ratio[0] == pytest.approx(0.0032, rel=1e-5)
    assert found.amplitude[0] == pytest.approx(5e-5 * (2 * math.pi * 146.6) ** order, rel=1e-4)


def test_offset_and_slope_do_not_matter():
    found = fit_ring_down(decay([(146.6, 0.0032, 5e-5, 0.7)], offset=3e-4, slope=1e-4), RATE)
    assert found.natural_frequency[0] == pytest.approx(146.6, rel=1e-7)
    assert found.damping_ratio[0] == pytest.approx(0.0032, rel=1e-5)


def test_intervals_hold_the_truth_about_nineteen_times_in_twenty():
    inside = np.zeros(2)
    for seed in range(60):
        found = fit_ring_down(decay([(146.6, 0.01, 2e-5, 0.3)], 0.4, noise=5e-7, offset=1e-5, seed=seed), RATE)
        inside += [found.natural_frequency_low[0] < 146.6 < found.natural_frequency_high[0],
                   found.damping_ratio_low[0] < 0.01 < found.damping_ratio_high[0]]
        assert found.damping_ratio_high[0] - found.damping_ratio_low[0] < 0.002
    assert np.all(inside >= 51)
    assert found.noise == pytest.approx(5e-7, rel=0.05)


def test_two_modes_are_told_apart_strongest_first():
    modes = [(310.0, 0.008, 1e-5, 1.0), (146.6, 0.0032, 4e-5, 0.2)]
    found = fit_ring_down(decay(modes, noise=1e-7), RATE, n_modes=2)
    np.testing.assert_allclose(found.natural_frequency, [146.6, 310.0], rtol=1e-4)
    np.testing.assert_allclose(found.damping_ratio, [0.0032, 0.008], rtol=0.03)


def test_window_ends_where_only_noise_is_left():
    found = fit_ring_down(decay([(146.6, 0.03, 2e-5, 0.0)], 3.0, noise=5e-7), RATE)
    assert found.stop < 1.0
    assert found.damping_ratio[0] == pytest.approx(0.03, rel=0.05)


def test_recording_is_read_from_its_exit():
    quiet = np.zeros(1000)
    data = np.concatenate([quiet, decay([(146.6, 0.0032, 5e-5, 0.7)])])
    record = Recording({"displacement": data}, RATE, {"displacement": "m"}, "synthetic", start=2.0,
                       conditions={"exit_time": 2.0 + 1000 / RATE})
    found = ring_down(record)
    assert found.start == pytest.approx(2.0 + 1000 / RATE)
    assert found.natural_frequency[0] == pytest.approx(146.6, rel=1e-6)
    with pytest.raises(ValueError, match="no samples"):
        ring_down(record, start=50.0)


@pytest.mark.parametrize("data", [np.zeros(2000), np.full(2000, np.nan), np.ones(20)])
def test_what_is_no_decay_is_refused(data):
    with pytest.raises(ValueError, match=r"no motion|too few"):
        fit_ring_down(data, RATE)


def test_receptance_of_a_known_oscillator_gives_its_mode_and_mass():
    frequency = np.arange(2.0, 2000.0)
    mass, natural, zeta = 2.0, 700.0, 0.02
    response = 1 / (mass * (2 * math.pi) ** 2 * (natural**2 - frequency**2 + 2j * zeta * natural * frequency)) + 2e-9
    found = fit_receptance(frequency, response)
    assert found.natural_frequency == pytest.approx(natural, rel=1e-6)
    assert found.damping_ratio == pytest.approx(zeta, rel=1e-5)
    assert found.modal_mass == pytest.approx(mass, rel=1e-5)
    with pytest.raises(ValueError, match="too few"):
        fit_receptance(frequency, response, (700.0, 703.0))


def test_real_hammer_test_agrees_with_its_own_frequency_response(measurements):
    time, force, acceleration = np.loadtxt(measurements / "tap_test" / "impact_Point1_time.txt").T
    from_time = fit_receptance(*receptance(force, acceleration, 1.0 / np.mean(np.diff(time))))
    frequency, real, imaginary = np.loadtxt(measurements / "tap_test" / "FRF_Point_1.txt").T[:, 1:]
    from_response = fit_receptance(frequency, real + 1j * imaginary)
    for found in (from_time, from_response):
        assert found.natural_frequency == pytest.approx(1067.0, abs=4.0)
        assert found.damping_ratio == pytest.approx(0.034, abs=0.002)
    assert from_time.natural_frequency == pytest.approx(from_response.natural_frequency, abs=1.0)
    assert from_time.damping_ratio == pytest.approx(from_response.damping_ratio, rel=0.02)
    assert from_time.modal_mass == pytest.approx(from_response.modal_mass, rel=0.03)
