import math

import numpy as np
import pytest
from base_flexure import FREQUENCY, STIFFNESS, flexure, free, samples
from scipy.special import ellipk

from testbed.engines import fast


def backbone(coefficient: float, amplitude: float) -> float:
    """Frequency (Hz) of the free, undamped Duffing oscillator (complete elliptic integral)."""
    share = coefficient * amplitude**2 / STIFFNESS
    return FREQUENCY * math.pi * math.sqrt(1 + share) / (2 * ellipk(share / (2 * (1 + share))))


@pytest.mark.parametrize("coefficient", [5e13, 6e14, -5e13, -3e14])
def test_ring_down_rings_at_the_backbone_frequency(coefficient):
    amplitude = 50e-6
    cut = free(amplitude)
    recording = fast.simulate(flexure(0.0, cubic_stiffness={"coefficient": coefficient}), cut, samples(cut, 200e3),
                              steps=200)
    x, time = recording.channels["displacement"], recording.time
    k = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossings = time[k] - x[k] * (time[k + 1] - time[k]) / (x[k + 1] - x[k])
    frequency = (len(crossings) - 1) / (crossings[-1] - crossings[0])
    assert frequency == pytest.approx(backbone(coefficient, amplitude), rel=1e-6)
    assert (frequency > FREQUENCY) == (coefficient > 0)
