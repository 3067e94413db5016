"""`testbed init`: files to start from, as they are found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from testbed.cli import main
from testbed.files.campaign import load_campaign
from testbed.files.model_file import read_model
from testbed.files.starter import FILL_IN, channel_of
from testbed.files.taps_file import load_taps
from testbed.scenario.scenario_file import read_scenario
from tests.support.shell import Shell


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    return int(stop.value.code or 0)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    time = np.arange(3000) / 12800.0
    rows = [f"{t:.8f},{x:.4f},{5 * (k % 200 < 9)},20" for k, (t, x) in
            enumerate(zip(time, 20.0 * np.sin(900.0 * time) + 0.1 * np.random.default_rng(1).normal(size=3000), strict=True))]
    for name in ("cut_3810rpm_2.9mm.csv", "cut_2850rpm_1p5mm.csv"):
        (tmp_path / name).write_text("\n".join(["time [s],disp [um],tach [V],temperature", *rows]) + "\n")
    return tmp_path


@pytest.mark.parametrize(("column", "unit", "channel"), [
    ("disp [um]", "um", "displacement"), ("acc_x (g)", "g", "acceleration_x"), ("Laser Y", "mm/s", "velocity_y"),
    ("Fx", "N", "force_x"), ("Hammer", "N", "force"), ("Tacho", "V", "tachometer"), ("ch3", "V", None),
    ("Acc tool", "", "acceleration"), ("temperature", "", None),
])  # fmt: skip
def test_what_a_column_probably_is(column, unit, channel):
    assert channel_of(column, unit) == channel


def test_the_campaign_holds_what_the_files_tell_and_reads_once_it_is_filled_in(folder, capsys):
    assert run("init", "cut_3810rpm_2.9mm.csv", "cut_2850rpm_1p5mm.csv", "-o", ".") == 0
    assert "to be filled in, in campaign.yaml: feed" in capsys.readouterr().out
    place = folder / "campaign.yaml"
    assert run("inspect", "campaign.yaml") == 2  # and says what to write for FILL_IN
    assert f"'{FILL_IN}' is no feed" in capsys.readouterr().err
    place.write_text(place.read_text().replace(FILL_IN, "0.1 mm/tooth"))
    first, second = load_campaign(place).records
    assert set(first.recording.channels) == {"displacement", "tachometer"} and first.recording.sampling_rate == 12800.0
    assert first.conditions["axial_depth_of_cut"] == pytest.approx(2.9e-3)
    assert second.conditions["spindle_speed"] == pytest.approx(2850 * 2 * np.pi / 60)
    assert second.conditions["axial_depth_of_cut"] == pytest.approx(1.5e-3)


def test_model_and_scenario_can_be_read(folder):
    assert run("init", "-o", "new", "--quiet") == 0
    model, scenario = read_model(folder / "new" / "model.yaml"), read_scenario(folder / "new" / "scenario.yaml")
    assert model.structure == scenario.model.structure and len(scenario) == 2


def test_files_with_other_columns_have_channels_of_their_own(folder):
    force = np.zeros(2000)
    force[100:110] = 50.0
    rows = [f"{a:.6f},{f}" for a, f in zip(np.random.default_rng(2).normal(size=2000), force, strict=True)]
    (folder / "tap_1.csv").write_text("\n".join(["acc [g],force [N]", *rows]) + "\n")
    assert run("init", "cut_3810rpm_2.9mm.csv", "tap_1.csv", "-o", ".", "--quiet") == 0
    place = folder / "campaign.yaml"
    text = place.read_text().replace(f"feed: {FILL_IN}", "feed: 0.1 mm/tooth")
    place.write_text(text.replace(f"sampling_rate: {FILL_IN}", "sampling_rate: 25.6 kHz"))
    cut, tap = load_campaign(place).records
    assert set(cut.recording.channels) == {"displacement", "tachometer"}
    assert set(tap.recording.channels) == {"acceleration", "force"} and tap.kind == "excited"
    assert tap.recording.sampling_rate == 25600.0


def test_what_is_there_stays(folder, capsys):
    (folder / "model.yaml").write_text("mine\n")
    assert run("init", "-o", ".") == 0
    assert (folder / "model.yaml").read_text() == "mine\n" and "stays as it is" in capsys.readouterr().out


def test_a_file_that_is_none_is_refused(folder, capsys):
    (folder / "x.yaml").write_text("a: 1\n")
    assert run("init", "nothing.csv") == 2 and run("init", "x.yaml") == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 2 and not (folder / "model.yaml").exists()


def test_hammer_blows_with_their_force_are_taps_too(folder, capsys):
    time, force = np.arange(6400) / 12800.0, np.zeros(6400)
    force[640:646] = (40.0, 150.0, 250.0, 240.0, 140.0, 30.0)
    for name, columns in (("hammer_x", "t [s],force [N],acc [g]"), ("tap_y", "t [s],Hammer [N],acc [m/s^2]")):
        np.savetxt(f"{name}.csv", np.column_stack([time, force, 0.1 * force]), "%.7g", ",", header=columns, comments="")
    assert run("init", "hammer_x.csv", "tap_y.csv", "cut_3810rpm_2.9mm.csv") == 0
    assert "to be filled in, in taps.yaml: on" in capsys.readouterr().out
    place = folder / "taps.yaml"
    place.write_text(place.read_text().replace(FILL_IN, "tool"))
    first, second = load_taps(place).taps
    assert (first.along, second.along) == ((1.0, 0.0), (0.0, 1.0)) and first.on == second.on == "tool"
    for tap, unit in ((first, 9.80665), (second, 1.0)):
        assert tap.quantity == "acceleration" and tap.record.sampling_rate == pytest.approx(12800.0, rel=1e-4)
        assert tap.record.channels["acceleration"].max() == pytest.approx(25.0 * unit)
        assert tap.record.channels["force"].max() == 250.0


def test_a_file_with_empty_fields_keeps_its_rate_and_says_what_is_wrong(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rows = [f"{k / 1000:.3f},{'' if 40 <= k < 43 else k % 7}" for k in range(2000)]
    (tmp_path / "cut_3000rpm_1mm.csv").write_text("\n".join(["time (s),disp (um)", *rows]) + "\n")
    shell = Shell(capsys)
    assert shell("init", "cut_3000rpm_1mm.csv") == 0
    assert "cut_3000rpm_1mm.csv: displacement (disp (um), um), 1000 Hz\n" in shell.out
    assert "  note: disp (um) is not looked at: 3 of 2000 samples are no number, the first is sample 41; mend" in shell.out
    assert "sampling_rate: FILL_IN" not in (tmp_path / "campaign.yaml").read_text()
