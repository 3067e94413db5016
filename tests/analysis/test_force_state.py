"""Force-state maps: `compare` draws what the model lacks over displacement and velocity, and reads the right cause off it."""

import html
import re
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.comparison.residual_views import CALIBRATED, map_units
from testbed.analysis.force.force_state import maps_of
from testbed.cli import main
from testbed.engines import fast
from testbed.workshop import write_campaign
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign


@pytest.mark.long
def test_compare_maps_a_hidden_spring_over_displacement(tmp_path):
    true = TRUE.with_effect("cubic_stiffness", coefficient=4e13)
    made = synthetic_campaign(partial(fast.simulate, steps=37), true, tests=((3810, 2.9), (4300, 2.5)),
                              rate=6400.0)
    campaign, model = write_campaign(tmp_path, made, BELIEVED)
    with pytest.raises(SystemExit) as stop:
        main(["compare", str(campaign), "-m", str(model), "-o", str(tmp_path / "out"), "--quiet"])
    assert stop.value.code == 0
    assert {"force_state_map.png", "force_state_map.svg"} <= {path.name for path in (tmp_path / "out").iterdir()}
    text = html.unescape((tmp_path / "out" / "report.html").read_text())
    heading = r"What does the missing force depend on: displacement or velocity\? \(cut_1, out of the cut\)"
    free = re.search(
        heading + r"</h2>.*?Of the force's variance displacement alone explains (\d+)%, velocity alone (\d+)%", text, re.S
    )
    assert free and int(free[1]) > 40 and int(free[1]) > 2 * int(free[2])
    assert "(cut_1, while a tooth cuts)" in text


def record(cutting):
    """A ringing record under a force -x^3, as the smoother would give it, with a jump rounded off beside the cut."""
    time = np.arange(4000) / 4000.0
    x = 1e-4 * np.cos(2 * np.pi * 100 * time)
    v = np.gradient(x, time)
    return SimpleNamespace(name="r", displacement=x, velocity=v, force=-1e13 * x**3, cutting=cutting)


def test_a_record_that_is_never_cut_has_one_map_of_its_moving_samples():
    one = record(np.zeros(4000, dtype=bool))
    one.displacement[:2000] = one.velocity[:2000] = 0.0
    (found,) = maps_of(one, 2 * np.pi * 100, 5)
    assert found.name == "r" and 1990 < len(found.x) <= 2001


def test_samples_beside_the_cut_belong_to_neither_map():
    cutting = np.zeros(4000, dtype=bool)
    cutting[1000:3000] = True
    inside, outside = maps_of(record(cutting), 2 * np.pi * 100, 7)
    assert (len(inside.x), len(outside.x)) == (2000, 2000 - 2 * 7)
    cutting[100:3950] = True  # too little is left beside it
    assert [one.name for one in maps_of(record(cutting), 2 * np.pi * 100, 7)] == ["r, while a tooth cuts"]


def test_an_uncalibrated_channel_leaves_the_force_without_unit():
    assert map_units({"displacement": "m", "tachometer": "V", "acceleration_2": "m/s^2"}) == CALIBRATED
    assert map_units({"displacement": "V", "force": "V"}) == ((1.0, "V"), (1.0, "V/s"), (1.0, "uncalibrated"))
    assert map_units({"displacement": "m", "force": "V"}) == (*CALIBRATED[:2], (1.0, "uncalibrated"))
    assert {unit for _, unit in map_units({"acceleration": "1"})} == {"uncalibrated"}
