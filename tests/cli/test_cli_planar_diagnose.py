"""`testbed diagnose` and `testbed add` on a machine in x and y as a user meets them: a hidden effect named, and added."""

import json
import math
from functools import partial

import pytest

from testbed.engines import fast
from testbed.files.model_file import read_model
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from tests.support.planar_campaign import PLACES, planar_campaign, write_planar
from tests.support.shell import Shell

TRUE = Model(Structure.of((Mode(2.5, 146.6, 0.01, math.radians(12)), Mode(0.6, 310.0, 0.02, math.radians(100), "tool"))),
             Cutter(2, 20e-3), Cutting("down-milling", 0.2, 6e8, 2e8))
HIDDEN = {"tangential": 2e4, "normal": 1.5e4}  # N/m
BELIEVED = TRUE.with_values({"modes[0].natural_frequency": 147.5, "modes[1].natural_frequency": 308.0,
                             "tangential_coefficient": 6.6e8, "modes[1].direction": math.radians(104)})
KEYS = {"verdict", "effects", "error", "candidates", "base_parameters", "next_test"}  # of contract


@pytest.mark.long
def test_a_hidden_effect_is_named_and_added(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    testbed = Shell(capsys)
    write_planar(tmp_path, planar_campaign(partial(fast.simulate, steps=37), TRUE.with_effect("edge_force", **HIDDEN),
                                           ((3800, 0.3e-3), (3300, 0.2e-3), (4500, 0.3e-3)), PLACES, 3, (10, 14, 8),
                                           rate=4000.0), BELIEVED)
    told = testbed.json("diagnose", "campaign.yaml", "-m", "model.yaml", "-o", "page")
    assert told.keys() >= KEYS and (told["verdict"], told["effects"]) == ("missing_effect", ["edge_force"])
    assert told["error"]["with_effects"] < 1.02 * told["error"]["noise_floor"] < told["error"]["baseline"]
    assert told["base_parameters"]["modes[1].natural_frequency"]["after"] == pytest.approx(310.0, rel=1e-3)
    assert any(note.startswith("these channels cannot tell modes[0].mass") for note in told["notes"])
    page = (tmp_path / "page" / "report.html").read_text()
    assert "edge_force" in page and "tool_displacement_y" in page
    added = testbed.json("add", "edge_force", "-m", "model.yaml", "-c", "campaign.yaml", "-o", "new.yaml")
    assert added["error"]["after"] < added["error"]["before"]
    found = read_model(tmp_path / "new.yaml").effects["edge_force"]
    assert all(found[name] == pytest.approx(value, rel=0.15) for name, value in HIDDEN.items())
    assert "modes[0].mass" in json.dumps(added)
