"""Data sets whose values, attributes and structure are hostile, through the commands that read one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.validation.adversities.probe import DEEP, MODEL, Probe
from tests.validation.adversities.runner import EITHER, REFUSED


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


def nested(file: h5py.Group) -> None:
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
    "5000 nested groups": nested,
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


def without_seal(source: Path, target: Path) -> None:
    with h5py.File(source, "r") as old, h5py.File(target, "w") as new:
        new.attrs.update(old.attrs)
        for name in old:
            old.copy(old[name], new, name)


def probes() -> Iterator[Probe]:
    for place, (name, change) in enumerate(DATA.items()):
        commands = READERS if place % 8 == 0 else (READERS[place % 5], READERS[(place + 1) % 5])
        for command in ("inspect", "verify") if name in HARMLESS else ("score", "export") if "model_text" in name else commands:

            def probe(folder: Path, change: Any = change, command: str = command) -> Sequence[object]:
                without_seal(folder / "good.h5", folder / "bad.h5")
                with h5py.File(folder / "bad.h5", "r+") as file:
                    change(file)
                more = {"identify": ("-m", "model.yaml"), "export": ("-o", "out")}.get(command, ())
                return (command, "bad.h5", *more)

            yield Probe("data sets", f"{command}: {name}", probe, EITHER if name in HARMLESS else REFUSED)
