"""A cut that shows less than the noise but for its blow at entry and its ring-down."""

import numpy as np
import pytest

from testbed.analysis.records.segments import find_segments
from testbed.recording import Recording


@pytest.mark.parametrize("damping", [0.015, 0.02, 0.03])
def test_a_cut_as_quiet_as_idling_between_its_blow_at_entry_and_its_ring_down(damping):
    """Static deflection, a blow at entry, teeth below the noise, and a ring-down: that was a tap, and no cut was found."""
    rate, begin, end, omega = 1e4, 0.09, 0.41, 2 * np.pi * 152.0
    time = np.arange(5700) / rate

    def pushed(since, size):
        late = np.maximum(time - since, 0.0)
        return size * (1.0 - np.exp(-damping * omega * late) * np.cos(omega * late)) * (time >= since)

    values = 1e-6 * np.random.default_rng(3).standard_normal(time.size) + pushed(begin, -13e-6) + pushed(end, 13e-6)
    values += 0.4e-6 * np.sin(2 * np.pi * 300.0 * time) * ((time >= begin) & (time < end))
    record = Recording({"displacement": values}, rate, {"displacement": "m"}, "measured",
                       conditions={"spindle_speed": 4500 * np.pi / 30})
    found = find_segments(record)
    cut = [one for one in found if one.kind in ("entry", "steady", "exit")]
    assert found[0].kind == "idle" and cut[0].start == pytest.approx(begin, abs=2e-3)
    assert cut[-1].stop == pytest.approx(end, abs=2e-3) and found[found.index(cut[-1]) + 1].kind == "ring-down"
