"""Rows into Parquet files, a row group at a time: memory holds one row group a split, whatever the set's size."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from testbed.exports.schema import Column

ROW_GROUP_BYTES = 8_000_000
_FEW = 0.1  # different values for each value: below it they are listed once
SHARD_BYTES = 400_000_000  # before compression


def shard_name(split: str, number: int, count: int) -> str:
    """`train-00000-of-00003.parquet`, as the hub's tools know it."""
    return f"{split}-{number:05d}-of-{count:05d}.parquet"


class ShardWriter:
    """One split's files; they have their names once it is closed. row_bytes: bytes of the longest row's signals."""

    def __init__(self, folder: Path, split: str, listed: tuple[Column, ...], schema: Any, row_bytes: int) -> None:
        self.folder, self.split, self.listed, self.schema = folder, split, listed, schema
        self.group_rows = max(1, ROW_GROUP_BYTES // max(1, row_bytes))
        self.shard_rows = max(self.group_rows, SHARD_BYTES // max(1, row_bytes))
        self.rows: list[Mapping[str, Any]] = []
        self.written: dict[str, int] = {}
        self.name, self._file = "", cast(Any, None)

    def add(self, row: Mapping[str, Any]) -> None:
        """Take a row; every `group_rows` they are written."""
        self.rows.append(row)
        there = self.written.get(self.name, 0) + len(self.rows)
        if len(self.rows) >= self.group_rows or there >= self.shard_rows:
            self._flush()

    def close(self) -> None:
        """Write what is held back, end the last file, and name all of them by how many they are."""
        if self.rows:
            self._flush()
        self._end()
        names = {part: shard_name(self.split, number, len(self.written)) for number, part in enumerate(self.written)}
        for part, name in names.items():
            os.rename(self.folder / part, self.folder / name)
        self.written = {names[part]: rows for part, rows in self.written.items()}

    def abandon(self) -> None:
        """Let go of an open file without finishing it."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _repeats(self, signal: str) -> bool:
        values = np.concatenate([row[signal] for row in self.rows])
        return np.unique(values).size < _FEW * values.size

    def _flush(self) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        if self._file is None:
            self.name = f"{self.split}-{len(self.written):05d}.part"
            self.written[self.name] = 0
            signals = [f"{each.name}.list.element" for each in self.listed if each.kind == "float32 list"]
            words = [each.name for each in self.listed if each.kind == "text"]
            counted = [name for name in signals if self._repeats(name.partition(".")[0])]
            # a converter's counts are few different numbers: a list of them is a third smaller than their bytes side by side
            self._file = pq.ParquetWriter(self.folder / self.name, self.schema, compression="zstd",
                                          use_dictionary=[*words, *counted],
                                          use_byte_stream_split=[name for name in signals if name not in counted])
        arrays = [pa.array([row[field.name] for row in self.rows], type=field.type) for field in self.schema]
        self._file.write_table(pa.Table.from_arrays(arrays, schema=self.schema))
        self.written[self.name] += len(self.rows)
        self.rows = []
        if self.written[self.name] >= self.shard_rows:
            self._end()

    def _end(self) -> None:
        if self._file is None:
            return
        self._file.close()
        self._file = None
        handle = os.open(self.folder / self.name, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
        self.name = ""
