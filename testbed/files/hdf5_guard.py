"""An HDF5 file from somebody else, looked over before a value is read from it.

The format can make a reader open other files (external storage, external links, virtual data sets) and unpack a few
kilobytes into terabytes. None of that is needed here, so all of it is refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from testbed.files.door import plain_file
from testbed.problem import InputProblem

MAX_BYTES = 64 * 2**30          # one data set, unpacked
MAX_RATIO = 2_000               # unpacked to stored; gzip itself cannot pass 1032
RATIO_COUNTS_FROM = 64 * 2**20  # bytes unpacked, below which the ratio does no harm
MAX_OBJECTS = 200_000
MAX_ATTRIBUTES = 10_000
MAX_DEPTH = 100  # groups within groups: HDF5 takes time with the square of it


@contextmanager
def opened(path: str | Path) -> Iterator[h5py.File]:
    """An HDF5 file open for reading that passed the check. InputProblem if it is missing, unsafe or found damaged."""
    plain_file(path, "name the HDF5 file in it")
    name = Path(path)
    try:
        file = h5py.File(name, "r")
    except OSError:
        if name.stat().st_size and not h5py.is_hdf5(name):
            raise InputProblem(path, "is no HDF5 file", "name one: a data set, say, as testbed run writes it") from None
        raise InputProblem(path, "the HDF5 file is cut short", "copy it again from where it came from") from None
    with file:
        try:
            try:
                check(file, path)
            except InputProblem:
                raise
            except (KeyError, ValueError, TypeError) as problem:  # h5py's words for an object it cannot make out
                raise damaged(path, problem) from None
            yield file
        except (OSError, RuntimeError) as problem:  # what the HDF5 library raises where a checksum fails
            raise damaged(path, problem) from None


def damaged(path: object, problem: Exception) -> InputProblem:
    """The one line for an HDF5 file whose inside cannot be read."""
    said = (str(problem).splitlines() or ["unreadable"])[0]
    return InputProblem(path, f"the HDF5 file is damaged ({said})", "copy it again from where it came from")


def check(file: h5py.Group, path: object) -> None:
    """InputProblem at the first thing in an open file that is not to be read. Reads no values."""
    seen: set[bytes] = set()
    waiting = [file]
    while waiting:
        group = waiting.pop()
        for name in group:
            place = f"{group.name.rstrip('/')}/{name}"
            link = group.get(name, getlink=True)
            if isinstance(link, (h5py.SoftLink, h5py.ExternalLink)):
                raise InputProblem(path, f"{place} is a link to elsewhere", "give a file that holds the data itself")
            item = group[name]
            identity = bytes(h5py.h5o.get_info(item.id).addr.to_bytes(8, "little"))
            if identity in seen:
                continue  # a second name of the same object; a loop of groups ends here
            seen.add(identity)
            if len(seen) > MAX_OBJECTS:
                raise InputProblem(path, f"holds more than {MAX_OBJECTS} objects", "give a smaller file")
            if len(item.attrs) > MAX_ATTRIBUTES:
                raise InputProblem(path, f"{place} has too many attributes", "give a smaller file")
            if isinstance(item, h5py.Group):
                if place.count("/") > MAX_DEPTH:
                    raise InputProblem(path, f"has more than {MAX_DEPTH} groups, one within the other", "give a flatter file")
                waiting.append(item)
            elif isinstance(item, h5py.Dataset):
                _check_data(item, path, place)


def _check_data(data: h5py.Dataset, path: object, place: str) -> None:
    plist = data.id.get_create_plist()
    if plist.get_external_count():
        raise InputProblem(path, f"{place} keeps its values in another file", "give a file that holds the data itself")
    if data.is_virtual:
        raise InputProblem(path, f"{place} is put together from other files", "give a file that holds the data itself")
    if data.shape is None:
        return
    unpacked = int(data.size) * data.dtype.itemsize
    if unpacked > MAX_BYTES:
        raise InputProblem(path, f"{place} would unpack to {unpacked / 2**30:.0f} GB",
                           f"at most {MAX_BYTES // 2**30} GB are read")
    # Chunks never written cost nothing on the disk and read as the fill value: a claim as much as a bomb is.
    if unpacked > RATIO_COUNTS_FROM and unpacked > MAX_RATIO * max(1, data.id.get_storage_size()):
        raise InputProblem(path, f"{place} unpacks to more than {MAX_RATIO} times its size", "give the plain data")
    if data.chunks and data.dtype.itemsize * math.prod(data.chunks) > MAX_BYTES:
        raise InputProblem(path, f"{place} has an absurd chunk size", "write it with smaller chunks")
