"""Faults on purpose: the n-th write or allocation of an operation fails, for every n until none is left to fail.

Writes are those of Python (files, renames, folders, the lock) and those handed to HDF5 and Parquet; allocations those of the
modules that write. What C libraries write by themselves is limited by the size of files that the system allows.
"""

import builtins
import contextlib
import errno
import importlib
import io
import json
import os
import shutil
from contextlib import ExitStack, contextmanager
from unittest.mock import patch

import h5py
import numpy as np

from testbed.cli import main
from testbed.problem import InputProblem
from testbed.store.verification import verify
from testbed.sweeps import sweep
from testbed.sweeps.shards import fault as fault_of
from testbed.sweeps.shards import find
from tests.support import plain_engine, sweep_kills

KINDS = {"ENOSPC": lambda: OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)),
         "EIO": lambda: OSError(errno.EIO, os.strerror(errno.EIO)), "MemoryError": MemoryError,
         "Ctrl-C": KeyboardInterrupt}
_CALLS = {os: ("replace", "rename", "fsync", "mkdir", "chmod", "ftruncate", "pwrite"),
          h5py.Group: ("create_dataset",), h5py.Dataset: ("__setitem__", "make_scale"), h5py.AttributeManager: ("__setitem__",)}
_LATER = {"testbed.store.chunk_writer": ("ChannelWriter._hand_over",), "testbed.system.memory_file": ("MemoryFile._reach",),
          "pyarrow.parquet": ("ParquetWriter.__init__", "ParquetWriter.write_table", "ParquetWriter.close")}
_MODULES = tuple(f"testbed.{name}" for name in (
    "store.chunk_writer", "store.store", "store.rows", "store.data_set", "store.content_hash", "system.memory_file",
    "sweeps.consolidate", "sweeps.shards", "sweeps.batch", "exports.shards", "exports.writing",
    "analysis.multipliers.run_labels", "analysis.multipliers.baseline_scores"))
_MAKING = frozenset(("empty", "zeros", "full", "arange", "array", "where", "rint", "concatenate", "stack", "frombuffer"))


class Fault:
    """Counts what could fail; the call of that number does. number 0: none, they are only counted."""

    def __init__(self, kind, number):
        self.kind, self.number = kind, number
        self.count, self.where = 0, ""

    def point(self, where):
        self.count += 1
        if self.count == self.number:
            self.where = where
            raise KINDS[self.kind]()

    def counted(self, original, where):
        def call(*arguments, **options):
            self.point(where)
            return original(*arguments, **options)
        return call


class _File:
    """An open file whose writes, and whose end, may fail."""

    def __init__(self, file, fault):
        self._file, self._fault = file, fault

    def __getattr__(self, name):
        return getattr(self._file, name)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def __iter__(self):
        return iter(self._file)

    def write(self, data):
        self._fault.point("write")
        return self._file.write(data)

    def close(self):
        closed = self._file.closed
        self._file.close()
        if not closed:
            self._fault.point("close")


class _Numpy:
    """numpy, whose making of arrays may fail."""

    def __init__(self, fault):
        self._fault = fault

    def __getattr__(self, name):
        found = getattr(np, name)
        return self._fault.counted(found, f"numpy.{name}") if name in _MAKING else found


@contextmanager
def failing(kind, number):
    """Within it the `number`-th write (ENOSPC, EIO, Ctrl-C) or allocation (MemoryError) fails; gives the Fault."""
    fault = Fault(kind, number)
    with ExitStack() as stack:
        for owner, names in _targets(kind):
            for name in names:
                original = getattr(owner, name)
                if kind != "MemoryError" or owner is not os:
                    stack.enter_context(patch.object(owner, name, fault.counted(original, f"{owner.__name__}.{name}")))
        if kind == "MemoryError":
            for name in _MODULES:
                module = importlib.import_module(name)
                if hasattr(module, "np"):
                    stack.enter_context(patch.object(module, "np", _Numpy(fault)))
        else:
            stack.enter_context(patch.object(io, "open", _opening(io.open, fault)))
            stack.enter_context(patch.object(builtins, "open", _opening(builtins.open, fault)))
            stack.enter_context(patch.object(os, "open", _descriptor(os.open, fault)))
        yield fault


def _targets(kind):
    yield from _CALLS.items()
    for module, paths in _LATER.items():
        try:
            found = importlib.import_module(module)
        except ImportError:
            continue
        for path in paths:
            owner, _, name = path.partition(".")
            if kind == "MemoryError" or owner != "MemoryFile":
                yield getattr(found, owner), (name,)


def _opening(original, fault):
    def call(file, mode="r", *arguments, **options):
        if not set(mode) & set("wax+"):
            return original(file, mode, *arguments, **options)
        fault.point("open")
        return _File(original(file, mode, *arguments, **options), fault)
    return call


def _descriptor(original, fault):
    def call(path, flags, *arguments, **options):
        if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            fault.point("os.open")
        return original(path, flags, *arguments, **options)
    return call


RUNS = 6


@contextmanager
def full_at(size):
    """Within it no file grows beyond `size` bytes, whoever writes it; gives a Fault that has struck."""
    import resource

    fault = Fault("EFBIG", 0)
    fault.where = "size"
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, unlimited[1]))
    try:
        yield fault
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)


def sweep_with(folder, struck, keep, wanted):
    """(Fault, what is wrong) of a sweep in a new folder under a fault (`failing`, `full_at`), then of its continuation.

    wanted: the content hash of an undisturbed one. Nothing acknowledged may be lost, nothing half-written found.
    """
    target, told, wrong = folder / "a", [0], []
    scenario = sweep_kills.scenario(RUNS)

    def progress(done, runs):
        told.append(done)

    with struck as fault:
        try:
            sweep.run(scenario, plain_engine.simulate, target, keep_shards=keep, progress=progress)
        except InputProblem as problem:
            wrong += [f"said in lines: {problem}"] if "\n" in str(problem) else []
        except KeyboardInterrupt as stop:
            wrong += [] if fault.kind == "Ctrl-C" else [f"interrupted: {stop}"]
        except BaseException as problem:  # whatever it is, it is not what a user is to see
            wrong.append(f"{type(problem).__name__}: {problem}")
        else:
            wrong += ["the fault was not told"] if fault.where and not verify(target).content_hash else []
    names = {path.name for path in folder.iterdir()}
    wrong += [f"left: {name}" for name in names - {"a", "a.parts"}]
    if target.exists():
        wrong += verify(target).damage
    elif "a.parts" in names:
        shards = find(folder / "a.parts")
        kept = sum(last - first for first, last, _ in shards)
        wrong += [f"{path.name} {said}" for _, _, path in shards if (said := fault_of(path))]
        wrong += [f"{kept} runs kept of {max(told)} told"] if kept < max(told) else []
        wrong += [f"left: {path.name}" for path in (folder / "a.parts").glob("*.part")]
    elif max(told):
        wrong.append("all runs are lost")
    engine = plain_engine.unwanted if max(told) == RUNS else plain_engine.simulate
    try:
        again = sweep.run(scenario, engine, target, keep_shards=keep, resume=True)
    except Exception as problem:
        return fault, [*wrong, f"not continued: {problem}"]
    wrong += ["another content"] if again.content_hash != wanted else []
    wrong += [f"left at the end: {path.name}" for path in folder.iterdir() if path != target]
    return fault, wrong


def export_with(folder, data, struck, wanted):
    """(Fault, what is wrong) of an export in a new folder under a fault, then of another try.

    wanted: the hashes of the shards of an undisturbed one.
    """
    target, said, wrong = folder / "set", io.StringIO(), []
    before = data.read_bytes()
    with struck as fault, contextlib.redirect_stderr(said):
        try:
            main(["export", str(data), "-o", str(target), "--quiet"])
        except SystemExit as stop:
            code = stop.code
        except BaseException as problem:  # as above
            code = f"{type(problem).__name__}: {problem}"
    lines = said.getvalue().splitlines()
    if code != 0 and (code != 2 or len(lines) != 1 or not lines[0].startswith("error: ")):
        wrong.append(f"answered {code} with {lines}")
    if fault.where and code == 0 and shards_of(target) != wanted:
        wrong.append("the fault was not told")
    wrong += [f"left: {path.name}" for path in folder.iterdir() if code != 0 or path != target]
    wrong += ["the data set was touched"] if data.read_bytes() != before else []
    shutil.rmtree(target, ignore_errors=True)
    with contextlib.suppress(SystemExit):
        main(["export", str(data), "-o", str(target), "--quiet"])
    wrong += ["the next export differs"] if shards_of(target) != wanted else []
    return fault, wrong


def shards_of(folder):
    """The hashes of an exported folder's shards, None where there is none."""
    try:
        return json.loads((folder / "export.json").read_text())["shards"]
    except OSError:
        return None
