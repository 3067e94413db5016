"""campaign.yaml: what it says is what the records hold, and every mistake is said with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from testbed.files.campaign import Campaign, load_campaign
from testbed.problem import InputProblem
from tests.support.made_files import RATE, write
from tests.support.real_data import MANIFESTS, MEASUREMENTS, needs
from tests.support.synthetic_cut import milling_record

HEAD = """\
name: rig
sampling_rate: 12800 Hz
channels:
  displacement: {column: disp_um, unit: um}
  tachometer: {column: tach_V, unit: V, pulses_per_revolution: 1, edge: rising}
records:
"""
CUT = "  - {file: cut_1.csv, kind: cut, spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm, feed: 0.1016 mm/tooth}\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("campaign")
    recording, _ = milling_record()
    rows = np.stack([recording.channels["displacement"] * 1e6, recording.channels["tachometer"]], axis=1)
    np.savetxt(path / "cut_1.csv", rows, "%.4f", ",", header="disp_um,tach_V", comments="")
    tap = 30 * np.exp(-0.0002 * np.arange(8000)) * np.sin(2 * np.pi * 146.6 * np.arange(8000) / RATE)
    np.savetxt(
        path / "tap_1.csv",
        tap + 0.1 * np.random.default_rng(1).standard_normal(8000),
        "%.4f",
        header="disp_um",
        comments="",
    )
    return path


def _load(folder: Path, text: str) -> Campaign:
    path = folder / "campaign.yaml"
    path.write_text(text)
    return load_campaign(path)


def _refused(folder: Path, text: str) -> InputProblem:
    with pytest.raises(InputProblem) as caught:
        _load(folder, text)
    assert "\n" not in str(caught.value)
    return caught.value


def test_a_campaign_gives_recordings_in_si_with_marks_and_conditions(folder: Path) -> None:
    campaign = _load(folder, HEAD + "  - {file: tap_1.csv, kind: ring-down}\n" + CUT)
    assert [(record.name, record.kind) for record in campaign.records] == [("tap_1", "ring-down"), ("cut_1", "cut")]
    cut = campaign.record("cut_1")
    expected, truth = milling_record()
    assert cut.recording.origin == "measured" and cut.recording.sampling_rate == RATE
    assert np.abs(cut.recording.channels["displacement"] - expected.channels["displacement"]).max() < 1e-10
    assert len(cut.recording.marks) == 90 and np.abs(np.diff(cut.recording.marks) - truth.period).max() < 0.1 / RATE
    assert cut.conditions["spindle_speed"] == pytest.approx(2 * np.pi / truth.period)
    assert cut.conditions["axial_depth_of_cut"] == pytest.approx(2.9e-3)
    assert cut.cut(1, passes=40).feed_per_tooth == pytest.approx(0.1016e-3) and cut.cut(1, passes=40).passes == 40
    tap = campaign.record("tap_1")
    assert list(tap.recording.channels) == ["displacement"] and any("tachometer" in note for note in tap.notes)
    with pytest.raises(InputProblem, match="not a cut"):
        tap.cut(1)


@pytest.mark.parametrize(
    ("feed", "per_tooth"), [("0.1 mm/tooth", 1e-4), ("0.1 mm/rev", 5e-5), ("381 mm/min", 5e-5), ("100 um/tooth", 1e-4)]
)
def test_feeds_of_every_kind(feed: str, per_tooth: float, folder: Path) -> None:
    record = _load(folder, HEAD + CUT.replace("0.1016 mm/tooth", feed)).records[0]
    assert record.feed_per_tooth(2) == pytest.approx(per_tooth)
    assert ("feed_per_tooth" in record.conditions) == feed.endswith("tooth")
    stated = _load(folder, HEAD + CUT.replace("0.1016 mm/tooth", f"{feed}, flutes: 2")).records[0]
    assert stated.conditions["feed_per_tooth"] == pytest.approx(per_tooth)
    with pytest.raises(InputProblem, match="2 flutes, the model has 3"):
        stated.cut(3)


def test_a_record_overrides_channels_rate_and_conditions(folder: Path) -> None:
    own = (
        "{file: cut_1.csv, kind: cut, depth_of_cut: 1 mm, sampling_rate: 6400 Hz, name: slow, from: 0.1, to: 0.5 s, "
        "channels: {displacement: {unit: mV}, tachometer: none}}"
    )
    text = HEAD.replace("records:", "spindle_speed: 3000 rpm\nfeed: 0.1 mm/tooth\nrecords:") + f"  - {own}\n"
    record = _load(folder, text).record("slow")
    assert record.recording.sampling_rate == 6400 and record.recording.start == pytest.approx(0.1)
    assert len(record.recording) == 2560 and record.recording.units == {"displacement": "V"}
    assert record.conditions["spindle_speed"] == pytest.approx(100 * np.pi) and len(record.recording.marks) == 0
    assert any("uncalibrated" in note for note in record.notes)


def test_a_nominal_speed_that_the_tachometer_contradicts_is_said(folder: Path) -> None:
    record = _load(folder, HEAD + CUT.replace("3810", "4000")).records[0]
    assert any("nominal spindle speed 4000 rpm, found 3810" in note for note in record.notes)


def test_a_file_read_twice_gets_two_names(folder: Path) -> None:
    (folder / "campaign.yaml").write_text(HEAD + CUT + CUT)
    campaign = load_campaign(folder / "campaign.yaml")
    assert [record.name for record in campaign.records] == ["cut_1", "cut_1_2"]


@pytest.mark.parametrize(
    ("change", "line", "said"),
    [
        (("kind: cut", "kind: cuts"), 7, "cuts"),
        (("spindle_speed", "spindel_speed"), 7, "did you mean spindle_speed"),
        (("  displacement", "  displacment"), 4, "did you mean displacement"),
        (("unit: um", "units: um"), 4, "did you mean unit"),
        (("3810 rpm", "3810"), 7, "has no unit"),
        (("12800 Hz", "12800 rpm"), 2, "no sampling rate"),
        (("2.9 mm", "2.9 kg"), 7, "does not convert"),
        ((", depth_of_cut: 2.9 mm", ""), 7, "a cut needs depth_of_cut"),
        (("0.1016 mm/tooth", "fast"), 7, "feed"),
        (("cut_1.csv", "cut_11.csv"), 7, "did you mean cut_1.csv"),
        (("edge: rising", "edge: up"), 5, "rising"),
        (("12800 Hz", "-5 Hz"), 2, "above 0"),
        (("sampling_rate", "sampling_rat"), 2, "did you mean sampling_rate"),
        (("tooth}", "tooth, from: 2, to: 1}"), 7, "not after"),
        (("tooth}", "tooth, skip_rows: -1}"), 7, "number of lines"),
        (("revolution: 1", "revolution: 0"), 5, "at least 1"),
        (("unit: um", "unit: um, edge: rising"), 4, "tachometer"),
    ],
)
def test_mistakes_are_said_with_line_and_remedy(change: tuple[str, str], line: int, said: str, folder: Path) -> None:
    problem = _refused(folder, (HEAD + CUT).replace(*change))
    assert said in str(problem) and problem.line == line, str(problem)


def test_mistakes_in_the_data_name_the_file(folder: Path) -> None:
    problem = _refused(folder, (HEAD + CUT).replace("disp_um", "dsp_um"))
    assert "cut_1.csv" in problem.place and "'disp_um', 'tach_V'" in problem.do
    assert "furlong" in str(_refused(folder, (HEAD + CUT).replace("unit: um", "unit: furlong")))
    beyond = _refused(folder, (HEAD + CUT).replace("tooth}", "tooth, from: 50}"))
    assert "cut_1.csv" in beyond.place and beyond.what == "channel displacement: no samples" and "from/to" in beyond.do


def test_an_excited_record_needs_force_and_response_and_may_have_several(tmp_path: Path) -> None:
    write("csv", tmp_path)
    head = "name: x\nchannels:\n  displacement: {column: disp, unit: um}\n"
    record = "records:\n  - {file: record_csv.csv, kind: excited}\n"
    assert "needs a force channel" in str(_refused(tmp_path, head + record))
    more = "  displacement_2: {column: 2, unit: mm, scale: 2}\n"
    more += "  force_x: {column: force, unit: N}\n  force_y: {column: force, unit: kN}\n"
    loaded = _load(tmp_path, head + more + record).records[0]
    assert loaded.responses == ("displacement", "displacement_2") and loaded.excitations == ("force_x", "force_y")
    assert loaded.recording.channels["displacement_2"][5] == pytest.approx(
        2000 * loaded.recording.channels["displacement"][5]
    )


@needs("milling_force")
def test_real_dynamometer_exports() -> None:
    campaign = load_campaign(MANIFESTS / "milling_force.yaml", MEASUREMENTS)
    feeds = [record.feed_per_tooth(2) for record in campaign.records]
    assert feeds == pytest.approx([0.025e-3, 0.05e-3, 0.075e-3, 0.1e-3, 0.125e-3])
    for record in campaign.records:
        assert len(record.recording) == 10001 and record.recording.sampling_rate == 10000.0 and record.notes == ()
    # 1438 N/mm of mean force a feed, as SOURCE.txt's users found: the slope says that columns and units are right
    mean = [abs(record.recording.channels["force_y"].mean()) for record in campaign.records]
    assert np.polyfit(np.array(feeds) * 1e3, mean, 1)[0] == pytest.approx(1438, rel=0.02)


@needs("plate_hammer")
def test_real_hammer_blow_in_two_files_with_rounded_times(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(
        f"name: plate\nfolder: {MEASUREMENTS / 'plate_hammer'}\n"
        "channels: {time: {column: 1, unit: s}, acceleration: {column: 2, unit: m/s^2},"
        " force: {column: 2, unit: N}}\nrecords:\n"
        "  - {file: accel_pt8.txt, kind: excited, channels: {force: {file: impact_pt8.txt}}}\n"
    )
    recording = load_campaign(tmp_path / "c.yaml").records[0].recording
    assert len(recording) == 4000 and recording.sampling_rate == 4000.0
    assert recording.channels["force"].max() == pytest.approx(41.66001323) and recording.units["force"] == "N"


@needs("silverbox")
def test_real_silverbox_in_volts() -> None:
    arrow, multisine, schroeder = load_campaign(MANIFESTS / "silverbox.yaml", MEASUREMENTS).records
    assert len(arrow.recording) + len(multisine.recording) == 131072 and len(schroeder.recording) == 131072
    assert multisine.recording.start == pytest.approx(66.6, abs=2e-3) and arrow.recording.units == {
        "force": "V",
        "displacement": "V",
    }
    assert any("uncalibrated" in note for note in arrow.notes)


@needs("tap_test")
def test_real_hammer_blow_without_header() -> None:
    record = load_campaign(MANIFESTS / "tap_test.yaml", MEASUREMENTS).records[0]
    assert record.recording.sampling_rate == 51200.0 and len(record.recording) == 51200
    assert record.recording.channels["force"].max() == pytest.approx(250, rel=0.05)
    assert np.abs(record.recording.channels["acceleration"]).max() == pytest.approx(667, rel=0.01)


@needs("milling_chatter")
def test_real_chatter_is_stored_twice() -> None:
    record = load_campaign(MANIFESTS / "milling_chatter.yaml", MEASUREMENTS).records[0]
    assert record.recording.sampling_rate == 5000.0 and len(record.recording) == 40009
    assert any("stored twice" in note and "5000 Hz" in note for note in record.notes)
