"""Files as measuring software writes them are read right, or refused in one line; never as other numbers, never silently."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from validation.vendor_files import judge

from testbed.files.campaign import load_campaign
from testbed.files.channel_units import channel_unit, is_channel_unit, unit_suffix
from testbed.problem import InputProblem
from testbed.readers import read_table
from testbed.readers.clock import seconds
from testbed.readers.table import Table, named
from testbed.readers.timebase import from_column
from testbed.units import UnitProblem
from tests.support.vendor_draws import Draw
from tests.support.vendor_files import KINDS
from tests.support.vendor_text import lvm_two_captures

REFUSED = {"two_files_of_two_rates", "uff_frequency_response", "text_frequency_response", "sensitivity"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_every_kind(kind: str, tmp_path: Path) -> None:
    found = judge(kind, 7, tmp_path)
    assert found.split()[0] == ("refused" if kind in REFUSED else "right"), found


def _campaign(folder: Path, **record) -> Path:
    (folder / "campaign.yaml").write_text(json.dumps({"name": "x", "records": [record]}))
    return folder / "campaign.yaml"


def test_captures_under_one_header_are_never_joined_unasked(tmp_path: Path) -> None:
    draw = Draw(3, tmp_path)
    made = lvm_two_captures(draw)
    lengths = {}
    for key in (None, "1", "2", "all"):
        table = read_table(tmp_path / made.name, key=key)
        lengths[key] = len(table.columns["Hammer (Trigger)"])
        assert any("captures" in note for note in table.notes)
    assert lengths == {None: draw.rows, "1": draw.rows, "2": draw.rows, "all": 2 * draw.rows}
    with pytest.raises(InputProblem, match="no capture '3': the file holds 2"):
        read_table(tmp_path / made.name, key="3")
    record = load_campaign(_campaign(tmp_path, file=made.name, kind="excited", key=2, channels=made.channels)).records[0]
    assert len(record.recording) == draw.rows


def test_chunks_of_one_measurement_whose_times_go_on_are_one_capture(tmp_path: Path) -> None:
    head = ("LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\t\nChannels\t1\t\nSamples\t100\t\n"
            "Y_Unit_Label\tVolts\t\nDelta_X\t0.001\t\n***End_of_Header***\t\t\nX_Value\ta\tComment\n")  # fmt: skip
    rows = [f"{number * 0.001:.6f}\t{np.sin(number):.6f}\n" for number in range(400)]
    (tmp_path / "one.lvm").write_text(head + "".join(rows))
    table = read_table(tmp_path / "one.lvm")
    assert len(table.columns["a"]) == 400 and not any("captures" in note for note in table.notes)
    (tmp_path / "two.lvm").write_text(head + "".join(rows[:100]) * 2)
    assert len(read_table(tmp_path / "two.lvm").columns["a"]) == 100


@pytest.mark.parametrize("form", ["%.2E", "%.3E", "%.4e", "%.4g", "%.6g", "%.3f", "%.4f"])
@pytest.mark.parametrize("rate", [4000.0, 12800.0, 610.3515625, 0.7])
@pytest.mark.parametrize("start", [0.0, 3.14159])
def test_times_printed_with_few_digits_are_even_or_too_few_to_tell(form: str, rate: float, start: float) -> None:
    time = np.array([float(form % moment) for moment in start + np.arange(4000) / rate])
    try:
        base = from_column(Path("t"), time, "t")
    except InputProblem as problem:
        assert "so few digits" in problem.what
        return
    assert abs(base.sampling_rate / rate - 1) <= 2 * base.error + 1e-9 and not base.dropped
    assert base.error <= 2e-3 and (base.error < 1e-6 or base.notes)


def test_a_missing_sample_is_seen_among_times_with_an_exponent() -> None:
    rows = np.delete(np.arange(4000), 1234)
    base = from_column(Path("t"), np.array([float(f"{row / 4000:.7E}") for row in rows]), "t")
    assert base.dropped == ((1234, 1),) and base.sampling_rate == pytest.approx(4000.0, rel=1e-6)


@pytest.mark.parametrize(("text", "unit"), [
    ("Newtons", "N"), ("Volts", "V"), ("g's", "g"), ("m/s2", "m/s^2"), ("Degrees", "deg"), ("m s^-2", "m/s^2"),
    ("U/min", "rpm"), ("meters per second squared", "m/s^2"), ("[KN]", "kN"), ("Pounds", "lbf"), ("ips", "in/s"), ("µm", "um"),
    ("mV/V", "1"), ("Counts", "1"), ("m/sec/sec", "m/s^2"), ("HZ", "Hz"), ("usec", "us"),
])  # fmt: skip
def test_units_as_software_writes_them(text: str, unit: str) -> None:
    assert channel_unit(text).text == unit


@pytest.mark.parametrize(("text", "said"), [
    ("mV/g", "sensitivity"), ("pC/N", "sensitivity"), ("dB", "level"), ("Nm", "unknown unit 'Nm'"), ("MN", "did you mean mN"),
    ("Trigger", "known here are N, daN, kN"), ("Nwetons", "known here are N"),
])  # fmt: skip
def test_what_is_no_unit_of_a_force(text: str, said: str) -> None:
    with pytest.raises(UnitProblem) as problem:
        channel_unit(text, "N")
    assert said in str(problem.value) and "revolutions" not in str(problem.value)


def test_a_name_s_unit() -> None:
    assert named("Fx [N]") == ("Fx", "N") and named("Kraft / N") == ("Kraft", "N") and named("Zeit in s") == ("Zeit", "s")
    assert named("Force, N") == ("Force", "N") and named("a / m/s²") == ("a", "m/s²") and named("m/s") == ("m/s", "")
    assert named("Response (Trigger)") == ("Response", "Trigger") and named("a [pC/g]") == ("a", "pC/g")
    assert named("Fx [N] (filtered)")[1] == "N"
    assert unit_suffix("acc_g", "m/s^2") == "g" and unit_suffix("vel_mm_s", "m/s") == "mm/s"
    assert not any(unit_suffix(name, "m") for name in ("x_in", "disp_1", "disp_g", "x_min"))
    assert not is_channel_unit("12") and not is_channel_unit("")


def test_times_of_day() -> None:
    assert list(seconds(["23:59:59.5", "00:00:00.5"])) == [0.0, 1.0]
    assert list(seconds(["31.12.2019 23:59:59", "01.01.2020 00:00:01"])) == [0.0, 2.0]
    assert list(seconds(["12:59:59 AM", "1:00:00 AM"])) == [0.0, 1.0] and list(seconds(["00:01.5", "00:02,0"])) == [0.0, 0.5]
    assert seconds(["10:00:00", "later"]) is None


def test_a_column_is_counted_as_it_stands_in_the_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("shot,x,y\n" + "".join(f"no {number},{number},{-number}\n" for number in range(40)))
    table = read_table(tmp_path / "a.csv")
    assert table.find(2) == "x" and table.find(3) == "y"
    with pytest.raises(InputProblem, match="'shot' is there, but holds text"):
        table.find(1)


def test_a_refusal_lists_a_dozen_names_and_how_many_more() -> None:
    table = Table(Path("x"), {f"set_{number}": np.arange(9.0) for number in range(300)})
    with pytest.raises(InputProblem, match="and 288 more") as problem:
        table.find("force")
    assert len(str(problem.value)) < 250


def test_two_files_must_begin_together(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for name, start in (("f.txt", 0.0), ("late.txt", 0.01), ("a.txt", 0.0)):
        values = enumerate(rng.standard_normal(400))
        (tmp_path / name).write_text("".join(f"{start + k / 1000:.6f}\t{v:.6f}\n" for k, v in values))
    channels = {"time": {"column": 1, "unit": "s"}, "acceleration": {"column": 2, "unit": "g"}}
    for force, said in (("late.txt", "begins at 0.01 s, a.txt at 0 s"), ("none.txt", "no such file none.txt")):
        channels["force"] = {"file": force, "column": 2, "unit": "N"}
        record = {"file": "a.txt", "kind": "excited", "channels": channels}
        with pytest.raises(InputProblem, match=said):
            load_campaign(_campaign(tmp_path, **record))


def test_a_day_number_is_no_time_in_seconds(tmp_path: Path) -> None:
    rows = "".join(f"{43831.4166666667 + k / 86400e3:.10f},{np.sin(k):.5f}\n" for k in range(400))
    (tmp_path / "a.csv").write_text("Time,x [um]\n" + rows)
    with pytest.raises(InputProblem, match="day numbers of a spreadsheet"):
        load_campaign(_campaign(tmp_path, file="a.csv", kind="ring-down", channels={"displacement": {"column": "x"}}))
