"""Binary formats: the numbers, units and rates that were written come back; unsafe and odd files are refused."""

from __future__ import annotations

import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from testbed.problem import InputProblem
from testbed.readers import read_table, rehearsal
from testbed.readers.assemble import assemble
from tests.support.made_files import FORMATS, RATE, signals, sources, stated_rate, write


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_gives_the_same_recording(kind: str, tmp_path: Path) -> None:
    recording, _ = assemble(read_table(write(kind, tmp_path)), sources(kind), sampling_rate=stated_rate(kind))
    disp, force = signals()
    step = 1 / 800 if kind == "wav" else 1e-9
    assert recording.sampling_rate == RATE and recording.units == {"displacement": "m", "force": "N"}
    assert np.abs(recording.channels["displacement"] * 1e6 - disp).max() <= step
    assert np.abs(recording.channels["force"] - force).max() <= 2 * step


@pytest.mark.parametrize(("kind", "module"), [("tdms", "nptdms"), ("uff", "pyuff"), ("parquet", "pyarrow")])
def test_a_missing_package_names_the_extra(
    kind: str, module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(kind, tmp_path)
    for name in [name for name in sys.modules if name.split(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputProblem, match=r"pip install .*\[formats\]"):
        read_table(path)


def test_a_struct_field_of_a_mat_file_is_read_by_its_path(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, {"run": {"rig": {"disp": np.arange(50.0)}, "note": "x"}})
    with pytest.raises(InputProblem, match="no numeric array"):
        read_table(path)
    assert list(read_table(path, key="run.rig.disp").columns["run.rig.disp"]) == list(range(50))
    with pytest.raises(InputProblem, match="it has rig, note"):
        read_table(path, key="run.rg")
    with pytest.raises(InputProblem, match="no variable 'rum'"):
        read_table(path, key="rum")


SHORT, LONG = np.arange(20.0), np.arange(50.0)


def _file_of(kind: str, path: Path) -> Path:
    """A file whose column `long` is sound, while short, text, cube and none are there, but no columns beside it."""
    odd = {"short": SHORT, "text": "hello", "cube": np.zeros((3, 3, 3))}
    if kind == "mat":
        scipy.io.savemat(path, {"long": LONG, **odd})
    elif kind == "hdf5":
        with h5py.File(path, "w") as file:
            for name, value in {"long": LONG, **odd, "none": np.zeros(0)}.items():
                file[f"rig/{name}"] = value
    elif kind == "mat73":
        with h5py.File(path, "w", userblock_size=512) as file:
            kinds = ("long", LONG, b"double"), ("short", SHORT, b"double"), ("text", SHORT.astype("u2"), b"char")
            for name, value, sort in kinds:
                file.create_dataset(name, data=value[None, :]).attrs["MATLAB_class"] = np.bytes_(sort)
        with path.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    elif kind == "tdms":
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(path) as writer:
            writer.write_segment([ChannelObject("rig", "long", LONG), ChannelObject("rig", "text", ["a", "b"])])
    elif kind == "parquet":
        import pyarrow as arrow
        import pyarrow.parquet as parquet

        parquet.write_table(arrow.table({"long": LONG, "text": ["a"] * 50}), path)
    else:
        path.write_text("long,text [um]\n" + "".join(f"{value},high\n" for value in LONG))
    return path


@pytest.mark.parametrize(
    ("kind", "name", "said"),
    [
        ("mat", "short", "'short' is there, but has 20 values against 50"), ("mat", "text", "is not numeric (char)"),
        ("mat", "cube", "has 3 axes (3 x 3 x 3)"), ("hdf5", "short", "has 20 values against 50"),
        ("hdf5", "rig/short", "has 20 values against 50"), ("hdf5", "text", "'text' is there, but is not numeric (text)"),
        ("hdf5", "cube", "has 3 axes (3 x 3 x 3)"), ("hdf5", "none", "is empty"),
        ("mat73", "short", "has 20 values against 50"), ("mat73", "text", "is not numeric (char)"),
        ("tdms", "text", "is not numeric"), ("parquet", "text", "is not numeric (string)"),
        ("csv", "text", "'text [um]' is there, but holds text"), ("mat", "gone", "no column 'gone': the file has 'long'"),
    ],
)  # fmt: skip
def test_what_is_in_the_file_but_no_column_is_said_to_be_there(kind: str, name: str, said: str, tmp_path: Path) -> None:
    ending = {"hdf5": "h5", "mat73": "mat"}.get(kind, kind)
    table = read_table(_file_of(kind, tmp_path / f"odd.{ending}"))
    assert list(table.columns[table.find("long")]) == list(LONG)
    with pytest.raises(InputProblem) as caught:
        table.find(name)
    assert said in str(caught.value)


def test_an_hdf5_file_without_a_number_says_what_it_holds_instead(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "odd.h5", "w") as file:
        file["rig/note"], file["disp"] = "hello", np.zeros(0)
    with pytest.raises(InputProblem, match="no numeric data set: .*disp is empty; rig/note is not numeric"):
        read_table(tmp_path / "odd.h5")


def test_a_matrix_becomes_columns_along_its_longer_axis(tmp_path: Path) -> None:
    values = np.arange(120.0).reshape(40, 3)
    scipy.io.savemat(tmp_path / "wide.mat", {"data": values.T})
    table = read_table(tmp_path / "wide.mat")
    assert list(table.columns) == ["data_1", "data_2", "data_3"] and list(table.columns["data_2"]) == list(values[:, 1])


def test_matlab_73_arrays_are_transposed_and_hdf5_groups_are_picked_by_key(tmp_path: Path) -> None:
    values = np.arange(120.0).reshape(40, 3)
    path = tmp_path / "new.mat"
    with h5py.File(path, "w") as file:
        file.create_dataset("data", data=values.T).attrs["MATLAB_class"] = np.bytes_(b"double")
        file.create_dataset("words", data=np.arange(40, dtype=np.uint16)).attrs["MATLAB_class"] = np.bytes_(b"char")
    assert list(read_table(path).columns["data_3"]) == list(values[:, 2])
    path = tmp_path / "two.h5"
    with h5py.File(path, "w") as file:
        file["first/disp"], file["second/disp"] = np.arange(30.0), np.arange(30.0) + 7
    assert list(read_table(path, key="second").columns["disp"])[0] == 7
    with pytest.raises(InputProblem, match="the file has first/disp, second/disp"):
        read_table(path, key="third")


def test_an_hdf5_file_that_points_outside_itself_is_refused(tmp_path: Path) -> None:
    (tmp_path / "secret.bin").write_bytes(np.arange(100.0).tobytes())
    with h5py.File(tmp_path / "outside.h5", "w") as file:
        file.create_dataset("disp", (100,), "f8", external=[(str(tmp_path / "secret.bin"), 0, 800)])
    with pytest.raises(InputProblem, match="another file"):
        read_table(tmp_path / "outside.h5")


def test_tdms_groups_of_different_rates_need_a_key(tmp_path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    path = tmp_path / "two.tdms"
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject(group, "disp", np.sin(np.arange(100.0) * step), properties={"wf_increment": step})
                for group, step in (("slow", 0.01), ("fast", 0.001))
            ]
        )
    with pytest.raises(InputProblem, match="different rates"):
        read_table(path)
    assert read_table(path, key="fast").sampling_rate == 1000.0


def test_a_uff_rate_is_snapped_to_what_its_six_digits_meant(tmp_path: Path) -> None:
    text = write("uff", tmp_path).read_text()
    assert " 7.81250e-05" in text
    (tmp_path / "odd.uff").write_text(text.replace(" 7.81250e-05", " 1.63934e-05"))
    assert read_table(tmp_path / "odd.uff").sampling_rate == 61000.0


def test_a_wav_that_was_cut_or_hits_full_scale_is_noted(tmp_path: Path) -> None:
    path = write("wav", tmp_path)
    path.write_bytes(path.read_bytes()[:-400])
    assert any("cut" in note for note in read_table(path).notes)
    loud = np.clip(40000 * np.sin(np.arange(2000) * 0.05), -32768, 32767).astype(np.int16)
    scipy.io.wavfile.write(tmp_path / "loud.wav", 12800, loud)
    from testbed.readers.assemble import Source

    _, notes = assemble(read_table(tmp_path / "loud.wav"), {"displacement": Source(1, "V")})
    assert any("clipped" in note for note in notes)


def test_a_wav_header_that_contradicts_itself_is_refused(tmp_path: Path) -> None:
    path = write("wav", tmp_path)
    sound = path.read_bytes()
    at = sound.find(b"fmt ") + 12  # the sampling rate, as if one of its bits had flipped
    for rate in (12801, 29184, 4608):
        path.write_bytes(sound[:at] + rate.to_bytes(4, "little") + sound[at + 4 :])
        with pytest.raises(InputProblem, match="header is invalid"):
            read_table(path)


def test_a_parquet_page_is_held_against_its_checksum_and_its_statistics(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    path = write("parquet", tmp_path)
    table = parquet.read_table(path)
    for checksum in (True, False):
        parquet.write_table(table, path, write_page_checksum=checksum, use_dictionary=False, compression="none")
        assert not any("damaged" in note for note in read_table(path).notes)
        raw, largest = path.read_bytes(), np.float64(table["disp"].to_numpy().max())
        column = raw.find(table["disp"].to_numpy().tobytes())
        place = column + 8 * int(np.argmax(table["disp"].to_numpy()))
        assert column > 0 and raw[place : place + 8] == largest.tobytes()
        path.write_bytes(raw[:place] + np.float64(0.99 * largest).tobytes() + raw[place + 8 :])
        if checksum:
            with pytest.raises(InputProblem, match=r"checksum|CRC"):
                read_table(path)
        else:
            assert any("'disp' runs from" in note and "damaged" in note for note in read_table(path).notes)


def test_parquet_statistics_of_sound_files_raise_no_note(tmp_path: Path) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    values = np.random.default_rng(2).normal(size=300)
    gaps = np.where(np.arange(300) % 7 == 0, np.nan, values)
    columns = {"a": values, "b": gaps, "c": values.astype("f4"), "d": np.arange(300) - 150, "e": np.full(300, -0.0),
               "f": [None if k % 5 == 0 else float(k) for k in range(300)], "g": np.full(300, np.nan),
               "h": np.arange(300).astype("u8") + 2**63}  # fmt: skip
    for rows in (7, 300):
        parquet.write_table(arrow.table(columns), tmp_path / "a.parquet", row_group_size=rows)
        assert [note for note in read_table(tmp_path / "a.parquet").notes if "damaged" in note] == []


def test_a_library_that_crashes_or_hangs_on_a_file_is_an_input_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import os
    import signal
    import time

    with pytest.raises(InputProblem, match="crashes on it"):
        rehearsal.rehearse(tmp_path, lambda: os.kill(os.getpid(), signal.SIGSEGV))
    monkeypatch.setattr(rehearsal, "_AT_LEAST", 0.05)
    with pytest.raises(InputProblem, match="does not end"):
        rehearsal.rehearse(tmp_path, lambda: time.sleep(5))
    monkeypatch.undo()
    rehearsal.rehearse(tmp_path, lambda: 1 / 0)  # the real reading will say it
