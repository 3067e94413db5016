import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from testbed.engines import fast
from tests.effects.base_flexure import MASS, RPM, STIFFNESS, flexure, free, samples, turning_points

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


def located(force: float, travel: float, damping: float, x: float, times: np.ndarray) -> np.ndarray:
    """Displacement and velocity (2, times) of a release from x, by scipy from event to event of the ideal spring and slider.

    Scipy looks for events at the ends of its steps: one of 1/1000 of a period sees a breakaway just before a turning point.
    """
    longest = 2e-3 * math.pi * math.sqrt(MASS / STIFFNESS)
    stuck, side, start, state = True, 0.0, 0.0, np.array([x, 0.0, 0.0])  # x, v, deflection of the spring
    found = np.empty((2, times.size))

    def slope(t, y):
        pull = force * (y[2] / travel if stuck else side)
        return [y[1], (-damping * y[1] - STIFFNESS * y[0] - pull) / MASS, y[1] if stuck else 0.0]

    def breaks(t, y):
        return abs(y[2]) - travel

    def turns(t, y):
        return y[1]

    breaks.terminal = turns.terminal = True
    breaks.direction = 1.0
    while start < times[-1]:
        course = solve_ivp(slope, (start, times[-1] + 1e-12), state, events=breaks if stuck else turns, rtol=1e-12, atol=1e-16,
                           method="DOP853", dense_output=True, max_step=longest)
        here = (times >= start) & (times <= course.t[-1])
        found[:, here] = course.sol(times[here])[:2]
        start, state = course.t[-1], course.y[:, -1].copy()
        if stuck:
            side = math.copysign(1.0, state[2])
        else:
            state[1] = 0.0
        stuck = not stuck
    return found


@pytest.mark.parametrize(("force", "travel", "amplitude"),
                         [(2.0, 0.2e-6, 30e-6), (4.0, 5e-6, 30e-6), (0.3, 0.02e-6, 5e-6), (20.0, 1e-6, 25e-6)])
@pytest.mark.long
def test_a_free_flight_is_exact_whatever_the_steps(force, travel, amplitude):
    """Against scipy, which finds breakaways and turning points by its own root search: 1e-8 of the amplitude."""
    model = flexure(0.0032, dry_friction={"force": force, "presliding_displacement": travel})
    cut = free(amplitude, passes=10)
    recording = fast.simulate(model, cut, samples(cut, 12800.0), channels=("displacement", "velocity"), steps=6)
    x, v = located(force, travel, 2 * 0.0032 * math.sqrt(STIFFNESS * MASS), amplitude, recording.time)
    assert np.abs(np.diff(np.sign(v))).sum() > 50
    np.testing.assert_allclose(recording.channels["displacement"], x, atol=1e-8 * amplitude)
    np.testing.assert_allclose(recording.channels["velocity"], v, atol=1e-8 * np.abs(v).max())


@settings(max_examples=60, deadline=None)
@given(st.floats(0.01, 100.0), st.floats(0.02e-6, 20e-6), st.floats(0.1e-6, 200e-6))
@example(100.0, 0.02e-6, 0.1e-6)
def test_how_a_flight_is_cut_into_pitches_is_nothing_to_it(force, travel, amplitude):
    """The events of a free decay are its own; its energy falls, and what the accelerometer sees is what Newton's law says."""
    model = flexure(0.0032, dry_friction={"force": force, "presliding_displacement": travel})
    slow, found = free(amplitude, passes=2), []
    for cut in (slow, replace(slow, spindle_speed=23711 * RPM, ring_down_passes=16)):
        sampling = replace(samples(slow, 12800.0), count=480)
        found.append(fast.simulate(model, cut, sampling, channels=("displacement", "velocity", "acceleration")).channels)
    x, v, a = (found[0][name] for name in ("displacement", "velocity", "acceleration"))
    np.testing.assert_allclose(found[1]["displacement"], x, atol=1e-9 * amplitude)
    energy = 0.5 * STIFFNESS * x**2 + 0.5 * MASS * v**2
    held = np.abs(MASS * a + STIFFNESS * x + 2 * 0.0032 * math.sqrt(STIFFNESS * MASS) * v)
    assert held.max() <= force * (1 + 1e-9)
    stored = 0.5 * held * travel * held / force  # in the contact's spring, which gives it back
    assert np.all(np.diff(energy + stored) <= 1e-9 * energy[0])
