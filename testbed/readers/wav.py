"""WAV files, 8 to 32 bit and float, by scipy: one column a channel as a fraction of full scale."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from testbed.problem import InputProblem
from testbed.readers.table import Table


def read_wav(path: Path) -> Table:
    """Channels `1`, `2`, ... in -1..1 of the converter's full scale; `scale` in campaign.yaml turns them into a unit."""
    import scipy.io.wavfile

    notes = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            rate, data = scipy.io.wavfile.read(path)
        except Exception as error:  # a damaged file raises anything from struct.error to ZeroDivisionError
            raise InputProblem(
                path,
                f"not readable as a WAV file ({type(error).__name__}: {str(error)[:80]})",
                "record or export it again",
            ) from None
    for warning in caught:
        notes.append(f"WAV: {str(warning.message)[:100]}")
    if data.size == 0 or rate <= 0:
        raise InputProblem(path, "no samples in the file", "record it again")
    claimed, there = _claimed_bytes(path), path.stat().st_size
    if claimed != there and not (claimed % 2 and there == claimed + 1 or there % 2 and claimed == there + 1):  # but a pad byte
        notes.append(f"the header claims {claimed} bytes, the file has {there}: it was cut or damaged")
    data = data.reshape(len(data), -1)
    if data.dtype.kind == "u":
        values = (data.astype(float) - 128.0) / 128.0
    elif data.dtype.kind == "i":
        values = data.astype(float) / float(2 ** (8 * data.dtype.itemsize - 1))
    else:
        values = data.astype(float)
    names = [str(index + 1) for index in range(values.shape[1])]
    limits = dict.fromkeys(names, 1.0) if data.dtype.kind in "ui" else {}
    notes.append(
        "WAV values are fractions of full scale: give `scale` (unit per full scale) or leave them uncalibrated"
    )
    columns = {name: np.ascontiguousarray(values[:, index]) for index, name in enumerate(names)}
    return Table(path, columns, {name: "" for name in names}, float(rate), 0.0, tuple(notes), limits)


def _claimed_bytes(path: Path) -> int:
    """Size of the whole file as its RIFF header states it; the file's own where that field is not used (RF64)."""
    with path.open("rb") as stream:
        head = stream.read(8)
    stated = int.from_bytes(head[4:8], "big" if head[:4] == b"RIFX" else "little")
    return path.stat().st_size if stated in (0, 0xFFFFFFFF) or head[:4] == b"RF64" else stated + 8
