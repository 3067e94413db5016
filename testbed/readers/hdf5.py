"""HDF5 files of other makers, and MATLAB 7.3, which is HDF5 with its arrays transposed.

A file may point outside itself and may claim any size, so that it is checked before a sample is read.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from testbed.problem import InputProblem
from testbed.readers.rehearsal import rehearse
from testbed.readers.table import Table, listed, matrix_columns, why_unread

_RATE_NAMES = ("sampling_rate", "sample_rate", "fs", "Fs", "rate")
_STEP_NAMES = ("wf_increment", "dt", "increment")
_MATLAB_NUMERIC = {b"double", b"single", b"logical"} | {
    f"{sign}int{bits}".encode() for sign in ("", "u") for bits in (8, 16, 32, 64)
}


def read_hdf5(path: Path, *, key: str | None = None, matlab: bool = False) -> Table:
    """Numeric data sets of one length as columns; `key` names a data set or a group.

    Units come from attributes `units`, the rate from `sampling_rate`, `fs` or `dt` on the data set, its group or the
    file. Raises InputProblem.
    """
    from testbed.files.hdf5_guard import opened

    def read() -> Table:
        with opened(path) as file:
            return _read(path, file, key, matlab)

    rehearse(path, read)  # libhdf5 can end the whole process on a damaged file
    try:
        return read()
    except InputProblem:
        raise
    except Exception as error:  # a damaged file raises anything from OSError to RuntimeError
        raise InputProblem(
            path, f"not readable as HDF5 ({type(error).__name__}: {str(error)[:80]})", "save it again"
        ) from None


def _read(path: Path, file: Any, key: str | None, matlab: bool) -> Table:
    import h5py

    found: dict[str, Any] = {}
    others: dict[str, Any] = {}

    def collect(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#refs#"):
            usable = _is_numeric(item, matlab) and 1 <= item.ndim <= 2 and item.size > 1
            (found if usable else others)[name] = item

    file.visititems(collect)
    everything = list(found)
    wanted = _choose(path, found, key, {name: _why(item, matlab) for name, item in others.items()})
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    rates: list[float] = []
    for name, item in wanted.items():
        label = name if matlab or key == name or name.rpartition("/")[2] in columns else name.rpartition("/")[2]
        values = item[()]
        fresh = matrix_columns(label, values.T if matlab else values)
        columns.update(fresh)
        units.update(dict.fromkeys(fresh, _text(item.attrs.get("units", item.attrs.get("unit", "")))))
        rates += _rates(item.attrs) or _rates(item.parent.attrs) or _rates(file.attrs)
    notes = (
        []
        if len(wanted) == len(everything)
        else [
            f"data sets read: {listed(wanted, '')}; others there: "
            f"{listed((name for name in everything if name not in wanted), '')}"
        ]
    )
    if len(set(rates)) > 1:
        raise InputProblem(
            path,
            f"data sets sampled at different rates ({listed((f'{rate:g}' for rate in sorted(set(rates))), '')} Hz)",
            "name one with `key`",
        )
    length = max(len(values) for values in columns.values())
    unread = {label: _why(item, matlab, length) for name, item in (found | others).items() if name not in wanted
              for label in (name, name.rpartition("/")[2])}
    return Table(path, columns, units, rates[0] if rates else None, 0.0, tuple(notes),
                 unread={label: why for label, why in unread.items() if why})


def _is_numeric(item: Any, matlab: bool) -> bool:
    return item.dtype.kind in "fiu" and not (matlab and item.attrs.get("MATLAB_class") not in _MATLAB_NUMERIC)


def _why(item: Any, matlab: bool, length: int = 0) -> str:
    """Why a data set is no column beside others of a length; "" where it may be one."""
    shape = (0,) if item.shape is None else tuple(item.shape)
    kind = _text(item.attrs.get("MATLAB_class", "")) or ("text" if item.dtype.kind in "SUO" else item.dtype.name)
    return why_unread(shape, _is_numeric(item, matlab), kind, length)


def _choose(path: Path, found: dict[str, Any], key: str | None, others: dict[str, str]) -> dict[str, Any]:
    """The data sets asked for, or those of the longest length. others: why each of the others is none."""
    if key:
        name = key.strip("/").replace(".", "/") if key.strip("/") not in found else key.strip("/")
        hits = {label: item for label, item in found.items() if label == name or label.startswith(f"{name}/")}
        if not hits:
            raise InputProblem(path, f"no numeric data set '{key}'", f"the file has {listed(found, '')}")
        found = hits
    if not found:
        there = "; ".join(f"{name} {why}" for name, why in list(others.items())[:6])
        raise InputProblem(path, "no numeric data set", f"check what was saved{': ' * bool(there)}{there}")
    length = max(max(item.shape) for item in found.values())
    return {name: item for name, item in found.items() if max(item.shape) == length}


def _rates(attributes: Any) -> list[float]:
    for names, invert in ((_RATE_NAMES, False), (_STEP_NAMES, True)):
        for name in names:
            if name in attributes:
                value = np.asarray(attributes[name]).ravel()
                if value.size == 1 and value.dtype.kind in "fiu" and 0 < float(value[0]) < 1e12:
                    return [1.0 / float(value[0]) if invert else float(value[0])]
    return []


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
