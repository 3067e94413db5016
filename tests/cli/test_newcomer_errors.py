"""What a newcomer gets wrong: each mistake ends in one clear line and exit code 2, or in the right numbers with a note."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from testbed.cli import main
from testbed.files.campaign import load_campaign
from testbed.problem import InputProblem

RATE = 12800
HEAD = (
    "name: rig\nsampling_rate: 12800 Hz\nchannels:\n  displacement: {column: x, unit: um}\n"
    "  tachometer: {column: tach, unit: V}\nrecords:\n"
)
CUT = "  - {file: cut.csv, kind: cut, spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm, feed: 0.1 mm/tooth}\n"
MODEL = (
    "structure: {mass: 2.573 kg, natural_frequency: 147.5 Hz, damping_ratio: 0.005}\n"
    "cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}\n"
    "cutting:\n  direction: up-milling\n  immersion: 0.162\n"
    "  tangential_coefficient: 600 N/mm^2\n  normal_coefficient: 180 N/mm^2\n"
)


def rows(count: int = 6400) -> list[str]:
    """Displacement (um) and a tachometer (V) that pulses once a turn, as lines of text."""
    time, turning = np.arange(count) / RATE, 3810 / 60
    noise = np.random.default_rng(1).standard_normal(count)
    x = 20 * np.sin(2 * np.pi * 147 * time) + noise
    return [f"{one:.3f},{5 if tach else 0}" for one, tach in zip(x, (turning * time) % 1 < 0.1, strict=True)]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cut.csv").write_text("\n".join(["x,tach", *rows()]) + "\n")
    (tmp_path / "campaign.yaml").write_text(HEAD + CUT)
    (tmp_path / "model.yaml").write_text(MODEL)
    return tmp_path


def cut_to(count: int) -> tuple[str, str]:
    return "cut.csv", "\n".join(["x,tach", *rows(count)]) + "\n"


def changed(old: str, new: str) -> tuple[str, str]:
    assert old in HEAD + CUT
    return "campaign.yaml", (HEAD + CUT).replace(old, new)


def with_row(row: str) -> tuple[str, str]:
    return "cut.csv", "\n".join(["x,tach", *rows()[:5000], row, *rows()[5001:]]) + "\n"


MISTAKES = {
    "misspelt key": (changed("spindle_speed", "spindlespeed"), "did you mean spindle_speed"),
    "missing column": (changed("column: x", "column: y"), "the file has 'x', 'tach'"),
    "unknown unit": (changed("unit: um", "unit: furlong"), "unknown unit 'furlong'"),
    "unit of another kind": (changed("unit: um", "unit: N"), "cannot be in N"),
    "no unit": (changed(", unit: um", ""), "no unit"),
    "feed without unit": (changed("0.1 mm/tooth", "0.1"), "is no feed"),
    "wrong delimiter": (changed("kind: cut", "kind: cut, delimiter: ';'"), "give `delimiter`"),
    "no sampling rate": (changed("sampling_rate: 12800 Hz\n", ""), "no sampling rate"),
    "no records": (("campaign.yaml", HEAD.replace("records:", "records: []")), "records: is empty: name at least one"),
    "records without a record": (("campaign.yaml", HEAD), "records: holds no record: write under it"),
    "records without a dash": (("campaign.yaml", HEAD + CUT.replace("- ", "  ")), "begin each record with a dash"),
    "an edge of another word": (changed("unit: V", "unit: V, edge: up"), ":5: channels.tachometer.edge: 'up' is not"),
    "a channel that is no mapping": (changed("{column: tach, unit: V}", "tach"), "channels.tachometer: 'tach' is not a"),
    "a negative feed": (changed("0.1 mm/tooth", "-0.1 mm/tooth"), "'-0.1 mm/tooth' must be above 0"),
    "a decimal comma": (changed("12800 Hz", "12,8 kHz"), "write a decimal point: 12.8 kHz"),
    "a decimal comma of the feed": (changed("0.1 mm/tooth", "'0,1 mm/rev'"), "write a decimal point: 0.1 mm/rev"),
    "a decimal comma between braces": (changed("2.9 mm", "2,9 mm"), "7: records.0: depth_of_cut '2,9 mm' holds a comma"),
    "decimal commas between commas": (
        ("cut.csv", "\n".join(["x,tach", *(row.replace(".", ",") for row in rows())])),
        "under 'x', 'tach': if its commas are decimal ones, write decimals with a point"),
    "decimal commas beside decimal points": (
        ("cut.csv", "\n".join(["x,tach", *(row.replace(".", ",", 1) + ".5" for row in rows())])),
        "more fields than names: 3 in a line under 'x', 'tach': if its commas are decimal ones, write decimals with a point"),
    "decimal commas beside whole numbers": (
        ("cut.csv", "\n".join(["x,tach", *(row.replace(".", ",", 1) + ".5" for row in rows()), "7,1.5", *["7,8,1.5"] * 9])),
        "2 fields where the table has 3: '7,1.5': if its commas are decimal ones"),
    "a factor of 0": (changed("unit: um", "unit: um, scale: 0"), ":4: channels.displacement.scale: '0' is no factor"),
    "a factor that is none": (changed("unit: um", "unit: um, scale: .nan"), "displacement.scale: 'nan' is no factor: give a"),
    "a column that is none": (changed("column: x", "column: 1.5"), ":4: channels.displacement.column: '1.5' is no column"),
    "a cut of no depth": (changed("2.9 mm", "0 mm"), ":7: records.0.depth_of_cut: a cut of depth 0 cuts nothing: correct it"),
    "a cut of no depth for all": (
        ("campaign.yaml", HEAD.replace("records:", "depth_of_cut: 0 mm\nrecords:") + CUT.replace("depth_of_cut: 2.9 mm, ", "")),
        "campaign.yaml:6: depth_of_cut: a cut of depth 0 cuts nothing"),
    "a depth in metres": (changed("2.9 mm", "2.9 m"), "depth_of_cut: '2.9 m' lies beyond 500 mm: is the unit right?"),
    "more flutes than any cutter has": (changed("kind: cut", "kind: cut, flutes: 101"), "'101' is more than any cutter has"),
    "a key of a text": (changed("kind: cut", "kind: cut, key: x"), "7: records.0.key: cut.csv has no variables that a key"),
    "a key of texts alone": (changed("records:", "key: x\nrecords:"), "6: key: no record's file has variables that a key"),
    "a name that is no text": (changed("name: rig", "name: 5"), ":1: name: '5' is no text: write a text, in quotes"),
    "a name that no file has": (changed("file: cut.csv", "file: " + 300 * "x"), "no such file xxx"),
    "a name that is none": (changed("file: cut.csv", 'file: "a\\0b/c.csv"'), "no such file a"),
    "a file elsewhere": (changed("file: cut.csv", "file: /etc/host"), "/etc/host: check the path in campaign.yaml"),
    "a file of another ending": (changed("file: cut.csv", "file: cut.mat"), "cut.mat: check the path in campaign.yaml"),
    "a column without a name": (
        ("cut.csv", "\n".join(["x,tach", *(f"{row},7.5" for row in rows())])), "more fields than names: 3 in a line"),
    "a name without a column": (("cut.csv", "\n".join(["x,tach,z", *rows()])), "fewer fields than names: 2 in a line"),
    "all rows skipped": (changed("kind: cut", "kind: cut, skip_rows: 99999"), "leaves nothing of 6401 lines"),
    "a tab": (changed("  displacement", "\tdisplacement"), "spaces instead of tabs"),
    "a folder for a file": (changed("file: cut.csv", "file: ."), "is a folder"),
    "a file that is not there": (changed("file: cut.csv", "file: cat.csv"), "did you mean cut.csv"),
    "NaN": (with_row("nan,0"), "sample 5001"),
    "an empty field": (with_row(",0"), "sample 5001"),
    "a word": (with_row("OVL,0"), "cut.csv:5002"),
    "an empty file": (("cut.csv", ""), "the file is empty"),
    "a header alone": (("cut.csv", "x,tach\n"), "no table of numbers"),
    "a workbook": (("cut.csv", "PK\x03\x04" + "\x00" * 200), "not a text table"),
    "less than a revolution": (cut_to(150), "0.74 revolutions at 3810 rpm"),
    "next to nothing": (cut_to(9), "holds only 9 samples"),
    "time that runs back": (
        ("cut.csv", "\n".join(["t [s],x,tach", *(f"{(place if place < 3000 else place - 900) / RATE:.7f},{row}"
                                                   for place, row in enumerate(rows()))])), "runs back at row 3001"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
@pytest.mark.parametrize("command", [("inspect", "campaign.yaml"), ("compare", "campaign.yaml", "-m", "model.yaml")])
def test_a_mistake_is_one_line_and_exit_2(
    name: str, command: tuple[str, ...], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (file, text), said = MISTAKES[name]
    (folder / file).write_text(text)
    with pytest.raises(SystemExit) as stop:
        main([*command, "--quiet"])
    out, err = capsys.readouterr()
    assert stop.value.code == 2 and out == ""
    assert err.startswith("error: ") and err.count("\n") == 1 and said in err


def test_a_packed_file_is_to_be_unpacked_and_a_pipe_is_no_file(folder: Path) -> None:
    (folder / "cut.csv").write_bytes(gzip.compress((folder / "cut.csv").read_bytes()))
    with pytest.raises(InputProblem, match="cut.csv: is packed with gzip: unpack it first"):
        load_campaign("campaign.yaml")
    (folder / "cut.csv").unlink()
    os.mkfifo(folder / "cut.csv")  # nobody writes into it: opened, it would never end
    with pytest.raises(InputProblem, match="cut.csv: is a pipe or a device, no file"):
        load_campaign("campaign.yaml")


def test_what_is_near_is_looked_for_within_the_campaigns_own_folder_alone(folder: Path) -> None:
    (folder / "rig").mkdir()
    (folder / "rig" / "campaign.yaml").write_text((HEAD + CUT).replace("file: cut.csv", "file: ../cat.csv"))
    with pytest.raises(InputProblem) as caught:
        load_campaign("rig/campaign.yaml")
    assert caught.value.do == "check the path in campaign.yaml"


WRITTEN = {
    "semicolon and decimal comma": lambda text: text.replace(",", ";").replace(".", ","),
    "byte-order mark": lambda text: "\ufeff" + text,
    "windows line ends": lambda text: text.replace("\n", "\r\n"),
    "tabs": lambda text: text.replace(",", "\t"),
}


@pytest.mark.parametrize("way", WRITTEN)
def test_another_way_of_writing_gives_the_same_numbers(way: str, folder: Path) -> None:
    plain = load_campaign("campaign.yaml").records[0].recording
    text = (folder / "cut.csv").read_text()
    (folder / "cut.csv").write_text(WRITTEN[way](text), encoding="utf-8", newline="")
    other = load_campaign("campaign.yaml").records[0].recording
    assert np.array_equal(plain.channels["displacement"], other.channels["displacement"])
    assert np.array_equal(plain.marks, other.marks) and len(plain.marks) > 20


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("2.9 mm", "29 cm", "depth of cut 290 mm: is the unit right?"),
        ("0.1 mm/tooth", "0.1 m/tooth", "feed 100 mm: is the unit right?"),
        ("0.1 mm/tooth", "387 m/min", "is the unit right?"),
        ("3810 rpm", "3810 rev/s", "spindle speed 228600 rpm: is the unit right?"),
        ("3810 rpm", "1000 rpm", "found 3810"),
        ("unit: um", "unit: mm", "moves by"),
        ("12800 Hz", "1280 Hz", "found 381"),
    ],
)
def test_what_is_hardly_meant_is_noted(old: str, new: str, said: str, folder: Path) -> None:
    assert load_campaign("campaign.yaml").notes == ()
    (folder / "campaign.yaml").write_text((HEAD + CUT).replace(old, new))
    assert any(said in note for note in load_campaign("campaign.yaml").notes)


def test_a_feed_in_mm_a_minute_is_a_feed_a_tooth(folder: Path) -> None:
    (folder / "campaign.yaml").write_text((HEAD + CUT).replace("0.1 mm/tooth", "381 mm/min"))
    campaign = load_campaign("campaign.yaml")
    assert campaign.records[0].cut(1).feed_per_tooth == pytest.approx(0.1e-3) and campaign.notes == ()


def test_one_measurement_named_twice_is_noted(folder: Path) -> None:
    (folder / "copy.csv").write_text((folder / "cut.csv").read_text())
    (folder / "campaign.yaml").write_text(HEAD + CUT + CUT.replace("cut.csv", "copy.csv"))
    assert any("copy: holds the same samples as record 'cut'" in note for note in load_campaign("campaign.yaml").notes)


@pytest.mark.parametrize(
    ("head", "per_second", "said"),
    [("t", 1e3, "{column: t, unit: ms}"), ("t", 1e6, "{column: t, unit: us}"), ("t [s]", 1e3, "{column: t, unit: ms}"),
     ("time_ms", 1.0, "{column: time_ms, unit: s}"), ("elapsed time", 1e3, '{column: "elapsed time", unit: ms}')],
)  # fmt: skip
def test_a_time_column_in_another_unit_is_named_and_the_advice_works(
    head: str, per_second: float, said: str, folder: Path
) -> None:
    lines = (f"{place / RATE * per_second:.7f},{row}" for place, row in enumerate(rows()))
    (folder / "cut.csv").write_text("\n".join([f"{head},x,tach", *lines]) + "\n")
    with pytest.raises(InputProblem) as caught:
        load_campaign("campaign.yaml")
    assert f"write `time: {said}` under `channels`" in caught.value.do
    (folder / "campaign.yaml").write_text(HEAD.replace("channels:\n", f"channels:\n  time: {said}\n") + CUT)
    recording = load_campaign("campaign.yaml").records[0].recording
    assert recording.sampling_rate == RATE and len(recording.marks) > 20


def test_rates_that_differ_by_no_power_of_1000_are_no_matter_of_units(folder: Path) -> None:
    lines = (f"{place / 12.6:.7f},{row}" for place, row in enumerate(rows()))
    (folder / "cut.csv").write_text("\n".join(["t,x,tach", *lines]) + "\n")
    with pytest.raises(InputProblem, match="remove `sampling_rate`, or set `time: none`"):
        load_campaign("campaign.yaml")
