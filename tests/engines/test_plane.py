"""The picture of a model in its plane has the directions of the force law, and `testbed view` draws it."""

import re

import numpy as np
import pytest

from testbed.analysis.report.plane import along_motion, outward
from tests.support import doc_pages
from tests.support.shell import Shell


@pytest.mark.parametrize("theta", [0.3, 1.6, 2.9])
def test_arrows_point_where_the_forces_do(theta):
    tangential, normal = 3.0, 2.0
    sine, cosine = np.sin(theta), np.cos(theta)
    force = np.array([-(tangential * cosine + normal * sine), tangential * sine - normal * cosine])
    assert tangential * along_motion(theta) + normal * outward(theta) == pytest.approx(force)
    step = 1e-6
    assert (outward(theta + step) - outward(theta)) / step == pytest.approx(along_motion(theta), abs=1e-5)
    deeper = np.array([np.sin(theta), np.cos(theta)])  # the chip by a unit of x and of y: towards the axis
    assert outward(theta) == pytest.approx(-deeper)


@pytest.mark.parametrize("number", [0, 1])
def test_the_models_of_the_page_are_drawn(number, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    testbed = Shell(capsys)
    model = re.findall(r"```yaml\n(.*?)```", doc_pages.read("conventions.md"), re.S)[number]
    (tmp_path / "model.yaml").write_text(model)
    assert testbed("view", "model.yaml", "-o", "plane.png", "--width", 300) == 0
    assert (tmp_path / "plane.png").read_bytes()[:4] == b"\x89PNG"


def test_a_model_without_a_cutter_is_refused(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    testbed = Shell(capsys)
    (tmp_path / "model.yaml").write_text("structure: {mass: 1 kg, natural_frequency: 100 Hz, damping_ratio: 0.01}\n")
    assert "has no cutter" in testbed.refused("view", "model.yaml", "-o", "plane.png")
