"""Estimates of the dimension on motions whose number of modes is known."""

import numpy as np
import pytest

from testbed.analysis.multipliers.embedding_dimension import (
    delay_states,
    false_nearest_neighbours,
    first_minimum,
    mutual_information,
    rank_growth,
    singular_values,
)
from testbed.recording import Recording

PERIOD, RATE = 1.0, 480.0
MULTIPLIERS = (0.8, -0.7, 0.5)


def transient(noise: float = 0.0, periods: int = 40, modes: int = 3) -> Recording:
    """A periodic motion plus `modes` modes that change by their multiplier from period to period."""
    time = np.arange(int(periods * RATE) + 8) / RATE
    turn = np.floor(time + 1e-9).astype(int)
    signal = 3e-5 * np.sin(2 * np.pi * time)
    for k, mu in enumerate(MULTIPLIERS[:modes]):
        # half an odd number of waves a period where the multiplier is below 0 joins the pieces smoothly
        waves = k + 1 if mu > 0 else k + 0.5
        signal = signal + 1e-5 * np.abs(mu) ** time * np.cos(2 * np.pi * waves * time)
    assert turn[-1] >= periods
    signal = signal + noise * np.random.default_rng(5).standard_normal(signal.size)
    return Recording({"displacement": signal}, RATE, {"displacement": "m"}, "synthetic", marks=np.arange(periods + 1) * PERIOD)


def test_rank_stops_at_the_number_of_modes():
    assert rank_growth(transient(), range(1, 9), periods=20, tolerance=1e-4).tolist() == [1, 2, 3, 3, 3, 3, 3, 3]
    assert rank_growth(transient(modes=1), range(1, 5), periods=20, tolerance=1e-4).tolist() == [1, 1, 1, 1]


def test_noise_hides_no_strong_mode_and_adds_none():
    for modes in (1, 2, 3):
        found = singular_values(transient(3e-8, modes=modes), 16, periods=20)
        assert found.rank == modes and found.values[0] == 1.0
    assert singular_values(transient(0.0), 16, periods=20, noise=3e-8).rank == 3
    loud = singular_values(transient(5e-6), 16, periods=20, noise=5e-6)
    assert loud.rank < 3  # the weakest mode drowns, and the count says so


def test_states_are_about_where_they_settle():
    states = delay_states(transient(), 4)
    assert states.shape == (40, 4) and np.abs(states[-5:]).max() < 0.01 * np.abs(states[0]).max()
    with pytest.raises(ValueError, match="at least 4"):
        delay_states(transient(), 4, stop=2.5)


def test_false_neighbours_unfold_a_circle_in_two_dimensions():
    time = np.arange(3000) * 0.0173
    circle = Recording({"displacement": np.sin(2 * np.pi * time)}, 1 / 0.0173, {"displacement": "m"}, "synthetic")
    found = false_nearest_neighbours(circle, (1, 2, 3), lag=14)
    assert found[0] > 0.5 and found[1] < 0.02 and found[2] < 0.02
    noise = Recording({"displacement": np.random.default_rng(1).standard_normal(400)}, 1.0, {"displacement": "m"}, "synthetic")
    assert false_nearest_neighbours(noise, (2, 4)).min() > 0.1
    with pytest.raises(ValueError, match="too few"):
        false_nearest_neighbours(noise, (3,), lag=200)


def test_mutual_information_tells_dependence():
    random = np.random.default_rng(2)
    time = np.arange(8000) / 100.0
    sine = np.sin(2 * np.pi * time) + 0.3 * random.standard_normal(time.size)
    recording = Recording({"displacement": sine}, 100.0, {"displacement": "m"}, "synthetic")
    eighth, quarter, half = mutual_information(recording, (12, 25, 50))
    assert half > 1.05 * quarter and half > 0.5 and eighth > 0.2
    alone = Recording({"displacement": random.standard_normal(8000)}, 1.0, {"displacement": "m"}, "synthetic")
    assert mutual_information(alone, (5,))[0] < 0.1
    with pytest.raises(ValueError, match="too long"):
        mutual_information(alone, (5000,))


def test_first_minimum_is_inside():
    assert first_minimum(np.array([3.0, 1.0, 2.0, 0.0])) == 1
    assert first_minimum(np.array([3.0, 2.0, 1.0])) is None
