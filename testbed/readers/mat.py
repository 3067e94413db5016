"""MATLAB files: version 5 by scipy, version 7.3 (HDF5) by h5py, transposed as MATLAB stores its arrays.

Only the wanted variable is unpacked, and only after its stated size was found possible.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from testbed.problem import InputProblem
from testbed.readers.table import Table, listed, matrix_columns, why_unread

_NUMERIC = ("double", "single", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64", "logical")
_INFLATION = 1100  # zlib cannot pack better


def read_mat(path: Path, *, key: str | None = None) -> Table:
    """A MAT file. `key` names a variable, or a field of a struct as `struct.field`.

    Without it, the longest numeric variable and all of its length are taken. Raises InputProblem.
    """
    with path.open("rb") as stream:
        head = stream.read(512)
    if b"MATLAB 7.3" in head[:128] or head.startswith(b"\x89HDF\r\n\x1a\n"):
        from testbed.readers.hdf5 import read_hdf5

        return read_hdf5(path, key=key, matlab=True)
    import scipy.io

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            present = scipy.io.whosmat(path)
        except Exception as error:  # a damaged file raises anything from zlib.error to KeyError
            raise _damaged(path, error) from None
        variables: dict[str, tuple[tuple[int, ...], str]] = {
            name: (shape, kind) for name, shape, kind in present if not name.startswith("__")
        }
        wanted = _choose(path, variables, key)
        for name in wanted:
            _possible(path, name, *variables[name])
        try:
            content = scipy.io.loadmat(path, variable_names=wanted, struct_as_record=True, squeeze_me=False)
        except Exception as error:
            raise _damaged(path, error) from None
    columns: dict[str, np.ndarray] = {}
    for name in wanted:
        field = key.partition(".")[2] if key else ""
        columns.update(_columns(path, name, content.get(name), field))
    notes = (
        []
        if key or len(variables) == len(wanted)
        else [f"variables read: {listed(wanted, '')}; others there: {listed(sorted(set(variables) - set(wanted)), '')}"]
    )
    length = max(len(values) for values in columns.values())
    unread = {name: why_unread(shape, kind in _NUMERIC, kind, length)
              for name, (shape, kind) in variables.items() if name not in wanted}
    return Table(path, columns, notes=tuple(notes), unread={name: why for name, why in unread.items() if why})


def _damaged(path: Path, error: Exception) -> InputProblem:
    return InputProblem(
        path, f"not readable as a MAT file ({type(error).__name__}: {str(error)[:80]})", "save it again from MATLAB"
    )


def _choose(path: Path, variables: dict[str, tuple[tuple[int, ...], str]], key: str | None) -> list[str]:
    if key:
        name = key.partition(".")[0]
        if name not in variables:
            raise InputProblem(path, f"no variable '{name}'", f"the file has {listed(variables, '')}")
        return [name]
    numeric = {name: shape for name, (shape, kind) in variables.items() if kind in _NUMERIC and _size(shape) > 1}
    if not numeric:
        described = listed((f"{name} ({kind})" for name, (_, kind) in variables.items()), "")
        raise InputProblem(path, "no numeric array", f"the file has {described}; give `key: struct.field`")
    length = max(max(shape) for shape in numeric.values())
    return [name for name, shape in numeric.items() if max(shape) == length]


def _size(shape: tuple[int, ...]) -> int:
    size = 1
    for axis in shape:
        size *= int(axis)
    return size


def _possible(path: Path, name: str, shape: tuple[int, ...], kind: str) -> None:
    if len(shape) > 2 and kind in _NUMERIC:
        raise InputProblem(path, f"variable '{name}' has {len(shape)} axes", "save columns of samples")
    if _size(shape) > _INFLATION * path.stat().st_size:
        raise InputProblem(
            path,
            f"variable '{name}' claims {_size(shape)} values, more than the file can hold",
            "the file is damaged: save it again",
        )


def _columns(path: Path, name: str, value: object, field: str) -> dict[str, np.ndarray]:
    label = name
    while field:
        here, _, field = field.partition(".")
        names = getattr(getattr(value, "dtype", None), "names", None) or ()
        if here not in names:
            raise InputProblem(path, f"'{label}' has no field '{here}'", f"it has {listed(names, '')}")
        value = value[here].flat[0]  # type: ignore[index]
        label = f"{label}.{here}"
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub" or value.ndim > 2:
        names = getattr(getattr(value, "dtype", None), "names", None)
        inside = listed(names, "") if names else ""
        if getattr(getattr(value, "dtype", None), "kind", "") == "c":
            raise InputProblem(path, f"'{label}' {why_unread((), True, 'complex')}", "give the time record")
        raise InputProblem(
            path,
            f"'{label}' is no real numeric array",
            f"give `key: {label}.FIELD`, one of {inside}" if inside else "save columns of samples",
        )
    if value.size == 0:
        raise InputProblem(path, f"'{label}' has no samples", "check what was saved")
    return matrix_columns(label, value)
