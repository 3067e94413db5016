import numpy as np
import pytest
from base_flexure import STIFFNESS, flexure, free, samples, turning_points

from testbed.engines import fast

Z_C = 0.2e-6


def friction(force: float, damping_ratio: float = 0.0):
    return flexure(damping_ratio, dry_friction={"force": force, "presliding_displacement": Z_C})


@pytest.mark.parametrize("force", [1.0, 4.0])
def test_amplitude_falls_in_a_straight_line(force):
    """Half a cycle takes X1 - X2 = 2 F / k (1 - 2 z_c / (X1 + X2)): energy, the elastic part given back."""
    cut = free(60e-6, passes=14)
    recording = fast.simulate(friction(force), cut, samples(cut, 400e3), channels=("displacement", "velocity"),
                              steps=600)
    _, x = turning_points(recording.time, recording.channels["displacement"], recording.channels["velocity"])
    amplitudes = np.abs(x)
    amplitudes = amplitudes[amplitudes > 6 * force / STIFFNESS]
    assert len(amplitudes) > 10
    drop = -np.diff(amplitudes)[1:]  # the first swing starts with the contact relaxed
    expected = 2 * force / STIFFNESS * (1 - 2 * Z_C / (amplitudes[1:-1] + amplitudes[2:]))
    np.testing.assert_allclose(drop, expected, rtol=2e-3)
    assert np.mean(drop) == pytest.approx(np.mean(expected), rel=3e-4)


def test_load_below_the_friction_force_is_held_without_creep():
    force = 4.0
    released = 0.5 * force / STIFFNESS  # the spring pulls with half the friction force
    cut = free(released, passes=200)
    recording = fast.simulate(friction(force, 0.05), cut, samples(cut, 2000.0))
    x = recording.channels["displacement"]
    contact = force / Z_C
    held = released * contact / (STIFFNESS + contact)
    assert np.ptp(x) > 0.01 * released  # it did move before it came to rest
    np.testing.assert_allclose(x[-1000:], held, rtol=3e-5)
    assert np.ptp(x[-1000:]) < 1e-6 * held


def test_ring_down_stops_away_from_zero_within_the_band():
    force = 4.0
    cut = free(21.3e-6, passes=100)
    recording = fast.simulate(friction(force, 0.02), cut, samples(cut, 12800.0))
    end = recording.channels["displacement"][-2000:]
    assert np.ptp(end) < 1e-9
    assert abs(np.mean(end)) <= force / STIFFNESS
    assert abs(np.mean(end)) > 0.02 * force / STIFFNESS
