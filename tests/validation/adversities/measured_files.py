"""Measured files of every format that are wrong, empty, endless, or claim what they do not hold."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.validation.adversities.hostile_data_sets import COMPOUND, nested
from tests.validation.adversities.probe import DEEP, TABLE, Make, campaign
from tests.validation.adversities.runner import EITHER, REFUSED


def _text_file(content: str | bytes, file: str = "cut.csv", command: str = "inspect") -> Make:
    def make(folder: Path) -> Sequence[object]:
        (folder / file).write_bytes(content if isinstance(content, bytes) else content.encode())
        return campaign(folder, file, command=command)

    return make


def _hdf5_file(change: Callable[[h5py.File], None]) -> Make:
    def make(folder: Path) -> Sequence[object]:
        with h5py.File(folder / "cut.h5", "w") as file:
            change(file)
        return campaign(folder, "cut.h5")

    return make


def _mat_file(values: dict[str, Any]) -> Make:
    def make(folder: Path) -> Sequence[object]:
        import scipy.io

        scipy.io.savemat(folder / "cut.mat", values)
        return campaign(folder, "cut.mat")

    return make


def _wav_file(rate: int, width: int = 16, channels: int = 1, size: int | None = None, code: int = 1) -> Make:
    def make(folder: Path) -> Sequence[object]:
        samples = np.zeros(2000, np.int16).tobytes()
        body = struct.pack("<HHIIHH", code, channels, rate, rate * 2, max(1, width // 8 * channels) % 65536, width)
        content = (
            b"WAVEfmt " + struct.pack("<I", len(body)) + body + b"data" + struct.pack("<I", size or len(samples)) + samples
        )
        (folder / "cut.wav").write_bytes(b"RIFF" + struct.pack("<I", len(content)) + content)
        return campaign(folder, "cut.wav")

    return make


def _parquet_file(folder: Path, metadata: dict[str, str], values: Any) -> Sequence[object]:
    import pyarrow as arrow
    import pyarrow.parquet as parquet

    table = arrow.table({"disp": values}).replace_schema_metadata(metadata)
    parquet.write_table(table, folder / "cut.parquet")
    return campaign(folder, "cut.parquet")


MEASURED: dict[str, tuple[Make, Sequence[int]]] = {
    "CSV: one line of 6 MB": (_text_file(",".join(["1.5"] * 1_500_000)), REFUSED),
    "CSV: one line of 6 MB without a comma": (_text_file("1" * 6_000_000), REFUSED),
    "CSV: one line of 6 MB of quotes": (_text_file('"' * 6_000_000), REFUSED),
    "CSV: a comment of 1.5 MB": (_text_file("# " + "a b, " * 300_000 + "\n" + TABLE), EITHER),
    "CSV: a comment of 1.5 MB of digits": (_text_file("# " + "1" * 1_500_000 + "\n" + TABLE), EITHER),
    "CSV: a comment of 1.5 MB of brackets": (_text_file("# " + "[(" * 750_000 + "\n" + TABLE), EITHER),
    "CSV: a comment of 1.5 MB of blanks": (_text_file("# sampling rate" + " " * 1_500_000 + "\n" + TABLE), EITHER),
    "CSV: 300,000 lines of comment": (_text_file("# sampling rate\n" * 300_000 + TABLE), EITHER),
    "CSV: 300,000 empty lines": (_text_file("\n" * 300_000 + TABLE), EITHER),
    "CSV: a header of 5000 characters": (_text_file("n" * DEEP + TABLE[4:]), REFUSED),
    "CSV: a header alone": (_text_file("disp\n"), REFUSED),
    "CSV: 20,000 columns": (_text_file(("1," * 20_000 + "1\n") * 5), REFUSED),
    "CSV: all NaN": (_text_file("disp\n" + "nan\n" * 3000), REFUSED),
    "CSV: infinite": (_text_file("disp\n" + "inf\n" * 3000), REFUSED),
    "CSV: 1e308": (_text_file("disp\n" + "1e308\n-1e308\n" * 1500), EITHER),
    "CSV: a NUL": (_text_file(TABLE.replace("\n", "\0\n", 1)), REFUSED),
    "CSV: half of UTF-16": (_text_file(TABLE.encode("utf-16")[:-1]), EITHER),
    "CSV: one number": (_text_file("disp\n1\n"), REFUSED),
    "CSV: a date of 5000 digits": (
        _text_file("t,disp\n" + "".join(f"2026-01-01 {'0' * DEEP}{k},{k}\n" for k in range(50))),
        REFUSED,
    ),
    "CSV: numbers of 5000 digits": (_text_file("disp\n" + ("1" * DEEP + "\n") * 500), REFUSED),
    "LabVIEW: a header without numbers": (_text_file("LabVIEW Measurement\n***End_of_Header***\n", "cut.lvm"), REFUSED),
    "LabVIEW: headers alone": (
        _text_file("LabVIEW Measurement\n" + "***End_of_Header***\nChannels\t1\nX\n" * 2000, "cut.lvm"),
        REFUSED,
    ),
    "LabVIEW: no samples": (
        _text_file(
            "LabVIEW Measurement\n***End_of_Header***\nChannels\t1\nSamples\t0\nDelta_X\t0\n"
            "***End_of_Header***\nX_Value\tdisp\n***End_of_Header***\n",
            "cut.lvm",
        ),
        REFUSED,
    ),
    "HDF5: compound": (_hdf5_file(lambda file: file.__setitem__("disp", COMPOUND)), REFUSED),
    "HDF5: references": (_hdf5_file(lambda file: file.create_dataset("disp", (50,), h5py.ref_dtype)), REFUSED),
    "HDF5: text": (_hdf5_file(lambda file: file.__setitem__("disp", np.full(50, b"x"))), REFUSED),
    "HDF5: five axes": (_hdf5_file(lambda file: file.__setitem__("disp", np.zeros((2, 2, 2, 2, 99)))), REFUSED),
    "HDF5: no values": (_hdf5_file(lambda file: file.__setitem__("disp", h5py.Empty("f8"))), REFUSED),
    "HDF5: a square of columns": (_hdf5_file(lambda file: file.__setitem__("disp", np.zeros((3000, 3000), "i1"))), REFUSED),
    "HDF5: 5000 nested groups": (_hdf5_file(nested), REFUSED),
    "HDF5: 1e12 values claimed": (
        _hdf5_file(lambda file: file.create_dataset("disp", (10**12,), "f8", chunks=(1000,))),
        REFUSED,
    ),
    "HDF5: a loop of groups": (_hdf5_file(lambda file: file.create_group("a").__setitem__("b", file["/"])), REFUSED),
    "HDF5: a soft link": (_hdf5_file(lambda file: file.__setitem__("disp", h5py.SoftLink("/disp"))), REFUSED),
    "HDF5: an external link": (
        _hdf5_file(lambda file: file.__setitem__("disp", h5py.ExternalLink("/dev/zero", "/x"))),
        REFUSED,
    ),
    "HDF5: a rate of nan": (
        _hdf5_file(lambda file: file.create_dataset("disp", data=np.zeros(999)).attrs.update(fs=np.nan)),
        REFUSED,
    ),
    "HDF5: units of a compound": (
        _hdf5_file(lambda file: file.create_dataset("disp", data=np.sin(np.arange(999))).attrs.update(units=COMPOUND)),
        EITHER,
    ),
    "HDF5: a file name of a data set": (_hdf5_file(lambda file: file.create_dataset("n" * DEEP, data=np.zeros(99))), REFUSED),
    "MAT: text": (_mat_file({"disp": "text"}), REFUSED),
    "MAT: a cell": (_mat_file({"disp": np.array([1, "a"], dtype=object)}), REFUSED),
    "MAT: a struct": (_mat_file({"disp": {"a": {"b": {"c": 1.0}}}}), REFUSED),
    "MAT: five axes": (_mat_file({"disp": np.zeros((2, 2, 2, 2, 60))}), REFUSED),
    "MAT: complex": (_mat_file({"disp": np.zeros(60) + 1j}), REFUSED),
    "MAT: nothing": (_mat_file({}), REFUSED),
    "MAT: empty": (_mat_file({"disp": np.zeros((0, 3))}), REFUSED),
    "MAT: a header alone": (_text_file(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM", "cut.mat"), REFUSED),
    "MAT: version 4, 1e9 values claimed": (
        _text_file(struct.pack("<5i", 0, 40000, 40000, 0, 5) + b"disp\0" + b"\0" * 99, "cut.mat"),
        REFUSED,
    ),
    "WAV: rate 0": (_wav_file(0), REFUSED),
    "WAV: no channels": (_wav_file(12800, channels=0), REFUSED),
    "WAV: 65535 channels": (_wav_file(12800, channels=65535), REFUSED),
    "WAV: 7 bit": (_wav_file(12800, 7), REFUSED),
    "WAV: 4 GB claimed": (_wav_file(12800, size=0xFFFFFFF0), REFUSED),
    "WAV: another code": (_wav_file(12800, code=85), REFUSED),
    "WAV: a header alone": (_text_file(b"RIFF\x04\0\0\0WAVE", "cut.wav"), REFUSED),
    "TDMS: a header alone": (_text_file(b"TDSm" + b"\x0e\0\0\0" + struct.pack("<IQQ", 4713, 0, 0), "cut.tdms"), REFUSED),
    "TDMS: 2**60 bytes claimed": (
        _text_file(b"TDSm" + b"\x0e\0\0\0" + struct.pack("<IQQI", 4713, 2**60, 2**60, 2**31), "cut.tdms"),
        REFUSED,
    ),
    "TDMS: objects without end": (
        _text_file(b"TDSm" + b"\x0e\0\0\0" + struct.pack("<IQQI", 4713, 8, 4, 0xFFFFFFFF), "cut.tdms"),
        REFUSED,
    ),
    "UFF: 4 MB of openings": (_text_file("    -1\n" * 600_000, "cut.uff"), REFUSED),
    "UFF: no end": (_text_file("    -1\n    58\n" + "x" * 2_000_000, "cut.uff"), REFUSED),
    "UFF: 1e12 values claimed": (
        _text_file(
            "    -1\n    58\n" + "NONE\n" * 5 + "    1 1 1 1 NONE 1 1 NONE 1 1\n"
            "         2 999999999999         1  0.0 1.0e-3 0.0\n" + "x\n" * 4 + "1.0\n    -1\n",
            "cut.uff",
        ),
        REFUSED,
    ),
    "Parquet: a rate of text": (lambda folder: _parquet_file(folder, {"sampling_rate": "fast"}, [1.0, 2.0] * 500), EITHER),
    "Parquet: a rate of nan": (lambda folder: _parquet_file(folder, {"sampling_rate": "nan"}, [1.0, 2.0] * 500), EITHER),
    "Parquet: a rate of inf": (lambda folder: _parquet_file(folder, {"sampling_rate": "inf"}, [1.0, 2.0] * 500), EITHER),
    "Parquet: lists": (lambda folder: _parquet_file(folder, {}, [[1.0], [2.0]]), REFUSED),
    "Parquet: nulls": (lambda folder: _parquet_file(folder, {}, [None, None]), REFUSED),
    "Parquet: no rows": (lambda folder: _parquet_file(folder, {}, []), REFUSED),
    "Parquet: a header alone": (_text_file(b"PAR1PAR1", "cut.parquet"), REFUSED),
    "Parquet: a footer of 2 GB claimed": (
        _text_file(b"PAR1" + b"\0" * 64 + struct.pack("<I", 2**31 - 1) + b"PAR1", "cut.parquet"),
        REFUSED,
    ),
    "a record of /dev/zero": (lambda folder: campaign(folder, "/dev/zero"), REFUSED),
    "a record of the campaign itself": (lambda folder: campaign(folder, "campaign.yaml"), REFUSED),
    "a record of a data set": (lambda folder: campaign(folder, "good.h5"), REFUSED),
}
