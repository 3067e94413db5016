"""Scales of force and response: told where a tap measures one thing in two ways, and said to be unchecked where it does not."""

import numpy as np
import pytest

from testbed.analysis.tap.tap import tap_test
from testbed.files.model_file import read_model
from testbed.files.taps_file import load_taps
from testbed.machine import Mode
from tests.support.made_taps import Hammer, write_taps
from tests.support.shell import Shell

pytest.importorskip("sdypy.EMA", reason="needs the extra package sdypy-EMA")
FAST = Hammer(blows=2, spacing=0.5)
OBLIQUE = (Mode(0.5, 500.0, 0.02, np.radians(20.0), "tool"), Mode(0.3, 800.0, 0.015, np.radians(-35.0), "tool"))


@pytest.fixture
def shell(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Shell(capsys)


@pytest.mark.parametrize("pairs", ["xx yy xy yx", "xx yy xy", "xx yy yx"])
@pytest.mark.parametrize("factor", [1.0, 9.80665, 0.4])
def test_reciprocity_tells_the_scale_of_one_axis(pairs, factor, tmp_path):
    signs = {pair: factor for pair in pairs.split() if pair[1] == "y"}
    found = tap_test(load_taps(write_taps(tmp_path, OBLIQUE, pairs, FAST, signs=signs)))
    (check,) = found.scales
    assert check.by == "reciprocity" and check.ratio.value == pytest.approx(factor, rel=0.05)
    assert check.agrees is (factor == 1.0)
    assert [mode.mass.determined for mode in found.modes] == [factor == 1.0] * 2
    assert [mode.natural_frequency.value for mode in found.modes] == pytest.approx([500.0, 800.0], rel=1e-3)
    assert any("g where m/s^2 are stated" in note for note in found.notes) == (factor == 9.80665)


@pytest.mark.parametrize("quantity", ["acceleration", "velocity"])
def test_a_tap_repeated_tells_the_scale_of_one_file(quantity, shell, tmp_path):
    write_taps(tmp_path, OBLIQUE, "xx", FAST)
    force, response = np.loadtxt(tmp_path / "xx.csv", delimiter=",", skiprows=1).T
    other = response if quantity == "acceleration" else np.cumsum(response - response[:500].mean()) / FAST.rate
    np.savetxt(tmp_path / "again.csv", np.column_stack([force, 1000.0 * other]), delimiter=",", header="F,a", comments="")
    unit = {"acceleration": "m/s^2", "velocity": "m/s"}[quantity]
    path = tmp_path / "taps.yaml"
    path.write_text(path.read_text() + "  - {file: again.csv, direction: x, response: {column: a, unit: " + unit
                    + f", quantity: {quantity}}}}}\n")
    found = shell.json("tap", "taps.yaml", "-o", "machine.yaml")
    (check,) = found["scales"]
    assert check["of"] == "again" and check["against"] == "xx" and check["agrees"] is False
    assert check["ratio"]["value"] == pytest.approx(1000.0, rel=0.05)
    assert any("Modal masses and directions are guesses" in note for note in found["notes"])
    assert "modes[0].mass" in read_model("machine.yaml").not_determined


def test_what_nothing_checks_is_said(tmp_path):
    path = write_taps(tmp_path, OBLIQUE, "xx", FAST, signs={"xx": 10.0})
    found = tap_test(load_taps(path))
    assert not found.scales and any("a wrong one would not show in this tap" in note for note in found.notes)
    path.write_text(path.read_text().replace("unit: N", "unit: kN"))
    assert any("no instrumented hammer gives that" in note for note in tap_test(load_taps(path)).notes)
