"""Hostile, wrong and damaged files through every command that opens one: each is refused in one line, in ten seconds."""

from __future__ import annotations

import os
import shutil
import struct
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.validation.adversities.runner import EITHER, REFUSED, Result, Said, forked, started, within

MODEL = """structure: {mass: 2.573 kg, natural_frequency: 147.5 Hz, damping_ratio: 0.005}
cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}
cutting: {direction: up-milling, immersion: 0.162, tangential_coefficient: 600 N/mm^2, normal_coefficient: 180 N/mm^2}
"""
SCENARIO = """name: small
seed: 1
model:
  structure: {mass: 2.573 kg, natural_frequency: 147 Hz, damping_ratio: 0.005}
  cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}
  cutting: {direction: up-milling, immersion: 0.162, tangential_coefficient: 550 N/mm^2, normal_coefficient: 200 N/mm^2}
cut: {feed: 0.1 mm/tooth, idle: 5 rev, cutting: 40 rev, ring_down: 40 rev}
tests:
  - {spindle_speed: 3810 rpm, depth_of_cut: 2 mm}
  - {spindle_speed: 2850 rpm, depth_of_cut: 1 mm}
sensors:
  sampling_rate: 12800 Hz
  displacement: {noise: 0.5 um, bits: 16, range: 1 mm}
"""
CAMPAIGN = """name: rig
sampling_rate: 12800 Hz
channels: {displacement: {column: disp, unit: um}}
records:
  - {file: FILE, kind: cut, spindle_speed: 3810 rpm, depth_of_cut: 2 mm, feed: 0.1 mm/tooth}
"""
DEEP = 5000  # of what is nested, and characters of a long name
RECORD = "  - {file: cut.csv, kind: cut, spindle_speed: 3810 rpm, depth_of_cut: 2 mm, feed: 0.1 mm/tooth}"
Make = Callable[[Path], Sequence[object]]


@dataclass(frozen=True)
class Probe:
    """An adversity. make: writes what it needs into a folder and gives the command line; codes: those that are an answer."""

    kind: str
    name: str
    make: Make
    codes: Sequence[int] = REFUSED


# -- paths -----------------------------------------------------------------------------------------------------------------


def _directory(place: Path) -> Path:
    place.mkdir()
    return place


def _fifo(place: Path) -> Path:
    os.mkfifo(place)
    return place


def _empty(place: Path) -> Path:
    place.write_bytes(b"")
    return place


def _loop(place: Path) -> Path:
    other = place.with_name("other" + place.suffix)
    place.symlink_to(other.name)
    other.symlink_to(place.name)
    return place


def _dangling(place: Path) -> Path:
    place.symlink_to("nowhere")
    return place


def _long(place: Path) -> Path:
    return place.with_name("n" * DEEP + place.suffix)


def _device(name: str) -> Callable[[Path], Path]:
    def make(place: Path) -> Path:
        place.symlink_to(name)
        return place

    return make


def _binary(place: Path) -> Path:
    place.write_bytes(np.random.default_rng(3).bytes(20_000))
    return place


PLACES: dict[str, Callable[[Path], Path]] = {
    "missing": lambda place: place,
    "a directory": _directory,
    "a fifo": _fifo,
    "empty": _empty,
    "a loop of links": _loop,
    "a link to nowhere": _dangling,
    "a name of 5000 characters": _long,
    "/dev/zero": _device("/dev/zero"),
    "/dev/null": _device("/dev/null"),
    "random bytes": _binary,
}
OPENERS: dict[str, tuple[str, Callable[[Path], Sequence[object]]]] = {
    "inspect": ("data.h5", lambda path: ("inspect", path)),
    "identify": ("data.h5", lambda path: ("identify", path, "-m", "model.yaml")),
    "identify -m": ("bad.yaml", lambda path: ("identify", "good.h5", "-m", path)),
    "score": ("data.h5", lambda path: ("score", path)),
    "export": ("data.h5", lambda path: ("export", path, "-o", "out")),
    "verify": ("data.h5", lambda path: ("verify", path)),
    "chart": ("bad.yaml", lambda path: ("chart", path, "--speed", "3000:4000:3", "--depth", "1:2:2")),
    "multipliers": ("bad.yaml", lambda path: ("multipliers", path, "--speed", "3810", "--depth", "2")),
    "run": ("bad.yaml", lambda path: ("run", path, "-o", "new.h5")),
    "compare": ("bad.yaml", lambda path: ("compare", path, "-m", "model.yaml")),
    "diagnose": ("bad.yaml", lambda path: ("diagnose", path, "-m", "model.yaml")),
    "add": ("bad.yaml", lambda path: ("add", "edge_force", "-m", "model.yaml", "-c", path, "-o", "new.yaml")),
    "a record's file": ("cut.csv", lambda path: ("inspect", "campaign.yaml")),
    "a record's .mat": ("cut.mat", lambda path: ("inspect", "campaign.yaml")),
    "an effect": ("own/law.py", lambda path: ("effects", "law", "--effects", "own")),
}


def _of_paths() -> Iterator[Probe]:
    for opener, (name, command) in OPENERS.items():
        for place, make in PLACES.items():

            def probe(folder: Path, make: Any = make, name: str = name, command: Any = command) -> Sequence[object]:
                (folder / name).parent.mkdir(exist_ok=True)
                path = make(folder / name)
                if name.startswith("cut"):
                    (folder / "campaign.yaml").write_text(CAMPAIGN.replace("FILE", path.name))
                return command(path)

            yield Probe("paths", f"{opener}: {place}", probe)
    yield Probe("paths", "--effects: a file", lambda folder: ("effects", "--effects", "model.yaml"))
    yield Probe("paths", "--effects: a loop of links", lambda folder: ("effects", "--effects", _loop(folder / "own")))
    yield Probe("paths", "--effects: 5000 characters", lambda folder: ("effects", "--effects", "n" * DEEP))
    yield Probe("paths", "a file's name with a NUL", lambda folder: _campaign(folder, file='"a\\0b.csv"'))
    yield Probe("paths", "a folder's name with a NUL", lambda folder: _campaign(folder, more='folder: "a\\0b"'))


def _campaign(folder: Path, file: str = "cut.csv", more: str = "", command: str = "inspect") -> Sequence[object]:
    (folder / "campaign.yaml").write_text(more + "\n" + CAMPAIGN.replace("FILE", file))
    return (command, "campaign.yaml") if command == "inspect" else (command, "campaign.yaml", "-m", "model.yaml")


# -- data sets -------------------------------------------------------------------------------------------------------------


def _attribute(name: str, value: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        place, _, key = name.rpartition("/")
        file[place or "/"].attrs[key] = value

    return change


def _values(name: str, make: Callable[[np.ndarray], Any]) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        before, attributes = file[name][()], dict(file[name].attrs)
        del file[name]
        new = make(before)
        if isinstance(new, dict):
            file.create_dataset(name, **new)
        else:
            file[name] = new
        for key, value in attributes.items():
            if key not in ("DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME"):
                file[name].attrs[key] = value

    return change


def _first(value: float) -> Callable[[np.ndarray], np.ndarray]:
    def make(before: np.ndarray) -> np.ndarray:
        new = before.astype(float if not float(value).is_integer() else before.dtype)
        new[0] = value
        return new

    return make


def _nothing(file: h5py.File) -> None:
    for name in list(file):
        if isinstance(file[name], h5py.Dataset) and file[name].ndim:
            shape = (0, *file[name].shape[1:])
            kind = file[name].dtype
            _values(name, lambda before, shape=shape, kind=kind: np.zeros(shape, kind))(file)


def _nested(file: h5py.Group) -> None:
    group = h5py.h5g.create(file.id, b"deep")
    for _ in range(DEEP):
        group = h5py.h5g.create(group, b"g")


def _linked(kind: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file["displacement"]
        file["displacement"] = kind

    return change


def _external(file: h5py.File) -> None:
    shape, kind = file["displacement"].shape, file["displacement"].dtype
    del file["displacement"]
    file.create_dataset("displacement", shape, kind, external=[("/etc/passwd", 0, h5py.h5f.UNLIMITED)])


def _virtual(file: h5py.File) -> None:
    shape, kind = file["displacement"].shape, file["displacement"].dtype
    del file["displacement"]
    layout = h5py.VirtualLayout(shape, kind)
    layout[:] = h5py.VirtualSource("/etc/passwd", "x", shape)
    file.create_virtual_dataset("displacement", layout)


COMPOUND = np.zeros(2, dtype=[("a", float), ("b", "S3")])
DATA: dict[str, Callable[[h5py.File], None]] = {
    **{
        f"sampling_rate {value}": _attribute("sampling_rate", value)
        for value in (0.0, -1.0, np.nan, np.inf, "fast", 1e300, np.zeros(3))
    },
    **{f"format {value!r}": _attribute("format", value) for value in ("two", np.nan, -1, 10**9, [1, 2], 0)},
    **{f"flutes {value!r}": _attribute("flutes", value) for value in (0, -1, 10**9, "one", np.nan)},
    **{
        f"scale_factor {value!r}": _attribute("displacement/scale_factor", value)
        for value in ("small", np.nan, np.inf, 0.0, [1.0, 2.0])
    },
    "add_offset text": _attribute("displacement/add_offset", "none"),
    "_FillValue text": _attribute("displacement/_FillValue", "none"),
    "units compound": _attribute("displacement/units", COMPOUND),
    "title array": _attribute("title", np.arange(5)),
    "versions no JSON": _attribute("versions", "{"),
    "versions a list": _attribute("versions", "[1]"),
    "seed text": _attribute("seed", "x"),
    "no runs": _nothing,
    **{
        f"{name} {value}": _values(name, _first(value))
        for name in ("spindle_speed", "axial_depth_of_cut", "feed_per_tooth")
        for value in (np.nan, np.inf, -1.0)
    },
    "spindle_speed 0": _values("spindle_speed", _first(0.0)),
    "passes -5": _values("passes", _first(-5)),
    "outcome 99": _values("outcome", _first(99)),
    "outcome text": _values("outcome", lambda before: np.array([b"ok"] * len(before))),
    "sample_count -1": _values("sample_count", _first(-1)),
    "sample_count 1e9": _values("sample_count", _first(10**9)),
    "sample_count real": _values("sample_count", lambda before: before + 0.5),
    "start nan": _values("start", _first(np.nan)),
    "start text": _values("start", lambda before: np.array([b"now"] * len(before))),
    "marks of one axis": _values("marks", lambda before: before[:, 0]),
    "marks text": _values("marks", lambda before: np.full(before.shape, b"x")),
    "marks inf": _values("marks", lambda before: np.full(before.shape, np.inf)),
    "pass_times compound": _values("pass_times", lambda before: COMPOUND),
    "spindle_speed compound": _values("spindle_speed", lambda before: COMPOUND),
    "spindle_speed text": _values("spindle_speed", lambda before: np.array([b"fast"] * len(before))),
    "spindle_speed references": _values("spindle_speed", lambda before: {"shape": before.shape, "dtype": h5py.ref_dtype}),
    "spindle_speed complex": _values("spindle_speed", lambda before: before + 1j),
    "spindle_speed a number": _values("spindle_speed", lambda before: float(before[0])),
    "displacement of five axes": _values("displacement", lambda before: before[:, None, None, None, :]),
    "displacement of one axis": _values("displacement", lambda before: before[:, 0]),
    "displacement compound": _values("displacement", lambda before: np.zeros(before.shape, COMPOUND.dtype)),
    "displacement text": _values("displacement", lambda before: np.full(before.shape, b"x")),
    "displacement of 1e12 values": _values(
        "displacement", lambda before: {"shape": (2, 10**12), "dtype": "i2", "chunks": (1, 1000)}
    ),
    "model_text numbers": _values("model_text", lambda before: np.arange(4)),
    "model_text no YAML": _values("model_text", lambda before: "{"),
    "model_text a mass of 0": _values("model_text", lambda before: MODEL.replace("2.573", "0")),
    "model_text no text": _values("model_text", lambda before: np.bytes_(b"\xff\xfe\x00")),
    "scenario_text compound": _values("scenario_text", lambda before: COMPOUND),
    "truth text": _values("truth.damping_ratio", lambda before: np.array([b"x", b"y"])),
    "noise text": _values("noise_displacement", lambda before: np.array([b"x", b"y"])),
    "5000 nested groups": _nested,
    "an external link": _linked(h5py.ExternalLink("/etc/passwd", "/x")),
    "a soft link": _linked(h5py.SoftLink("/nowhere")),
    "a loop of links inside": _linked(h5py.SoftLink("/displacement")),
    "external storage": _external,
    "a virtual data set": _virtual,
    "a group for a channel": lambda file: (file.__delitem__("displacement"), file.create_group("displacement"))[0],
    "a data type for a channel": lambda file: (
        file.__delitem__("displacement"),
        file.__setitem__("displacement", np.dtype("f8")),
    )[0],
}
HARMLESS = {"5000 nested groups", "versions a list", "format 0", "format -1", "title array"}  # may be read all the same
READERS = ("inspect", "identify", "score", "export", "verify")


def _without_seal(source: Path, target: Path) -> None:
    with h5py.File(source, "r") as old, h5py.File(target, "w") as new:
        new.attrs.update(old.attrs)
        for name in old:
            old.copy(old[name], new, name)


def _of_data_sets() -> Iterator[Probe]:
    for place, (name, change) in enumerate(DATA.items()):
        commands = READERS if place % 8 == 0 else (READERS[place % 5], READERS[(place + 1) % 5])
        for command in ("inspect", "verify") if name in HARMLESS else ("score", "export") if "model_text" in name else commands:

            def probe(folder: Path, change: Any = change, command: str = command) -> Sequence[object]:
                _without_seal(folder / "good.h5", folder / "bad.h5")
                with h5py.File(folder / "bad.h5", "r+") as file:
                    change(file)
                more = {"identify": ("-m", "model.yaml"), "export": ("-o", "out")}.get(command, ())
                return (command, "bad.h5", *more)

            yield Probe("data sets", f"{command}: {name}", probe, EITHER if name in HARMLESS else REFUSED)


# -- measured files --------------------------------------------------------------------------------------------------------


def _text_file(content: str | bytes, file: str = "cut.csv", command: str = "inspect") -> Make:
    def make(folder: Path) -> Sequence[object]:
        (folder / file).write_bytes(content if isinstance(content, bytes) else content.encode())
        return _campaign(folder, file, command=command)

    return make


def _hdf5_file(change: Callable[[h5py.File], None]) -> Make:
    def make(folder: Path) -> Sequence[object]:
        with h5py.File(folder / "cut.h5", "w") as file:
            change(file)
        return _campaign(folder, "cut.h5")

    return make


def _mat_file(values: dict[str, Any]) -> Make:
    def make(folder: Path) -> Sequence[object]:
        import scipy.io

        scipy.io.savemat(folder / "cut.mat", values)
        return _campaign(folder, "cut.mat")

    return make


def _wav_file(rate: int, width: int = 16, channels: int = 1, size: int | None = None, code: int = 1) -> Make:
    def make(folder: Path) -> Sequence[object]:
        samples = np.zeros(2000, np.int16).tobytes()
        body = struct.pack("<HHIIHH", code, channels, rate, rate * 2, max(1, width // 8 * channels) % 65536, width)
        content = (
            b"WAVEfmt " + struct.pack("<I", len(body)) + body + b"data" + struct.pack("<I", size or len(samples)) + samples
        )
        (folder / "cut.wav").write_bytes(b"RIFF" + struct.pack("<I", len(content)) + content)
        return _campaign(folder, "cut.wav")

    return make


def _parquet_file(folder: Path, metadata: dict[str, str], values: Any) -> Sequence[object]:
    import pyarrow as arrow
    import pyarrow.parquet as parquet

    table = arrow.table({"disp": values}).replace_schema_metadata(metadata)
    parquet.write_table(table, folder / "cut.parquet")
    return _campaign(folder, "cut.parquet")


TABLE = "disp\n" + "".join(f"{value:.3f}\n" for value in 20 * np.sin(np.arange(3000) / 14))
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
    "HDF5: 5000 nested groups": (_hdf5_file(_nested), REFUSED),
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
    "a record of /dev/zero": (lambda folder: _campaign(folder, "/dev/zero"), REFUSED),
    "a record of the campaign itself": (lambda folder: _campaign(folder, "campaign.yaml"), REFUSED),
    "a record of a data set": (lambda folder: _campaign(folder, "good.h5"), REFUSED),
}


# -- texts that people write -----------------------------------------------------------------------------------------------


def _changed(old: str, new: str, text: str = CAMPAIGN, command: str = "inspect") -> Make:
    def make(folder: Path) -> Sequence[object]:
        (folder / "cut.csv").write_text(TABLE)
        if text is MODEL:
            (folder / "model.yaml").write_text(MODEL.replace(old, new))
            return "multipliers", "model.yaml", "--speed", "3810", "--depth", "2"
        if text is SCENARIO:
            (folder / "scenario.yaml").write_text(SCENARIO.replace(old, new))
            return "run", "scenario.yaml", "-o", "new.h5"
        (folder / "campaign.yaml").write_text(CAMPAIGN.replace("FILE", "cut.csv").replace(old, new))
        return (command, "campaign.yaml") if command == "inspect" else (command, "campaign.yaml", "-m", "model.yaml")

    return make


BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{'bcdefghij'[k]}: &{'bcdefghij'[k]} [{','.join(['*' + 'abcdefghij'[k]] * 9)}]\n" for k in range(8)
)
WRITTEN: dict[str, tuple[Make, Sequence[int]]] = {
    **{
        f"model: mass {value}": (_changed("2.573 kg", value, MODEL), REFUSED)
        for value in ("0 kg", "-1 kg", ".nan", ".inf", "1e400 kg", "nan kg", "inf kg", "[1]", "{a: 1}", "1" * DEEP, "x" * DEEP)
    },
    "model: frequency 1e300 Hz": (_changed("147.5 Hz", "1e300 Hz", MODEL), EITHER),
    "model: frequency 1e-300 Hz": (_changed("147.5 Hz", "1e-300 Hz", MODEL), EITHER),
    "model: damping 1": (_changed("0.005", "1", MODEL), REFUSED),
    "model: coefficient 1e300": (_changed("600 N/mm^2", "1e300 N/mm^2", MODEL), REFUSED),
    "model: flutes 1e9": (_changed("flutes: 1", "flutes: 1000000000", MODEL), REFUSED),
    "model: a diameter of 1e-300 mm": (_changed("19.05 mm", "1e-300 mm", MODEL), EITHER),
    "model: effects of 5000 names": (
        _changed("cutter:", "effects: {" + ", ".join(f"e{k}: {{}}" for k in range(DEEP)) + "}\ncutter:", MODEL),
        REFUSED,
    ),
    "model: 5000 nested lists": (_changed("2.573 kg", "[" * DEEP + "]" * DEEP, MODEL), REFUSED),
    "model: 5000 nested mappings": (_changed("2.573 kg", "{a: " * DEEP + "1" + "}" * DEEP, MODEL), REFUSED),
    "model: aliases without end": (_changed("structure:", BOMB + "structure:", MODEL), REFUSED),
    "model: an alias of itself": (_changed("2.573 kg", "&a [*a]", MODEL), REFUSED),
    "model: a merge of itself": (_changed("structure:", "x: &a {<<: *a}\nstructure:", MODEL), REFUSED),
    "model: a tag of Python's": (_changed("2.573 kg", "!!python/object/apply:os.system [true]", MODEL), REFUSED),
    "model: a binary tag": (_changed("2.573 kg", "!!binary x", MODEL), REFUSED),
    "model: a date": (_changed("2.573 kg", "2026-01-01", MODEL), REFUSED),
    "model: a date out of range": (_changed("2.573 kg", "2026-99-99", MODEL), REFUSED),
    "model: a set": (_changed("2.573 kg", "!!set {a, b}", MODEL), REFUSED),
    "model: a key that is a list": (_changed("mass:", "? [a, b]\n:", MODEL), REFUSED),
    "model: a comment of 1.5 MB": (_changed("structure:", "# " + "a b " * 375_000 + "\nstructure:", MODEL), EITHER),
    "model: a line of 1.5 MB": (_changed("2.573 kg", "a" * 1_500_000, MODEL), REFUSED),
    "model: 1.5 MB of quotes": (_changed("2.573 kg", "'" * 1_500_001, MODEL), REFUSED),
    "model: 100,000 lines of comment": (_changed("structure:", "# a\n" * 100_000 + "structure:", MODEL), EITHER),
    "model: 1.5 MB of blanks": (_changed("structure:", " " * 1_500_000 + "\nstructure:", MODEL), EITHER),
    "model: 300,000 keys": (
        _changed("structure:", "".join(f"k{k}: 1\n" for k in range(300_000)) + "structure:", MODEL),
        REFUSED,
    ),
    "model: two documents": (_changed("structure:", "a: 1\n---\nstructure:", MODEL), REFUSED),
    "model: a NUL": (_changed("2.573", "2.5\0", MODEL), REFUSED),
    "model: an emoji for a unit": (_changed("2.573 kg", "2.573 \U0001f600", MODEL), REFUSED),
    "model: lone surrogates": (_changed("2.573 kg", '"\\ud800"', MODEL), REFUSED),
    "model: a number of Arabic digits": (_changed("2.573 kg", "\u0662 kg", MODEL), EITHER),
    "campaign: no records": (
        _changed(CAMPAIGN[CAMPAIGN.index("records:") :].replace("FILE", "cut.csv"), "records: []\n"),
        REFUSED,
    ),
    **{
        f"campaign: sampling_rate {value[:20]}": (_changed("12800 Hz", value), REFUSED)
        for value in ("0 Hz", "nan Hz", ".inf", "-1 Hz", "inf Hz", "fast", "1e400 Hz", "[1, 2]")
    },
    "campaign: sampling_rate 1e300 Hz": (_changed("12800 Hz", "1e300 Hz"), REFUSED),
    "campaign: sampling_rate 1e-300 Hz": (_changed("12800 Hz", "1e-300 Hz"), REFUSED),
    **{
        f"campaign: scale {value}": (_changed("unit: um", f"unit: um, scale: {value}"), REFUSED)
        for value in (".nan", ".inf", "big", "0", "1e400", "[1]", "true")
    },
    "campaign: scale 1e299": (_changed("unit: um", "unit: um, scale: 1e299"), EITHER),
    "campaign: scale 1e-299": (_changed("unit: um", "unit: um, scale: 1e-299"), EITHER),
    **{
        f"campaign: spindle_speed {value}": (_changed("3810 rpm", value), REFUSED)
        for value in ("0 rpm", "-1 rpm", "inf rpm", "nan rpm", "1e300 rpm", "1e-300 rpm")
    },
    **{
        f"campaign: feed {value}": (_changed("0.1 mm/tooth", value), REFUSED)
        for value in ("inf mm/tooth", "-1 mm/rev", "0 mm/min")
    },
    "campaign: feed 1e300": (_changed("0.1 mm/tooth", "1e300 mm/tooth"), EITHER),
    "campaign: depth inf": (_changed("2 mm,", "inf mm,"), REFUSED),
    "campaign: from nan": (_changed("kind: cut", "from: .nan, kind: cut"), REFUSED),
    "campaign: from inf": (_changed("kind: cut", "from: .inf, kind: cut"), REFUSED),
    "campaign: to 1e300": (_changed("kind: cut", "to: 1e300, kind: cut"), EITHER),
    "campaign: from -1e300": (_changed("kind: cut", "from: -1e300, kind: cut"), EITHER),
    "campaign: skip_rows 1e18": (_changed("kind: cut", f"skip_rows: {10**18}, kind: cut"), REFUSED),
    "campaign: skip_rows of 5000 digits": (_changed("kind: cut", f"skip_rows: {'9' * DEEP}, kind: cut"), REFUSED),
    "campaign: a delimiter of 5000 characters": (_changed("kind: cut", f"delimiter: '{'x' * DEEP}', kind: cut"), EITHER),
    "campaign: an empty delimiter": (_changed("kind: cut", "delimiter: '', kind: cut"), EITHER),
    "campaign: a column of 5000 characters": (_changed("column: disp", f"column: {'n' * DEEP}"), REFUSED),
    "campaign: a column of 1e300": (_changed("column: disp", f"column: {10**300}"), REFUSED),
    "campaign: a unit of 5000 characters": (_changed("unit: um", f"unit: {'m' * DEEP}"), REFUSED),
    "campaign: a channel of 5000 characters": (_changed("displacement:", f"{'d' * DEEP}:"), REFUSED),
    "campaign: a name of 5000 characters": (_changed("name: rig", f"name: {'n' * DEEP}"), EITHER),
    "campaign: a record's name of 5000 characters": (_changed("kind: cut", f"name: {'n' * DEEP}, kind: cut"), EITHER),
    "campaign: 20,000 records": (_changed(RECORD, "\n".join([RECORD] * 20_000)), EITHER),
    "campaign: a comment of 1.5 MB": (_changed("name:", "# " + "a b " * 375_000 + "\nname:"), EITHER),
    "campaign: flutes 1e9": (_changed("kind: cut", "flutes: 1000000000, kind: cut"), REFUSED),
    "scenario: a comment of 1.5 MB": (_changed("name:", "# " + "a b " * 375_000 + "\nname:", SCENARIO), EITHER),
    "scenario: 1e12 revolutions": (_changed("40 rev", f"{10**12} rev", SCENARIO), REFUSED),
    "scenario: 1e300 revolutions": (_changed("40 rev", "1e300 rev", SCENARIO), REFUSED),
    "scenario: -1 revolutions": (_changed("40 rev", "-1 rev", SCENARIO), REFUSED),
    "scenario: depth inf": (_changed("2 mm", "inf mm", SCENARIO), REFUSED),
    "scenario: feed nan": (_changed("0.1 mm/tooth", "nan mm/tooth", SCENARIO), REFUSED),
    "scenario: speed 1e300 rpm": (_changed("3810 rpm", "1e300 rpm", SCENARIO), REFUSED),
    "scenario: speed 1e-300 rpm": (_changed("3810 rpm", "1e-300 rpm", SCENARIO), REFUSED),
    "scenario: seed -1": (_changed("seed: 1", "seed: -1", SCENARIO), REFUSED),
    "scenario: seed of 5000 digits": (_changed("seed: 1", f"seed: {'9' * DEEP}", SCENARIO), REFUSED),
    "scenario: a name of 5000 characters": (_changed("small", "n" * DEEP, SCENARIO), EITHER),
    "scenario: no tests": (
        _changed(SCENARIO[SCENARIO.index("tests:") : SCENARIO.index("sensors:")], "tests: []\n", SCENARIO),
        REFUSED,
    ),
    "scenario: bits 1e9": (_changed("bits: 16", "bits: 1000000000", SCENARIO), REFUSED),
    "scenario: noise inf": (_changed("noise: 0.5 um", "noise: inf um", SCENARIO), REFUSED),
    "scenario: range 0": (_changed("range: 1 mm", "range: 0 mm", SCENARIO), REFUSED),
    "scenario: sampling_rate 1e300 Hz": (_changed("12800 Hz", "1e300 Hz", SCENARIO), REFUSED),
    "scenario: sampling_rate 1e-300 Hz": (_changed("12800 Hz", "1e-300 Hz", SCENARIO), REFUSED),
    "scenario: mass 0": (_changed("2.573 kg", "0 kg", SCENARIO), REFUSED),
}


# -- damaged files ---------------------------------------------------------------------------------------------------------


def _damaged(raw: bytes, seed: int) -> bytes:
    """A sound file with one random damage: flipped bits, random bytes, cut off, a hole, a piece twice."""
    random, data = np.random.default_rng(seed), bytearray(raw)
    place, length = int(random.integers(0, len(raw))), int(random.integers(1, max(2, len(raw) // 20)))
    kind = seed % 5
    if kind == 0:
        data[place] ^= 1 << int(random.integers(0, 8))
    elif kind == 1:
        for spot in random.integers(0, min(len(raw), 4000), 12):
            data[spot] = int(random.integers(0, 256))
    elif kind == 2:
        del data[place:]
    elif kind == 3:
        data[place : place + length] = bytes(len(data[place : place + length]))
    else:
        data[place:place] = data[place : place + length]
    return bytes(data)


def damaged(seeds: Sequence[int]) -> Iterator[Probe]:
    """Sound files of every kind, damaged at random, through the commands that open them in turn."""
    from made_files import FORMATS

    for seed in seeds:
        for kind in ("model.yaml", "good.h5", "scenario.yaml", *FORMATS):
            yield Probe("damaged", f"{kind} {seed}", lambda folder, kind=kind, seed=seed: _damage(folder, kind, seed), EITHER)


def _damage(folder: Path, kind: str, seed: int) -> Sequence[object]:
    from made_files import write

    if kind == "model.yaml":
        (folder / kind).write_bytes(_damaged(MODEL.encode(), seed))
        return "multipliers", kind, "--speed", "3810", "--depth", "2"
    if kind == "scenario.yaml":
        (folder / kind).write_bytes(_damaged(SCENARIO.encode(), seed))
        return "run", kind, "-o", "new.h5"
    if kind == "good.h5":
        _without_seal(folder / kind, folder / "plain.h5")
        (folder / "bad.h5").write_bytes(_damaged((folder / "plain.h5").read_bytes(), seed))
        command = READERS[seed % 5]
        return (command, "bad.h5", *{"identify": ("-m", "model.yaml"), "export": ("-o", "out")}.get(command, ()))
    path = write(kind, folder)
    path.write_bytes(_damaged(path.read_bytes(), seed))
    return _campaign(folder, path.name)


# -- own effects -----------------------------------------------------------------------------------------------------------

LAW = '''"""A law."""
import math
from testbed.effect import Effect, Parameter

EFFECT = Effect(title="A law", law="F = c v", source="nobody", validity="none", leaves="nothing",
                parameters=(Parameter("strength", "c", "N s/m", "how strong", 0.0, (0.0, 1e4), 1.0), ),
                confused_with=(("process_damping", "a shallow cut"), ))


def structure_force(velocity, strength):
    LINE
'''


def _law(line: str, *command: str, beside: str = "", text: str = LAW) -> Make:
    def make(folder: Path) -> Sequence[object]:
        (folder / "own").mkdir()
        (folder / "own" / "law.py").write_text(text.replace("LINE", line))
        (folder / "own" / "beside.py").write_text(beside) if beside else None
        (folder / "precious").write_text("kept")
        (folder / "cut.csv").write_text(TABLE)
        (folder / "campaign.yaml").write_text(CAMPAIGN.replace("FILE", "cut.csv"))
        rest = {
            "effects": ("law",),
            "add": ("law", "-m", "model.yaml", "-c", "campaign.yaml", "-o", "new.yaml"),
            "diagnose": ("campaign.yaml", "-m", "model.yaml"),
        }[command[0]]
        return (*command, *rest, "--effects", "own", *(("--no-picture",) if command[0] == "effects" else ()))

    return make


BAD_LAWS = {
    "nan": "return math.nan * strength",
    "nan beside its neutral value": "return velocity * strength / (strength - strength) if strength > 0.0 else 0.0",
    "raises": "return 1 // int(velocity * 0.0)",
    "raises for a strength": "return strength / (velocity * 0.0)",
    "never ends": "while strength > 0.0:\n        velocity += 0.0\n    return 0.0",
    "never ends at all": "while True:\n        pass",
    "recurses": "return structure_force(velocity, strength)",
    "infinite": "return strength * math.inf",
    "text": "return 'a'",
}
DELETES = "from pathlib import Path\nPath('precious').unlink()\n"


def _of_effects() -> Iterator[Probe]:
    for name, line in BAD_LAWS.items():
        for command in ("effects", "add", "diagnose"):
            yield Probe("own effects", f"{command}: {name}", _law(line, command))
    for name, text in {
        "never ends when read": "while True:\n    pass\n",
        "exits when read": "import os\nos._exit(0)\n",
        "kills when read": "import os\nos.kill(os.getpid(), 9)\n",
        "fills the memory": "x = [0] * 10**11\n",
    }.items():
        yield Probe("own effects", f"effects: {name}", _law("return strength * velocity", "effects", text=text + LAW))
    yield Probe(
        "own effects",
        "a script beside it deletes a file",
        _law("return strength * velocity", "effects", beside=DELETES),
        EITHER,
    )


def probes() -> list[Probe]:
    """All but the random ones, in a fixed order."""
    found = [*_of_paths(), *_of_data_sets(), *_of_effects()]
    for kind, group in (("measured files", MEASURED), ("written texts", WRITTEN)):
        found += [Probe(kind, name, make, codes) for name, (make, codes) in group.items()]
    return found


def prepared(folder: Path) -> None:
    """The sound files that probes begin with."""
    (folder / "model.yaml").write_text(MODEL)
    (folder / "scenario.yaml").write_text(SCENARIO)
    with within(folder):
        made = started(("run", "scenario.yaml", "-o", "good.h5", "--engine", "fast", "--quiet"), 120.0)
    if made.code != 0:
        raise RuntimeError(made.err)


def answered(probe: Probe, sound: Path, folder: Path, command: Callable[..., Said] = started) -> Result:
    """Make a probe in an empty folder and see what the command says. Nothing may be left half-written."""
    for name in ("model.yaml", "scenario.yaml", "good.h5"):
        shutil.copyfile(sound / name, folder / name)
    with within(folder):
        arguments = probe.make(folder)
        before = sorted(path.name for path in folder.iterdir())
        said = command(arguments)
        wrong = said.wrong(probe.codes)
        left = sorted({path.name for path in folder.iterdir()} - set(before))
        if not wrong and said.code == 2 and left:
            wrong = f"left {', '.join(left)}"
        if not wrong and "precious" in before and not (folder / "precious").exists():
            wrong = "a file was deleted"
    return f"{probe.kind}: {probe.name}", not wrong, wrong or (said.err.strip() or "done")[:200]


def run(chosen: Sequence[Probe] | None = None, command: Callable[..., Said] = started) -> list[Result]:
    """Every probe in a process of its own."""
    found = []
    with tempfile.TemporaryDirectory() as name:
        sound = Path(name)
        prepared(sound)
        for probe in [*probes(), *damaged(range(6))] if chosen is None else chosen:
            with tempfile.TemporaryDirectory() as own:
                found.append(answered(probe, sound, Path(own), command))
    return found


__all__ = ["damaged", "forked", "probes", "run"]
