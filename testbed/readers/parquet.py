"""Parquet tables, by pyarrow (extra `formats`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from testbed.problem import InputProblem
from testbed.readers.table import FORMATS_EXTRA, Table, listed, unit_in_name

_LIMIT = 2_000_000_000  # values


def read_parquet(path: Path) -> Table:
    """The numeric columns; units from a column's metadata key `unit` or its name. Raises InputProblem."""
    try:
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    except ImportError:
        raise InputProblem(path, "Parquet needs the package pyarrow", FORMATS_EXTRA) from None
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    unread: dict[str, str] = {}
    notes, rate = [], None
    try:
        with path.open("rb") as stream:
            file = parquet.ParquetFile(stream, page_checksum_verification=True)  # of pages that have one
            if file.metadata.num_rows * max(1, file.metadata.num_columns) > _LIMIT:
                raise InputProblem(path, f"claims {file.metadata.num_rows} rows", "split the file")
            content = file.read()
        for field, column in zip(content.schema, content.columns, strict=True):
            if not (arrow.types.is_integer(field.type) or arrow.types.is_floating(field.type)):
                notes.append(f"column '{field.name}' ({field.type}) is not numeric and was left out")
                unread[field.name] = f"is not numeric ({field.type})"
                continue
            columns[field.name] = column.cast(arrow.float64(), safe=False).to_numpy(zero_copy_only=False)
            unit = (field.metadata or {}).get(b"unit", (field.metadata or {}).get(b"units", b""))
            units[field.name] = unit.decode("utf-8", "replace") or unit_in_name(field.name)
            notes += _contradicted(file.metadata, field.name, columns[field.name])
        for name in (b"sampling_rate", b"fs"):
            if name in (content.schema.metadata or {}):
                rate = float(content.schema.metadata[name])
    except InputProblem:
        raise
    except Exception as error:  # a damaged file raises anything
        raise InputProblem(
            path, f"not readable as Parquet ({type(error).__name__}: {str(error)[:80]})", "export it again"
        ) from None
    if not columns:
        raise InputProblem(path, "no numeric column", f"the file has {listed(content.schema.names, '')}")
    return Table(path, columns, units, rate if rate and rate > 0 else None, 0.0, tuple(notes), unread=unread)


def _contradicted(metadata: Any, name: str, values: np.ndarray) -> list[str]:
    """A note where a column's smallest and largest value are not those that the file's footer states."""
    stated = []
    for group in range(metadata.num_row_groups):
        for place in range(metadata.num_columns):
            column = metadata.row_group(group).column(place)
            if column.path_in_schema == name and column.num_values:
                if column.statistics is None or not column.statistics.has_min_max:
                    return []
                stated.append((float(column.statistics.min), float(column.statistics.max)))
    known = values[~np.isnan(values)]
    if not stated or not len(known):
        return []
    low, high = min(one for one, _ in stated), max(one for _, one in stated)
    if (low, high) == (known.min(), known.max()):
        return []
    return [
        f"column '{name}' runs from {known.min():.9g} to {known.max():.9g}, the file's own statistics say {low:.9g} to "
        f"{high:.9g}: it was damaged"
    ]
