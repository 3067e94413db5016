"""Published sets by their layout: the files that a user downloaded become a campaign that reads, or are refused by name."""

import numpy as np
import pytest

from testbed.cli.init import PUBLISHED
from testbed.files.campaign import load_campaign
from testbed.files.published_sets import SETS, published_campaign
from tests.support.export_files import run
from tests.support.real_data import MEASUREMENTS, needs

TURN = 2 * np.pi / 60


def read(name, folder, pattern, tmp_path):
    """The records of a set's files, by `testbed init` and the reader of campaigns."""
    files = sorted((MEASUREMENTS / folder).glob(pattern))
    assert files and run("init", *files, "--set", name, "-o", tmp_path / "new", "--quiet") == 0
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["campaign.yaml"]
    return load_campaign(tmp_path / "new" / "campaign.yaml").records


def test_the_command_offers_every_set():
    assert set(PUBLISHED) == set(SETS)


@needs("silverbox")
def test_silverbox(tmp_path):
    records = {record.name: record for record in read("silverbox", "silverbox", "*.csv", tmp_path)}
    arrow, multisine, schroeder = (records[name] for name in ("arrow", "multisine", "schroeder"))
    assert len(arrow.recording) + len(multisine.recording) == len(schroeder.recording) == 131072
    assert schroeder.recording.units == {"force": "V", "displacement": "V"}


@needs("milling_force")
def test_milling_force(tmp_path):
    records = read("milling-force", "milling_force", "*.csv", tmp_path)
    feeds = sorted(record.feed_per_tooth(2) for record in records)
    assert feeds == pytest.approx([0.025e-3, 0.05e-3, 0.075e-3, 0.1e-3, 0.125e-3])
    assert all(record.recording.sampling_rate == 10000.0 for record in records)


@needs("tap_test")
def test_tap_test(tmp_path):
    recording = read("tap-test", "tap_test", "impact*.txt", tmp_path)[0].recording
    assert recording.sampling_rate == 51200.0 and recording.channels["force"].max() == pytest.approx(250, rel=0.05)


@needs("milling_chatter")
def test_milling_chatter(tmp_path):
    record = read("milling-chatter", "milling_chatter", "data.mat", tmp_path)[0]
    assert record.conditions["spindle_speed"] == pytest.approx(5000 * TURN) and len(record.recording) > 30_000


@needs("titanium_milling")
def test_titanium_milling(tmp_path):
    records = read("titanium-milling", "titanium_milling", "*.mat", tmp_path)
    assert [record.conditions["axial_depth_of_cut"] for record in records] == pytest.approx([12e-3, 4e-3, 8e-3])
    for record in records:
        assert set(record.recording.channels) == {"acceleration_x", "acceleration_y"}
        assert record.recording.sampling_rate == pytest.approx(20e3, rel=1e-4) and len(record.recording) == 115501
        values = record.recording.channels["acceleration_x"]
        power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size))) ** 2
        order = np.fft.rfftfreq(values.size, 1 / 20e3) / (2600 / 60)
        share = power[np.abs(order - np.round(order)) < 0.02].sum() / power.sum()
        assert share > 0.1  # the rotation that the files state is heard: four times what lines at random places would hold


@needs("plate_hammer")
def test_plate_hammer(tmp_path):
    records = read("plate-hammer", "plate_hammer", "*_pt*.txt", tmp_path)
    assert len(records) == 2 and {len(record.recording) for record in records} == {4000}
    assert max(record.recording.channels["force"].max() for record in records) == pytest.approx(41.66001323)


def test_what_is_no_file_of_the_set_is_refused(tmp_path, capsys):
    (tmp_path / "other.csv").write_text("1,2\n")
    assert run("init", tmp_path / "other.csv", "--set", "silverbox", "-o", tmp_path / "new") == 2
    err = capsys.readouterr().err
    assert "is no file of the set silverbox" in err and err.count("\n") == 1 and not (tmp_path / "new").exists()
    assert run("init", tmp_path / "SNLS80mV.csv", "--set", "silverbox", "-o", tmp_path / "new") == 2
    assert "no such file" in capsys.readouterr().err
    assert run("init", "--set", "silverbox", "-o", tmp_path / "new") == 2 and "no file" in capsys.readouterr().err
    assert run("init", "--set", "gold", "-o", tmp_path / "new") == 2 and "gold" in capsys.readouterr().err


def test_paths_are_told_from_the_campaign(tmp_path):
    (tmp_path / "raw").mkdir()
    for name in ("accel_pt3.txt", "impact_pt3.txt"):
        (tmp_path / "raw" / name).write_text("0 1\n")
    files = [str(tmp_path / "raw" / name) for name in ("accel_pt3.txt", "impact_pt3.txt")]
    text = published_campaign("plate-hammer", files, tmp_path)
    assert "- {file: raw/accel_pt3.txt, kind: excited, channels: {force: {file: raw/impact_pt3.txt}}}" in text
    assert text.count("- {") == 1
