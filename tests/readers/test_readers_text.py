"""Text tables of every kind read to the same numbers, and everything else refused with its place."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from testbed.problem import InputProblem
from testbed.readers import read_table

TIME = np.arange(40) / 51200
DISP = np.round(np.sin(0.3 * np.arange(40)) * 12.5, 4)


def _file(tmp_path: Path, content: str | bytes, name: str = "table.txt") -> Path:
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def _rows(delimiter: str = ",", end: str = "\n", tail: str = "", number: str = "{:.9e}") -> str:
    return "".join(f"{number.format(t)}{delimiter}{d:.4f}{tail}{end}" for t, d in zip(TIME, DISP, strict=True))


JUNK = "".join(f"Setting {number}:,{'x' * number}\n" for number in range(18))
KINDS = {
    "plain": "time,disp\n" + _rows(),
    "units row": "time,disp\ns,um\n" + _rows(),
    "units in names": "time [s];disp (um)\r\n" + _rows(";", "\r\n"),
    "quoted": '"time","disp"\n' + _rows(),
    "trailing comma": '"time","disp",\n' + _rows(tail=","),
    "white space": "  time   disp\n" + _rows("    "),
    "twenty junk lines": "DynoWare,Version 2\n" + JUNK + "time,disp\ns,um\n" + _rows(),
    "three-digit exponents": "time\tdisp\n" + _rows("\t").replace("e-05", "e-005").replace("e-04", "e-004"),
    "decimal comma": ("time\tdisp\n" + _rows("\t")).replace(".", ","),
    "decimal comma, semicolons": ("time;disp\n" + _rows(";")).replace(".", ","),
    "sep line": "sep=;\ntime;disp\n" + _rows(";"),
    "comment sign": "# time disp\n" + _rows(" "),
    "blank lines": "\n\ntime,disp\n\n" + _rows(end="\n\n"),
    "old Mac line ends": "time,disp\r" + _rows(end="\r"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_way_of_writing_a_table_gives_the_same_numbers(kind: str, tmp_path: Path) -> None:
    table = read_table(_file(tmp_path, KINDS[kind]))
    assert list(np.round(table.columns[table.find("disp")], 4)) == list(DISP)
    assert np.allclose(table.columns[table.find("time")], TIME, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
def test_encodings(encoding: str, tmp_path: Path) -> None:
    table = read_table(_file(tmp_path, ("time [s],weg [µm]\n" + _rows()).encode(encoding)))
    assert list(table.columns[table.find("weg")]) == list(DISP)
    assert table.units[table.find("weg")] == "µm"


def test_a_file_without_header_names_its_columns_by_number_and_says_so(tmp_path: Path) -> None:
    table = read_table(_file(tmp_path, _rows("\t")))
    assert list(table.columns) == ["1", "2"] and list(table.columns[table.find(2)]) == list(DISP)
    assert any("no header" in note for note in table.notes)


def test_empty_fields_are_nan_and_flag_columns_are_kept(tmp_path: Path) -> None:
    rows = "".join(f"{',' if index else '0,0'},{value}\n".replace(",,", ",,") for index, value in enumerate(DISP))
    table = read_table(_file(tmp_path, "over1,over2,disp\n" + rows.replace("\n,", "\n,")))
    assert np.isnan(table.columns["over1"][1:]).all() and list(table.columns["disp"]) == list(DISP)


@pytest.mark.parametrize(
    ("line", "rate", "tolerance"),
    [
        ("Sampling rate [Hz]:,12800", 12800.0, 0.0),
        ("Sample Rate (kHz);25.6", 25600.0, 2e-3),
        ("fs = 51200", 51200.0, 0.0),
        ("Delta_X\t0.000078", 1 / 0.000078, 6.5e-3),
        ("Delta_X\t7.812500E-5", 12800.0, 1e-7),
    ],
)
def test_the_rate_in_the_junk_above_and_its_rounding(line: str, rate: float, tolerance: float, tmp_path: Path) -> None:
    table = read_table(_file(tmp_path, line + "\nchannels,2\na,b\n" + _rows()))
    assert table.sampling_rate == pytest.approx(rate, rel=1e-12)
    assert table.rate_tolerance == pytest.approx(tolerance, rel=0.1, abs=1e-7)


@pytest.mark.parametrize("word", ["OVL", "overload", "###", "1.2.3", "1_000", "0x1F", "12 800"])
def test_what_is_no_number_is_refused_with_its_line_and_column(word: str, tmp_path: Path) -> None:
    lines = ("time,disp\n" + _rows()).splitlines()
    lines[21] = f"0.000390625,{word}"
    with pytest.raises(InputProblem) as caught:
        read_table(_file(tmp_path, "\n".join(lines) + "\n"))
    assert caught.value.line == 22 and "disp" in caught.value.what and word in caught.value.what
    assert ("overloaded" in caught.value.do) == (word in ("OVL", "overload"))


def test_a_ragged_line_and_a_second_header_are_refused_with_their_line(tmp_path: Path) -> None:
    for bad in ("0.1", "0.1,2,3", "time,disp"):
        lines = ("time,disp\n" + _rows()).splitlines()
        lines[30] = bad
        with pytest.raises(InputProblem) as caught:
            read_table(_file(tmp_path, "\n".join(lines) + "\n"))
        assert caught.value.line == 31


def test_a_cut_off_last_line_is_dropped_with_a_note(tmp_path: Path) -> None:
    text = "time,disp\n" + _rows()
    dropped = read_table(_file(tmp_path, text.rstrip("\n").rpartition(",")[0]))
    assert len(dropped.columns["disp"]) == 39 and any("cut off" in note for note in dropped.notes)
    assert not any("cut off" in note for note in read_table(_file(tmp_path, text.rstrip("\n"))).notes)


def test_a_last_number_cut_off_anywhere_is_never_read_as_another(tmp_path: Path) -> None:
    """2.117151e-11 ends as 2.117151e-1, as 2.117151e-, as 2."""
    values = 1e-11 * np.sin(np.arange(1.0, 41.0))
    text = "time,disp\n" + "".join(f"{0.001 * row:.4f},{value:.6e}\n" for row, value in enumerate(values))
    whole = read_table(_file(tmp_path, text)).columns["disp"]
    for gone in range(2, len(f"{values[-1]:.6e}") + 1):
        found = read_table(_file(tmp_path, text[:-gone]))
        assert np.array_equal(found.columns["disp"], whole[:-1])
        assert any("line 41, the last, is cut off and was dropped" in note for note in found.notes)


def test_a_comma_that_is_both_delimiter_and_decimal_point_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputProblem, match="both delimiter and decimal"):
        read_table(_file(tmp_path, "time,disp\n" + _rows(number="{:.9f}").replace(".", ",")))


def test_doubled_names_are_made_distinct_and_text_columns_left_out(tmp_path: Path) -> None:
    rows = "".join(f"shot {index};{value};{2 * value}\n" for index, value in enumerate(DISP))
    table = read_table(_file(tmp_path, "shot;disp;disp\n" + rows))
    assert list(table.columns) == ["disp", "disp_2"]
    assert any("shot" in note for note in table.notes) and any("disp_2" in note for note in table.notes)


def test_skip_rows_and_delimiter_override_what_is_found(tmp_path: Path) -> None:
    path = _file(tmp_path, "1,2\n3,4\n5,6\n" + "time,disp\n" + _rows())
    assert len(read_table(path, skip_rows=3).columns["disp"]) == 40
    assert list(read_table(path, skip_rows=3, delimiter="comma").columns) == ["time", "disp"]


@pytest.mark.parametrize(
    ("content", "name", "said"),
    [
        (b"", "a.csv", "empty"),
        (b"\n\n\n", "a.csv", "empty"),
        (b"only words here\nand here\n", "a.csv", "no table"),
        (bytes(range(256)) * 20, "a.csv", "binary"),
        (b"\x80\x04]", "a.pkl", "pickle"),
        (b"x", "a.npy", "numpy"),
        (b"not hdf5 at all", "a.h5", "HDF5"),
        (b"nothing", "a.mat", "MAT"),
        (b"RIFFxxxxWAVE", "a.wav", "WAV"),
        (b"nothing", "a.parquet", "Parquet"),
        (b"nothing", "a.tdms", "TDMS"),
        (b"nothing", "a.uff", "universal"),
    ],
)
def test_files_that_are_no_data_are_refused_in_one_line(content: bytes, name: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputProblem) as caught:
        read_table(_file(tmp_path, content, name))
    assert said.lower() in str(caught.value).lower() and "\n" not in str(caught.value)


def test_a_missing_file_names_its_nearest_neighbour(tmp_path: Path) -> None:
    _file(tmp_path, KINDS["plain"], "cut_1.csv")
    with pytest.raises(InputProblem, match=r"did you mean cut_1\.csv"):
        read_table(tmp_path / "cut1.csv")


def test_a_missing_column_lists_those_there_are(tmp_path: Path) -> None:
    table = read_table(_file(tmp_path, KINDS["units in names"]))
    with pytest.raises(InputProblem, match=r"'time \[s\]', 'disp \(um\)'"):
        table.find("dsip")
    assert table.find("disp") == table.find("DISP") == table.find(2) == "disp (um)"


@pytest.mark.parametrize("rest", ["0.5", "0.5,", "0.5,3", "0.5,3,"])
def test_a_last_line_that_was_cut_off_is_dropped_and_said(rest: str, tmp_path: Path) -> None:
    path = tmp_path / "cut.csv"
    path.write_text("t [s],x [um],y [V]\n" + "".join(f"{k / 100:.2f},{k},{k % 3}.5\n" for k in range(50)) + rest)
    table = read_table(path)
    assert all(len(values) == 50 and np.isfinite(values).all() for values in table.columns.values())
    assert any("cut off and was dropped" in note for note in table.notes)


WHOLE = "if its commas are decimal ones, write decimals with a point, or separate columns by semicolons"


@pytest.mark.parametrize(
    ("head", "row"),
    [("x", "-3,96{}"), ("a", "-3,96{}"), ("x,tach", "18,12{},0"), ("x,tach\num,V", "18,12{},0"), ("t,x,y", "0,1,12{},7,5")],
)
def test_decimal_commas_between_commas_are_never_read_as_columns(head: str, row: str, tmp_path: Path) -> None:
    text = head + "\n" + "".join(row.format(index % 10) + "\n" for index in range(60))
    with pytest.raises(InputProblem) as caught:
        read_table(_file(tmp_path, text))
    assert caught.value.what.startswith("more fields than names") and caught.value.do.startswith(WHOLE)


def test_a_single_column_with_a_decimal_comma_is_read_where_the_delimiter_is_given(tmp_path: Path) -> None:
    path = _file(tmp_path, "x\n" + "".join(f"{value:.4f}\n" for value in DISP).replace(".", ","))
    assert list(read_table(path, delimiter=";").columns["x"]) == list(DISP)


@pytest.mark.parametrize(
    ("head", "said"), [("time", "more fields than names: 2"), ("time,disp,c", "fewer fields than names: 2")]
)
def test_names_that_do_not_fit_the_columns_are_said_when_one_is_asked_for(head: str, said: str, tmp_path: Path) -> None:
    table = read_table(_file(tmp_path, head + "\n" + _rows()))
    assert list(table.columns) == ["1", "2"] and any("that fits the 2 columns" in note for note in table.notes)
    with pytest.raises(InputProblem, match=said):
        table.find("Time")
    with pytest.raises(InputProblem, match="the file has '1', '2'"):
        table.find("force")


def test_a_trailing_delimiter_of_the_numbers_alone_and_a_short_unit_row_fit(tmp_path: Path) -> None:
    assert list(read_table(_file(tmp_path, "time,disp\n" + _rows(tail=","))).columns) == ["time", "disp"]
    table = read_table(_file(tmp_path, "time,disp,flag\ns,um\n" + _rows(tail=",1")))
    assert dict(table.units) == {"time": "s", "disp": "um", "flag": ""} and list(table.columns["disp"]) == list(DISP)


def test_skip_rows_beyond_the_end_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputProblem, match="skip_rows: 99 leaves nothing of 41 lines: skip fewer lines"):
        read_table(_file(tmp_path, KINDS["plain"]), skip_rows=99)


def test_skip_rows_takes_a_line_of_words_for_no_header(tmp_path: Path) -> None:
    path = _file(tmp_path, "counts\n" + "".join(f"{index},7\n" for index in range(40)))
    assert list(read_table(path, skip_rows=1).columns) == ["1", "2"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
@pytest.mark.parametrize("kind", KINDS)
def test_blocks_that_end_anywhere_read_as_the_whole(kind: str, encoding: str, tmp_path: Path, monkeypatch) -> None:
    text = KINDS[kind].replace("disp", "Weg µ").replace("-", "\N{MINUS SIGN}" if encoding != "cp1252" else "-")
    path = _file(tmp_path, text.encode(encoding))
    whole = read_table(path)
    monkeypatch.setattr("testbed.readers.lines._BLOCK", 7)
    monkeypatch.setattr("testbed.readers.lines._AT_ONCE", 3)
    monkeypatch.setattr("testbed.readers.text._AT_ONCE", 5)
    blocks = read_table(path)
    assert list(blocks.columns) == list(whole.columns) and blocks.units == whole.units and blocks.notes == whole.notes
    assert all(np.array_equal(blocks.columns[name], whole.columns[name]) for name in whole.columns)


def test_reading_takes_a_small_multiple_of_the_file(tmp_path: Path) -> None:
    rows = "".join(f"{number / 51200:.9f},{np.sin(number):.6f},{number % 7}\n" for number in range(250_000))
    path = _file(tmp_path, "time,disp,tach\n" + rows)
    tracemalloc.start()
    read_table(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3.5 * path.stat().st_size


def test_a_file_that_needs_more_memory_than_is_free_is_refused_with_the_size(tmp_path: Path, monkeypatch) -> None:
    path = _file(tmp_path, KINDS["plain"])
    monkeypatch.setattr("testbed.files.door.free_memory", lambda: 700.0)
    with pytest.raises(InputProblem, match=r"needs 1.7e-06 GB of memory, 7e-07 GB are free: free some"):
        read_table(path)
