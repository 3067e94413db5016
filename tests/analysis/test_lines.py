"""Lines of a spectrum: what chance shows is none, and which speed they tell."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.fit.observe import heard_in
from testbed.analysis.records.lines import comb_speed, standing_out
from testbed.analysis.records.record_report import report
from testbed.analysis.records.segments import Segment
from testbed.api.fitting import doubts
from testbed.machine import Cutter
from testbed.recording import Recording
from tests.support.campaign_files import BELIEVED


def test_white_noise_has_no_lines_at_the_ends_of_its_spectrum():
    """What is beyond an end is the spectrum mirrored, not its last value again."""
    found = [frequency for seed in range(40) for frequency, _, _ in
             standing_out(np.random.default_rng(seed).standard_normal(5000), 10000.0)]
    assert len(found) < 20 and sum(frequency < 200.0 or frequency > 4800.0 for frequency in found) <= 2
    long = np.random.default_rng(7).standard_normal((8, 400_000))
    assert sum(len(standing_out(row, 50000.0)) for row in long) <= 3  # some fifty, were no more asked of them


def test_what_is_slower_than_any_line_has_no_lines_beside_it():
    """A decay without noise: what its straight line leaves at 0 Hz has side lobes."""
    time = np.arange(4000) / 5000.0
    decay = np.sin(2.0 * np.pi * 150.0 * time) * np.exp(-20.0 * time)
    assert [round(frequency) for frequency, _, _ in standing_out(decay, 5000.0)] == [150]
    for cycles in (4.0, 4.5, 5.0, 7.0):  # and a slow line is one
        noisy = np.sin(2.0 * np.pi * cycles * time / 0.8) + 0.05 * np.random.default_rng(1).standard_normal(4000)
        assert abs(standing_out(noisy, 5000.0)[0][0] * 0.8 - cycles) < 0.1


def test_lines_of_a_speed_far_from_the_stated_one_are_no_side_bands_of_that() -> None:
    """A cut that chatters at 717.5 Hz, teeth passing at 303.56 Hz; stated is a speed at which they pass at 242.8 Hz."""
    time, random = np.arange(14300) / 32000, np.random.default_rng(6)
    teeth = zip(303.56 * np.arange(1, 14), [3.78, 1.34, 0.985, 0.143, 0.071, 0.041, 0.018, 0.015, 0.009, 0.007, 0.005, 0.004,
                                            0.003], strict=True)  # fmt: skip
    bands = [(717.51, 7.82), (413.95, 0.27), (1021.07, 0.175), (800.27, 0.055), (193.15, 0.033), (1545.3, 0.024)]
    motion = sum(size * np.cos(2 * np.pi * line * time + line) for line, size in (*teeth, *bands))
    values = motion + 1e-2 * random.standard_normal(len(time))
    assert comb_speed(values, 32000.0, 242.8 * np.pi / 2, flutes=4) is None
    near = comb_speed(values, 32000.0, 295.0 * np.pi / 2, flutes=4)
    assert near is not None and near.spindle_speed == pytest.approx(303.56 * np.pi / 2, rel=1e-3)


def unmarked(rate: float, stated: float, **conditions: float) -> Recording:
    """A record of 2 s, half idle: lines of four teeth at 690 rpm, the last 0.6 s of them after an entry."""
    time, random = np.arange(round(2 * rate)) / rate, np.random.default_rng(5)
    lines = sum(np.cos(2 * np.pi * 46.0 * order * time + order**2) / order for order in range(1, 20))
    cut = np.clip((time - 1.0) / 0.4, 0.0, 1.0) * lines + 0.01 * random.standard_normal(len(time))
    return Recording({"displacement": 1e-5 * cut}, rate, {"displacement": "m"}, "measured",
                     conditions={"spindle_speed": stated * np.pi / 30, **conditions})


@pytest.mark.parametrize(("stated", "flutes", "found"), [
    (862.0, 4, 690.0),  # a fifth too high: by the flutes it has
    (862.0, None, None),  # by 3 flutes it would be 920 rpm, as near
    (925.0, None, 920.0),  # near what 3 flutes make of it, as log books are
])
def test_a_speed_by_lines_of_teeth_whose_number_is_not_known_is_not_told(stated, flutes, found) -> None:
    known = {} if flutes is None else {"flutes": flutes}
    seen = report(unmarked(5000.0, stated, **known), "cut", "cut", ())
    if found is None:
        assert seen.speed_found is None and not any("speed" in note for note in seen.notes)
    else:
        assert seen.speed_found == pytest.approx(found * np.pi / 30, rel=2e-3) and seen.speed_basis == "tooth-passing lines"


def test_lines_of_the_entry_are_of_the_cut_and_not_of_the_idling() -> None:
    recording = unmarked(5000.0, 862.0)
    parts = (Segment("idle", 0.0, 0.9), Segment("entry", 0.9, 1.4), Segment("steady", 1.4, 2.0))
    values = recording.channels["displacement"][None]
    seen = SimpleNamespace(segments=parts, start=0.0, rate=5000.0, data=values)
    assert heard_in(seen, 862.0 * np.pi / 30, 4) == pytest.approx(690.0 * np.pi / 30, rel=2e-3)


def test_before_a_fit_the_speed_is_looked_for_with_the_teeth_of_the_model() -> None:
    """By one tooth it would be 920 rpm, and that was advised."""
    record = SimpleNamespace(name="cut", kind="cut", notes=(), recording=unmarked(5000.0, 862.0))
    (said,) = (note for note in doubts([record], replace(BELIEVED, cutter=Cutter(4))) if "spindle speed" in note)
    assert "nominal spindle speed 862 rpm, found 689.99" in said and "number of flutes" in said
