import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipk

from testbed.engines import fast
from tests.effects.base_flexure import FREQUENCY, STIFFNESS, flexure, free, samples, stable_cut


def backbone(coefficient: float, amplitude: float) -> float:
    """Frequency (Hz) of the free, undamped Duffing oscillator (complete elliptic integral)."""
    share = coefficient * amplitude**2 / STIFFNESS
    return FREQUENCY * math.pi * math.sqrt(1 + share) / (2 * ellipk(share / (2 * (1 + share))))


def ringing_frequency(recording) -> float:
    """Frequency (Hz) of a free vibration, from its upward crossings of zero."""
    x, time = recording.channels["displacement"], recording.time
    k = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossings = time[k] - x[k] * (time[k + 1] - time[k]) / (x[k + 1] - x[k])
    return (len(crossings) - 1) / (crossings[-1] - crossings[0])


@pytest.mark.parametrize("coefficient", [5e13, 6e14, -5e13, -3e14])
def test_ring_down_rings_at_the_backbone_frequency(coefficient):
    amplitude = 50e-6
    cut = free(amplitude)
    recording = fast.simulate(flexure(0.0, cubic_stiffness={"coefficient": coefficient}), cut, samples(cut, 200e3),
                              steps=200)
    frequency = ringing_frequency(recording)
    assert frequency == pytest.approx(backbone(coefficient, amplitude), rel=1e-6)
    assert (frequency > FREQUENCY) == (coefficient > 0)


@pytest.mark.parametrize(("share", "amplitude"), [(0.5, 2e-4), (1.0, 2e-4), (4.0, 2e-4), (1.0, 5e-5)])
def test_the_step_chosen_follows_the_stiffness_that_the_motion_meets(share, amplitude):
    """k3 x^2 from half of k to five times it, in a cut: right to 1e-4 of the peak without a given step."""
    model = flexure(cubic_stiffness={"coefficient": share * STIFFNESS / amplitude**2})
    cut = stable_cut(8, initial_displacement=amplitude, ring_down_passes=4)
    chosen, fine = (fast.simulate(model, cut, samples(cut, 20e3), steps=steps).channels["displacement"]
                    for steps in (None, 1200))
    assert np.abs(chosen - fine).max() < 1e-4 * np.abs(fine).max()
    assert np.abs(fine - fast.simulate(flexure(), cut, samples(cut, 20e3)).channels["displacement"]).max() > 0.1 * amplitude


def test_another_exponent_rings_at_its_own_backbone():
    """F = -k5 x^5: the period is 4 times the integral of dx / v over a quarter of the orbit, x = X sin(u)."""
    amplitude, coefficient, reference = 50e-6, 5e14, 3e-5
    share = coefficient / reference**2 * amplitude**4 / (3 * STIFFNESS)
    quarter = quad(lambda u: 1 / math.sqrt(1 + share * (1 + math.sin(u) ** 2 + math.sin(u) ** 4)), 0.0, math.pi / 2)[0]
    cut = free(amplitude)
    law = {"coefficient": coefficient, "exponent": 5.0, "reference_displacement": reference}
    recording = fast.simulate(flexure(0.0, cubic_stiffness=law), cut, samples(cut, 200e3), steps=300)
    frequency = ringing_frequency(recording)
    assert frequency == pytest.approx(FREQUENCY * math.pi / (2 * quarter), rel=1e-6) and frequency > 1.05 * FREQUENCY
