"""What a sensor's noise is where a record is all cut: a transient that has not died is motion, hum is not."""

from __future__ import annotations

import numpy as np
import pytest

from testbed.analysis.records.noise import noise_floor
from testbed.analysis.records.segments import Segment
from testbed.recording import Recording

RATE, TURN, TURNS = 12800.0, 820.37, 10  # 1/s, samples, revolutions
NOISE = 0.3e-6  # m


def _steady(change: float, size: float, turns_of: float = 3.7) -> Recording:
    """A cut's periodic motion, beside it a vibration whose size (m) grows by e**change in a revolution, and noise."""
    turns = np.arange(int(TURNS * TURN) + 6) / TURN
    values = 30e-6 * np.sin(2 * np.pi * 3 * turns) + 9e-6 * np.sin(2 * np.pi * 6 * turns)
    values += size * np.exp(change * turns) * np.cos(2 * np.pi * turns_of * turns)
    values += NOISE * np.random.default_rng(3).standard_normal(len(turns))
    marks = (np.arange(TURNS) + 0.3) * TURN / RATE
    return Recording({"displacement": values}, RATE, {"displacement": "m"}, "measured", marks=marks)


def _noise(recording: Recording) -> float:
    found = noise_floor(recording, (Segment("steady", 0.0, len(recording) / RATE),))
    assert found.basis == "repeated periods"
    return found.rms / NOISE


@pytest.mark.parametrize("change", [-0.1, -0.02, 0.05])
def test_a_transient_that_has_not_died_is_not_taken_for_noise(change: float) -> None:
    assert _noise(_steady(change, 4e-6)) == pytest.approx(1.0, abs=0.03)


def test_hum_counts_as_noise_faint_or_loud() -> None:
    for size in (1.0, 10.0):
        apart = 2.0 * abs(np.sin(np.pi * 3.7))  # amplitude of the change from one revolution to the next
        least = np.hypot(1.0, size * apart / 2.0)  # its rms over sqrt(2); between the samples it is read somewhat louder
        assert least < _noise(_steady(0.0, size * NOISE)) < 1.2 * least


def test_without_a_transient_the_noise_is_read_as_ever() -> None:
    assert _noise(_steady(0.0, 0.0)) == pytest.approx(1.0, abs=0.03)


@pytest.mark.filterwarnings("error")
def test_a_revolution_of_few_samples_tells_a_noise_all_the_same() -> None:
    values = np.tile([0.0, 30e-6, 10e-6, -20e-6], 200) + NOISE * np.random.default_rng(4).standard_normal(800)
    marks = (np.arange(200) + 0.3) * 4.0 / RATE
    recording = Recording({"displacement": values}, RATE, {"displacement": "m"}, "measured", marks=marks)
    assert _noise(recording) == pytest.approx(1.0, abs=0.1)
