"""Writes and allocations that fail: every one of a small sweep and of an export, one after the other, none left out."""

from __future__ import annotations

import itertools
import os
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from testbed.cli import main
from testbed.sweeps import sweep
from tests.support import faults, plain_engine, sweep_kills

faults.RUNS = RUNS = 2
SIZE_STEP = 499  # bytes
Probe = tuple[str, bool, str]
Struck = Callable[[Path, Any], tuple[Any, list[str]]]


def run() -> Iterator[Probe]:
    """The failures of each kind."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        data = folder / "d.h5"
        content = sweep.run(sweep_kills.scenario(RUNS), plain_engine.simulate, data).content_hash
        _exported(data, folder / "set")
        shards = faults.shards_of(folder / "set")
        sizes = [partial(faults.full_at, size) for size in range(0, data.stat().st_size + SIZE_STEP, SIZE_STEP)]
        for kind, keep in (("ENOSPC", False), ("EIO", True), ("MemoryError", False), ("Ctrl-C", True)):
            every = (partial(faults.failing, kind, number) for number in itertools.count(1))
            yield from _each(f"sweep, {kind}", every,
                             lambda at, struck, keep=keep: faults.sweep_with(at, struck, keep, content))
            if kind != "Ctrl-C":
                every = (partial(faults.failing, kind, number) for number in itertools.count(1))
                yield from _each(f"export, {kind}", every, lambda at, struck: faults.export_with(at, data, struck, shards))
        yield from _each("sweep, no room from a size on", iter(sizes),
                         lambda at, struck: faults.sweep_with(at, struck, False, content))
        yield from _each("export, no room from a size on", iter(sizes),
                         lambda at, struck: faults.export_with(at, data, struck, shards))


def _exported(data: Path, target: Path) -> None:
    try:
        main(["export", str(data), "-o", str(target), "--quiet"])
    except SystemExit as stop:
        assert stop.code == 0


def _each(what: str, points: Iterator[Callable[[], Any]], probe: Struck) -> Iterator[Probe]:
    """A result for each failure, until nothing is left to fail."""
    for number, struck in enumerate(points, 1):
        with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as at:
            fault, wrong = probe(Path(at), struck())
        if not fault.where:
            return
        yield f"{what}: number {number}, {fault.where}", not wrong, str(wrong[:3] or "nothing lost")
