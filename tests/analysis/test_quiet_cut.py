"""A cut that shows less than the noise but for its blow at entry and its ring-down."""

import numpy as np
import pytest

from testbed.analysis.records.segments import find_segments
from testbed.engines import fast
from testbed.recording import Recording
from tests.support.planar_campaign import PLACES, planar_campaign
from tests.validation.planar_fits import COURSE, RATE, wide_model


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


@pytest.mark.parametrize(("seed", "rpm", "depth", "channel"), [(1034, 4500, 0.655e-3, "displacement_y_2"),
                                                               (1036, 3900, 0.524e-3, "displacement_x_2")])
def test_a_cut_that_decays_on_is_none_of_idling(seed, rpm, depth, channel):
    """From behind, what dies away slowly and stays loud seemed to be idling from the entry on, and no cut was found."""
    model = wide_model(np.random.default_rng([57, seed]))
    (record,) = planar_campaign(fast.simulate, model, [(rpm, depth)], PLACES, seed, COURSE, rate=RATE)
    found = find_segments(record.recording, channel=channel)
    turn = 60.0 / rpm
    cut = [one for one in found if one.kind in ("entry", "steady", "exit")]
    assert found[0].kind == found[-1].kind == "idle" and cut[0].start == pytest.approx(6 * turn, abs=turn)
    assert cut[-1].stop == pytest.approx((6 + 25) * turn, abs=3 * turn)
