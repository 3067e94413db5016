"""The form of a data set: which tables it has, of what kind and size, and what their values may be."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from testbed.machine import MOST_FLUTES
from testbed.problem import InputProblem
from testbed.recording import CHANNEL_UNITS
from testbed.store.store import CONDITIONS, FORMAT, OUTCOMES, TRUTH

FASTEST = 1e9  # Hz: no converter is as fast
_TEXTS = ("model_text", "scenario_text", "model_xml")
_TIMES = ("marks", "pass_times")
_MAYBE_ZERO = ("axial_depth_of_cut", "initial_displacement", "initial_velocity", "idle_passes", "passes", "ring_down_passes")
_SIGNED = ("initial_displacement", "initial_velocity")


def check_form(path: str | Path, file: h5py.File) -> None:
    """InputProblem at the first table or attribute that is not as `testbed run` writes it. Reads no transients."""
    try:
        _attributes(file.attrs)
        runs = _rows(file, "outcome", "iu", 0, len(OUTCOMES) - 1)
        if runs == 0:
            raise ValueError("it holds no run")
        for name in CONDITIONS:
            _same(name, _rows(file, name, "iuf", -math.inf if name in _SIGNED else 0.0), runs)
            if name not in _MAYBE_ZERO and not (file[name][()] > 0.0).all():
                raise ValueError(f"{name} is 0 in one run")
        _same("scenario_run", _rows(file, "scenario_run", "iu"), runs)
        _same("start", _rows(file, "start", "f"), runs)
        _same("outcome_time", len(_numbers(file, "outcome_time", "f", 1)), runs)
        for name in _TIMES:
            values = _numbers(file, name, "f", 2)
            _same(name, len(values), runs)
            if np.isinf(values).any():
                raise ValueError(f"{name} holds an infinite time")
        for name in file:
            if name.startswith((TRUTH, "noise_")):
                _same(name, len(_numbers(file, name, "iuf", 1)), runs)
        for name in _TEXTS:
            file[name].asstr()[()].encode()
        channels = [name for name in CHANNEL_UNITS if name in file]
        widths = [_channel(name, file[name], runs) for name in channels]
        _same("sample_count", _rows(file, "sample_count", "iu", 0, min(widths, default=2**62)), runs)
    except (KeyError, ValueError, TypeError, IndexError, AttributeError, OverflowError) as problem:  # h5py's own among them
        said = str(problem.args[0] if isinstance(problem, KeyError) and problem.args else problem)
        raise InputProblem(path, f"is no data set as testbed run writes it: {said.rstrip('.')}",
                           "copy it again from where it came from, or simulate it again") from None


def _attributes(attributes: Any) -> None:
    form = _scalar(attributes["format"], "format", "iu")
    if form < 1:
        raise ValueError(f"format {form} is none")
    rate = _scalar(attributes["sampling_rate"], "sampling_rate", "iuf")
    if not 0.0 < rate < FASTEST:
        raise ValueError(f"sampling_rate is {rate:g} Hz")
    flutes = _scalar(attributes["flutes"], "flutes", "iu")
    if not 1 <= flutes <= MOST_FLUTES:
        raise ValueError(f"flutes is {flutes}")
    _scalar(attributes["seed"], "seed", "iu")
    for name in ("title", "engine", "scenario_fingerprint"):
        if not isinstance(attributes[name], (str, bytes)):
            raise ValueError(f"{name} is no text")
    if "versions" in attributes and not isinstance(json.loads(attributes["versions"]), dict):  # of files before provenance
        raise ValueError("versions is no mapping")


def newer(attributes: Any) -> bool:
    """Whether a file says that it is of a later format, whose form is not known here."""
    value = np.asarray(attributes["format"])
    return value.ndim == 0 and value.dtype.kind in "iu" and int(value) > FORMAT


def _scalar(value: object, name: str, kinds: str) -> Any:
    number = np.asarray(value)
    if number.ndim or number.dtype.kind not in kinds:
        raise ValueError(f"{name} is no {'whole ' * ('f' not in kinds)}number")
    return number.item()


def _numbers(file: h5py.File, name: str, kinds: str, axes: int) -> np.ndarray:
    """All values of a table that stands in the file."""
    data = file[name]
    if not isinstance(data, h5py.Dataset) or data.dtype.kind not in kinds or data.ndim != axes:
        raise ValueError(f"{name} is no table of {'whole ' * ('f' not in kinds)}numbers with {axes} ax{'ie'[axes > 1]}s")
    values: np.ndarray = data[()]
    return values


def _rows(file: h5py.File, name: str, kinds: str, low: float = -math.inf, high: float = math.inf) -> int:
    """How many values a table has, all of which are finite and within the bounds."""
    values = _numbers(file, name, kinds, 1)
    outside = ~np.isfinite(values) | (values < low) | (values > high)
    if outside.any():
        raise ValueError(f"{name} is {values[outside][0]} in one run")
    return len(values)


def _channel(name: str, data: Any, runs: int) -> int:
    """Samples a run of a channel."""
    if not isinstance(data, h5py.Dataset) or data.dtype.kind not in "iuf" or data.ndim != 2:
        raise ValueError(f"{name} is no table of numbers of 2 axes")
    _same(name, data.shape[0], runs)
    if not isinstance(data.attrs["units"], (str, bytes)):
        raise ValueError(f"the units of {name} are no text")
    checks: tuple[tuple[str, Callable[[float], bool]], ...] = (
        ("scale_factor", lambda number: math.isfinite(number) and number != 0.0), ("add_offset", math.isfinite),
        ("_FillValue", lambda number: True))  # fmt: skip
    for key, sound in checks if "scale_factor" in data.attrs else ():
        if key == "add_offset" and key not in data.attrs:
            continue
        if not sound(number := float(_scalar(data.attrs[key], f"{key} of {name}", "iuf"))):
            raise ValueError(f"{key} of {name} is {number:g}")
    return int(data.shape[1])


def _same(name: str, found: int, runs: int) -> None:
    if found != runs:
        raise ValueError(f"{name} does not have {runs} rows")
