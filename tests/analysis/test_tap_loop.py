"""The loop closed: a tap writes a model, and the records of cuts say whether the structure is still the one that was struck."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from testbed.analysis.comparison.tapped import beside_the_tap, said_of_the_tap
from testbed.analysis.estimate import Estimate
from testbed.engines import fast
from testbed.files.model_file import model_from_text, model_text, read_model, write_model
from testbed.machine import Mode, Model, Structure
from testbed.problem import InputProblem
from testbed.workshop import write_campaign
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.made_taps import Hammer, write_taps
from tests.support.shell import Shell
from tests.support.synthetic_campaign import synthetic_campaign

STRUCK = 146.6  # Hz, of the structure at rest
SOFT = Hammer(blows=2, spacing=6.0, width=2e-3, rate=3200.0)


@pytest.fixture
def shell(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Shell(capsys)


@pytest.mark.long
def test_a_structure_that_is_softer_while_cutting_is_told(shell, tmp_path: Path) -> None:
    pytest.importorskip("sdypy.EMA", reason="needs the extra package sdypy-EMA")
    taps = write_taps(tmp_path, [Mode(2.573, STRUCK, 0.0032, 0.0, "workpiece")], "xx", SOFT)
    taps.write_text(taps.read_text().replace("on: tool", "on: workpiece"))
    write_model(BELIEVED, tmp_path / "base.yaml")
    shell.json("tap", "taps.yaml", "-m", "base.yaml", "-o", "machine.yaml")
    low, high = read_model("machine.yaml").tapped["natural_frequency"]
    assert 0.5 * (low + high) == pytest.approx(STRUCK, rel=1e-4) and high - low < 0.1
    for cutting, differs in ((143.2, True), (STRUCK, False)):
        true = replace(TRUE, structure=Structure(2.573, cutting, 0.0032))
        folder = tmp_path / f"{cutting}"
        folder.mkdir()
        write_campaign(folder, synthetic_campaign(partial(fast.simulate, steps=37), true, seed=4, rate=6400.0,
                                                  tests=((3810, 2.9), (2850, 2.9), (4200, 1.5)), course=(10, 35, 15)), BELIEVED)
        found = shell.json("compare", f"{cutting}/campaign.yaml", "-m", "machine.yaml", "-o", f"{cutting}/page")
        row = {one["parameter"]: one for one in found["tap"]}["natural_frequency"]
        assert found["adequate"] and row["differs"] is differs
        assert row["change"] == pytest.approx(cutting / STRUCK - 1.0, abs=2e-4)
        said = [note for note in found["notes"] if "tap" in note]
        words = ("in the cut the structure rings at 143.2 Hz +- ", "the tap says 146.6 Hz +- ",
                 "softer or heavier, 2.3 % of the frequency, while cutting")
        assert all(word in said[0] for word in words) if differs else "the modes are those of the tap" in said[0]
        assert said[0] in (folder / "page" / "report.html").read_text()
    told = shell.json("diagnose", "143.2/campaign.yaml", "-m", "machine.yaml")
    assert any("in the cut the structure rings at 143.2" in note for note in told["notes"])
    assert {one["parameter"]: one["differs"] for one in told["tap"]}["natural_frequency"] is True


@pytest.mark.parametrize(("low", "high", "explained", "differs"), [(146.0, 146.3, True, False), (146.4, 146.6, True, True),
                                                                   (146.4, 146.6, False, None)])
def test_it_is_told_only_where_intervals_lie_apart_and_the_model_explains(low, high, explained, differs) -> None:
    model = replace(TRUE, tapped={"natural_frequency": (low, high)})
    rows = beside_the_tap(model, {"natural_frequency": Estimate(146.2, 146.1, 146.3, "Hz")}, explained)
    assert [row.differs for row in rows] == [differs]
    said = said_of_the_tap(rows, cutting=True)
    assert ("rings at" in said[0]) is (differs is True) and ("cannot be checked" in said[0]) is (differs is None)
    assert beside_the_tap(model, {"natural_frequency": Estimate(146.2, 0.0, 9e9, "Hz", bounded=False)}, True) == ()


def test_intervals_of_a_tap_read_back_and_wrong_ones_are_said_with_their_line() -> None:
    modes = Structure.of([Mode(1.0, 450.0, 0.02, 0.3, "tool"), Mode(2.0, 500.0, 0.02, 1.3, "tool")])
    model = Model(modes, not_determined=("modes[1].mass",), tapped={"modes[0].natural_frequency": (449.5, 450.25)})
    again = model_from_text(model_text(model))
    assert again.tapped == model.tapped and again.not_determined == model.not_determined
    for old, new, words in (("[449.5 Hz, 450.25 Hz]", "[451 Hz, 450 Hz]", "no interval"), ("450.25 Hz", "450.25 kg", "kg"),
                            ("  modes[0].natural_frequency: [449", "  modes[7].natural_frequency: [449", "no parameter"),
                            (", 450.25 Hz]", "]", "no interval")):
        with pytest.raises(InputProblem, match=words):
            model_from_text(model_text(model).replace(old, new))
