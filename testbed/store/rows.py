"""Rows of a data set's channels as they stand in the file: unpacked, checked against their hashes, turned into values."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from testbed.problem import InputProblem
from testbed.store.content_hash import row_digest

CHANGED = "was changed after it was written"


def decoded(raw: np.ndarray, attributes: Mapping[str, Any]) -> np.ndarray:
    """Values of a channel, NaN where nothing was recorded."""
    if "scale_factor" not in attributes:
        return raw.astype(float)
    values = raw * float(attributes["scale_factor"]) + float(attributes.get("add_offset", 0.0))
    values[raw == attributes["_FillValue"]] = np.nan
    return values


def check_rows(path: object, rows: np.ndarray, kept: h5py.Dataset | None, first: int, channel: str) -> None:
    """InputProblem at the first run whose samples are not those that were written. kept: None in an old file, read whole."""
    if kept is None:
        return
    for number, (row, digest) in enumerate(zip(rows, kept[first:first + len(rows)], strict=True), first):
        if row_digest(row) != digest.tobytes():
            raise changed(path, f"the {channel} of run {number} is not what was recorded")


def changed(path: object, what: str) -> InputProblem:
    """The one line for a data set that contradicts the hashes it has."""
    return InputProblem(path, f"{CHANGED}: {what}",
                        "copy it again from where it came from, or simulate it again; `testbed verify` says more")


def unpackable(path: Path, data: h5py.Dataset) -> None:
    """InputProblem where the filter that a channel is packed with is not installed."""
    filters = data.id.get_create_plist()
    kinds = [filters.get_filter(place)[0] for place in range(filters.get_nfilters())]
    if any(not h5py.h5z.filter_avail(kind) for kind in kinds):
        try:
            import_module("hdf5plugin")  # it registers its filters
        except ImportError:
            raise InputProblem(path, "is packed with zstd, which is not installed here",
                               'pip install "machining-testbed[fast]"') from None
