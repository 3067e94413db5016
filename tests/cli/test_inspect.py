"""`testbed inspect`: what it says of campaigns, bare files and the real measurements."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from click.testing import CliRunner

from testbed.analysis.records.inspection import inspect
from testbed.analysis.records.inspection_plot import _LINE_COLOURS, envelope
from testbed.analysis.records.lines import LineKind, follow_line
from testbed.api.fitting import doubts
from testbed.cli import main
from testbed.cli.inspect import _conditions, command
from testbed.files.campaign import load_campaign
from tests.support.campaign_files import TRUE
from tests.support.made_files import write
from tests.support.real_data import MANIFESTS, MEASUREMENTS, needs
from tests.support.synthetic_cut import milling_record


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inspect")
    recording, _ = milling_record(noise=1e-6)
    rows = np.stack([recording.channels["displacement"] * 1e6, recording.channels["tachometer"]], axis=1)
    np.savetxt(folder / "cut.csv", rows, "%.4f", ",", header="disp,tach", comments="")
    (folder / "campaign.yaml").write_text(
        "name: rig\nsampling_rate: 12800 Hz\nchannels:\n  displacement: {column: disp, unit: um}\n"
        "  tachometer: {column: tach, unit: V}\n"
        "records:\n  - {file: cut.csv, kind: cut, spindle_speed: 3900 rpm, depth_of_cut: 2.9 mm, feed: 0.1 mm/tooth}\n"
        "  - {file: cut.csv, name: blind, kind: cut, spindle_speed: 3900 rpm, depth_of_cut: 2.9 mm, feed: 0.1 mm/tooth"
        ", flutes: 1, "
        "channels: {tachometer: none}}\n"
    )
    return folder / "campaign.yaml"


def test_conditions_are_told_in_the_words_of_a_campaign_s_file(campaign: Path) -> None:
    told = CliRunner().invoke(command, [str(campaign)])
    assert "conditions: spindle_speed 3900 rpm, depth_of_cut 2.9 mm, feed 0.1 mm/tooth\n" in told.output
    assert _conditions({"feed_per_revolution": 2e-4, "length_cut_before": 0.00508}) == [
        "feed 0.2 mm/rev", "length_cut_before 5.08 mm"]


def test_json_holds_speed_segments_and_noise_in_si(campaign: Path) -> None:
    result = CliRunner().invoke(command, [str(campaign), "--json", "-"], catch_exceptions=False)
    record, blind = json.loads(result.stdout)["records"]
    assert record["speed"]["basis"] == "tachometer" and record["speed"]["found"] == pytest.approx(
        3810 * np.pi / 30, rel=1e-4
    )
    assert record["noise_floor"]["rms"] == pytest.approx(1e-6, rel=0.03) and record["noise_floor"]["basis"] == "idle"
    assert [part["kind"] for part in record["segments"]] == ["idle", "entry", "steady", "ring-down"]
    assert any("found 3810" in note for note in record["notes"])
    assert blind["speed"]["basis"] == "tooth-passing lines" and blind["speed"]["found"] == pytest.approx(
        3810 * np.pi / 30, rel=5e-3
    )


def test_text_says_it_in_shop_units_and_pictures_are_drawn(campaign: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(command, [str(campaign), "-o", str(tmp_path / "pictures")], catch_exceptions=False)
    assert "3810.0 rpm from tachometer" in result.output and "um rms in displacement, from idle" in result.output
    drawn = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert drawn == {"cut.png", "cut.svg", "blind.png", "blind.svg"}
    assert (tmp_path / "pictures" / "cut.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("kind", ["csv", "labview", "hdf5", "wav", "tdms", "uff", "parquet"])
def test_bare_files_of_every_format(kind: str, tmp_path: Path) -> None:
    found = inspect(write(kind, tmp_path))
    assert found.total == 1 and found.records[0].recording.sampling_rate == 12800.0
    assert len(found.records[0].channels) == 2


def test_a_bare_file_without_time_says_so_and_takes_a_rate(tmp_path: Path) -> None:
    path = write("mat", tmp_path)
    assert any("--rate" in note for note in inspect(path).notes) and inspect(path).records == ()
    assert inspect(path, sampling_rate=12800.0).records[0].recording.sampling_rate == 12800.0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["missing.csv"], "no such file"),
        (["missing.yaml"], "no such file"),
        (["{campaign}", "--rate", "fast"], "--rate"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    arguments: list[str], said: str, campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["inspect", *[argument.format(campaign=campaign) for argument in arguments]])
    shown = capsys.readouterr().err
    assert stop.value.code == 2 and shown.startswith("error: ") and shown.count("\n") == 1 and said in shown


@needs("milling_chatter")
def test_real_chatter_speed_and_line() -> None:
    record = inspect(MANIFESTS / "milling_chatter.yaml", folder=MEASUREMENTS).records[0]
    assert record.speed_basis == "side bands" and record.speed_found == pytest.approx(4500 * np.pi / 30, rel=3e-3)
    assert any("nominal spindle speed 5000 rpm, found 4" in note for note in record.notes)
    assert record.lines[0].kind == "chatter" and record.lines[0].frequency == pytest.approx(684, abs=3)
    assert record.chatter.verdict == "chatter" and record.chatter.frequency == pytest.approx(684, abs=3)
    assert any(line.kind == "hum" and abs(line.frequency - 150) < 0.5 for line in record.lines)
    assert any("stored twice" in note for note in record.notes) and record.recording.sampling_rate == 5000.0
    assert record.chatter_line.frequency[0] == pytest.approx(746, abs=4)
    assert record.chatter_line.loudest[1] == pytest.approx(684, abs=3)
    assert record.chatter_line.time[0] < 3.85 and record.chatter_line.time[-1] > 4.85
    rate, values = 5000, record.recording.channels["acceleration"]
    _, frequencies, _ = follow_line(values[round(3.4 * rate) : round(4.85 * rate)], rate, 746.0, window=0.15)
    assert frequencies[:6].mean() == pytest.approx(747, abs=4) and frequencies[-4:].mean() == pytest.approx(684, abs=4)


@needs("milling_force")
def test_real_forces_are_steady_and_turn_at_6000_rpm() -> None:
    for record in inspect(MANIFESTS / "milling_force.yaml", folder=MEASUREMENTS).records:
        assert [part.kind for part in record.segments] == ["steady"] and record.noise.basis == "repeated periods"
        assert record.speed_found == pytest.approx(200 * np.pi, rel=1e-3)
        assert (record.lines[0].kind, record.lines[0].order) == ("tooth-passing", 1)
        assert record.chatter.verdict != "chatter"  # stable slots with runout


@needs("tap_test")
def test_real_bare_files() -> None:
    found = inspect(MEASUREMENTS / "tap_test" / "impact_Point1_time.txt")
    assert found.records[0].recording.sampling_rate == 51200.0 and any("taken for time" in note for note in found.notes)
    assert inspect(MEASUREMENTS / "tap_test" / "FRF_Point_1.txt").records == ()


def test_a_data_set_of_testbed_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["run", "identification", "-o", str(tmp_path / "tests.h5"), "--engine", "fast", "--quiet"])
    assert stop.value.code == 0
    capsys.readouterr()
    found = inspect(tmp_path / "tests.h5", most=2)
    assert found.total == 3 and len(found.records) == 2
    for record in found.records:
        period = 2 * np.pi / record.conditions["spindle_speed"]
        segments = {part.kind: part for part in record.segments}
        # the scenario idles 10 revolutions and cuts 80; the last tooth leaves a fraction 0.162 into its revolution
        assert abs(segments["entry"].start / period - 10) < 0.5
        assert abs(segments["ring-down"].start / period - 89.162) < 0.5
        assert record.speed_basis == "tachometer" and record.noise.rms == pytest.approx(0.5e-6, rel=0.05)


def test_a_data_set_that_is_a_folder_of_shards(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["run", "identification", "-o", str(tmp_path / "s.h5"), "--engine", "fast", "--shards", "--quiet"])
    assert stop.value.code == 0
    found = inspect(tmp_path / "s.h5", most=2)
    assert found.total == 3 and [record.name for record in found.records] == ["run 0", "run 1"]
    assert found.records[1].speed_found == pytest.approx(2850 * np.pi / 30, rel=1e-4)
    (tmp_path / "s.h5" / "index.h5").unlink()
    capsys.readouterr()
    with pytest.raises(SystemExit) as stop:
        main(["inspect", str(tmp_path / "s.h5")])
    shown = capsys.readouterr().err
    assert stop.value.code == 2 and "unfinished sweep" in shown and shown.count("\n") == 1


def test_compare_says_what_reading_found_doubtful_and_a_speed_that_the_signal_contradicts(campaign: Path) -> None:
    said = doubts(load_campaign(campaign).records, TRUE)
    assert any(note.startswith("cut: nominal spindle speed 3900 rpm, found 3810") for note in said)
    assert any(note.startswith("blind: nominal spindle speed 3900 rpm, found 38") and "correct the c" in note for note in said)
    assert sum(note.startswith("blind: nominal") for note in said) == 1
    assert not any("sampled" in note for note in said)
    tap = replace(load_campaign(campaign).records[0], kind="ring-down", notes=("tachometer: 3 gaps", "lone spikes"))
    assert doubts([tap], TRUE) == ["cut: lone spikes"]  # its spindle may stand still
    fast = TRUE.with_values({"natural_frequency": 6000.0})
    slow = [note for note in doubts(load_campaign(campaign).records, fast) if "sampled" in note]
    assert slow and all("less than 2.5 times the model's natural frequency 6000 Hz" in note for note in slow)


def test_every_kind_of_line_has_a_colour() -> None:
    assert set(_LINE_COLOURS) == set(get_args(LineKind))


def test_thinning_for_a_picture_keeps_the_extremes_and_the_whole_length() -> None:
    values = np.zeros(18141)
    values[[7, 9000, 18139]] = 1.0, -2.0, 3.0
    time, thin = envelope(np.arange(18141.0), values, 4000)
    assert len(thin) <= 8000 and {1.0, -2.0, 3.0} <= set(thin) and time[-1] > 18130 and (np.diff(time) >= 0).all()
