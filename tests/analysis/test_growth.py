"""The multiplier by which a cut grew, read from made revolutions whose growth is known."""

import cmath
import math

import numpy as np
import pytest

from testbed.analysis.records.growth import growth, is_flip
from testbed.analysis.records.orders import Turns

PER_PASS, PASSES = 40, 160


def cut(multiplier, flutes, runout=0.0, start=1e-3, noise=1e-4, saturates=1.0):
    """Turns of a cut whose motion is multiplied by that from pass to pass up to a size, with runout all the while."""
    random = np.random.default_rng(3)
    place = np.arange(PER_PASS) / PER_PASS
    shape = np.sin(math.pi * place) + 1j * np.sin(2 * math.pi * place + 0.3)
    swing = start * multiplier ** np.arange(PASSES)
    swing = swing * saturates / np.maximum(np.abs(swing), saturates)
    offsets = runout * np.cos(2 * math.pi * np.arange(PASSES) / flutes)
    passes = np.real(swing[:, None] * shape) + (0.2 + offsets[:, None]) * np.sin(math.pi * place) ** 2
    values = passes + noise * random.standard_normal(passes.shape)
    return Turns(values.reshape(-1, flutes * PER_PASS), 0.05, 0.0)


@pytest.mark.parametrize("flutes", [1, 2, 4, 5])
@pytest.mark.parametrize("multiplier", [-1.06, -1.2, cmath.rect(1.1, 2.0), cmath.rect(1.06, 0.7)])
def test_the_multiplier_is_read_from_the_growth(multiplier, flutes):
    found = growth(cut(multiplier, flutes, 0.3 if flutes > 1 else 0.0), flutes)
    assert abs(found) == pytest.approx(abs(multiplier), rel=0.02)
    assert abs(cmath.phase(found)) == pytest.approx(abs(cmath.phase(multiplier)), abs=0.05)
    assert is_flip(found) == (multiplier == -abs(multiplier))


@pytest.mark.parametrize("flutes", [1, 2, 4])
def test_a_transient_that_dies_and_runout_that_stands_grow_by_nothing(flutes):
    assert growth(cut(-0.93, flutes, 0.3 if flutes > 1 else 0.0, start=0.5), flutes) is None
    assert growth(cut(cmath.rect(0.97, 1.3), flutes, start=0.5), flutes) is None


def test_what_is_large_within_a_few_passes_tells_no_multiplier():
    assert growth(cut(-1.8, 2, start=0.2), 2) is None
