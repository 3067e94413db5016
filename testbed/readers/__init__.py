"""Readers: one file a format, all giving the same Table; what a file is, its content says before its name does."""

from __future__ import annotations

import os
from pathlib import Path

from testbed.files.door import plain_file, readable
from testbed.problem import InputProblem
from testbed.readers.lvm import FIRST_LINE
from testbed.readers.table import Table

__all__ = ["Table", "has_variables", "neighbours", "read_table"]

_ENDINGS = {
    ".mat": "mat",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".hdf": "hdf5",
    ".nc": "hdf5",
    ".wav": "wav",
    ".tdms": "tdms",
    ".uff": "uff",
    ".unv": "uff",
    ".uf58": "uff",
    ".parquet": "parquet",
}
_REFUSED = {
    ".pkl": "a pickle",
    ".pickle": "a pickle",
    ".npy": "a numpy file",
    ".npz": "a numpy file",
    ".xlsx": "a workbook",
    ".xls": "a workbook",
    ".joblib": "a pickle",
}
_PACKED = {b"\x1f\x8b": "gzip", b"\xfd7zXZ\x00": "xz", b"BZh91AY&SY": "bzip2", b"\x28\xb5\x2f\xfd": "zstd"}
_WITH_VARIABLES = ("mat", "hdf5", "tdms", "labview")


def read_table(path: str | Path, *, skip_rows: int = 0, delimiter: str | None = None, key: str | None = None) -> Table:
    """Read a file of any known format.

    skip_rows and delimiter matter to text only, key (a variable, data set, group or capture) to MAT, HDF5, TDMS and LVM.
    Raises InputProblem for a file that is missing, empty, damaged or of no known format.
    """
    path = Path(path)
    kind = file_kind(path)
    with readable(path, f"a file of the kind {kind}", "export it again"):
        return _read(path, kind, skip_rows, delimiter, key)


def _read(path: Path, kind: str, skip_rows: int, delimiter: str | None, key: str | None) -> Table:
    """The table of a file of a known kind."""
    if kind == "mat":
        from testbed.readers.mat import read_mat

        return read_mat(path, key=key)
    if kind == "hdf5":
        from testbed.readers.hdf5 import read_hdf5

        return read_hdf5(path, key=key)
    if kind == "wav":
        from testbed.readers.wav import read_wav

        return read_wav(path)
    if kind == "tdms":
        from testbed.readers.tdms import read_tdms

        return read_tdms(path, key=key)
    if kind == "uff":
        from testbed.readers.uff import read_uff

        return read_uff(path)
    if kind == "parquet":
        from testbed.readers.parquet import read_parquet

        return read_parquet(path)
    from testbed.readers.text import read_text

    return read_text(path, skip_rows=skip_rows, delimiter=delimiter, key=key)


def file_kind(path: Path) -> str:
    """`text`, `labview`, `mat`, `hdf5`, `wav`, `tdms`, `uff` or `parquet`, from the first bytes, else from the name's ending.

    Raises InputProblem.
    """
    try:
        plain_file(path)
    except InputProblem as problem:
        raise InputProblem(path, problem.what, neighbours(path) if not os.path.lexists(path) else problem.do) from None
    with readable(path), path.open("rb") as stream:
        head = stream.read(512)
    if not head:
        raise InputProblem(path, "the file is empty", "check that the export was finished")
    ending = path.suffix.lower()
    if ending in _REFUSED:
        raise InputProblem(path, f"is {_REFUSED[ending]}, which is not read", "export it as CSV, HDF5 or Parquet")
    for magic, packer in _PACKED.items():
        if head.startswith(magic):
            raise InputProblem(path, f"is packed with {packer}", "unpack it first")
    by_content = {
        b"\x89HDF\r\n\x1a\n": "hdf5",
        b"PAR1": "parquet",
        b"TDSm": "tdms",
        b"MATLAB 5": "mat",
        b"MATLAB 7": "mat",
    }
    for magic, kind in by_content.items():
        if head.startswith(magic):
            return "mat" if kind == "hdf5" and ending == ".mat" else kind
    if head[:4] in (b"RIFF", b"RIFX", b"RF64") and head[8:12] == b"WAVE":
        return "wav"
    if ending in _ENDINGS:
        return _ENDINGS[ending]
    if head.lstrip(b"\r\n").startswith(b"    -1") and b"\0" not in head[:12]:
        return "uff"
    return "labview" if head.startswith(FIRST_LINE.encode()) else "text"


def has_variables(path: Path) -> bool:
    """Whether a file is of a format whose variables, data sets, groups or captures a `key` names. Raises InputProblem."""
    return file_kind(path) in _WITH_VARIABLES


def neighbours(path: Path) -> str:
    """What to do about a missing file: the files of the same folder and ending that are closest in name; "" without any."""
    import difflib

    try:
        alike = (item for item in path.parent.iterdir() if item.suffix.lower() == path.suffix.lower())
        there = sorted(item.name for item in alike if item.is_file())
    except (OSError, ValueError):
        return f"the folder {path.parent} does not exist either"
    close = difflib.get_close_matches(path.name, there, 3, 0.5)
    return f"did you mean {', '.join(close)}?" if close else ""
