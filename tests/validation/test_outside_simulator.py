"""The engine against the simulator with which the outside campaigns are made: no code in common, one motion."""

import pytest

from tests.validation.outside.agreement import LIMIT, difference


@pytest.mark.parametrize("name", ["", "process_damping", "runout", "speed_droop", "speed_variation", "second_mode", "helix",
                                  "sensor_lag"])
def test_one_motion_by_two_simulators(name):
    assert difference(name, "down-milling") <= LIMIT
