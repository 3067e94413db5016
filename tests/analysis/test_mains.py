"""A faint line of the mains is the sensor's hum; a strong one, or one of another frequency, is an effect."""

import pytest

from testbed.analysis.search.candidate import Tried
from testbed.analysis.search.mains import hum_of
from testbed.catalogue import catalogue

KNOWN = catalogue()


def candidate(name, error, frequency=0.0):
    return Tried((name,), {f"{name}.frequency": frequency}, error, error, 500.0, True)


@pytest.mark.parametrize(("name", "frequency", "error", "hums"), [
    ("ambient_vibration", 50.02, 0.96, True),
    ("ambient_vibration", 119.95, 0.96, True),
    ("ambient_vibration", 50.02, 0.5, False),
    ("ambient_vibration", 87.0, 0.96, False),
    ("second_mode", 150.0, 0.96, False),
])
def test_only_a_faint_line_of_the_mains_hums(name, frequency, error, hums):
    told = hum_of(candidate(name, error, frequency), candidate("helix", 1.0), KNOWN)
    assert (f"{frequency:.2f} Hz" in told) is hums and bool(told) is hums
