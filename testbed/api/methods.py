"""The methods of identification that `testbed.score` knows by name, and those in a file of a user's own."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbed.problem import InputProblem

if TYPE_CHECKING:
    from testbed.api.scoring import Sealed

METHODS = ("multipliers", "published", "waveform")
ONE_MODE = "of each test they know the multipliers of one mode along the feed: here there is waveform, or a FILE.py"


def method_named(name: str) -> Callable[[Sealed, Sequence[Any], Any], Mapping[str, Any]]:
    """The function of a method: (sealed, records, belief) -> parameter -> something with value, low, high."""
    if name.endswith(".py"):
        return _outsider(Path(name))
    return {"multipliers": _multipliers, "published": _published, "waveform": _waveform}[name]


def _multipliers(sealed: Sealed, records: Sequence[Any], belief: Any) -> Mapping[str, Any]:
    from testbed.api.identification import identify_by_multipliers

    # a belief has the true ratio of the coefficients
    return identify_by_multipliers(belief, records, sealed.order.data, 0, ratio_doubt=0.0).parameters


def _waveform(sealed: Sealed, records: Sequence[Any], belief: Any) -> Mapping[str, Any]:
    from testbed.api.identification import identify_by_waveform

    found = identify_by_waveform(belief, records, sealed.order.data, sealed.catalogue, sealed.order.data).parameters
    return {path: one for path, one in found.items() if one.determined} if sealed.truth.planar else found


def _published(sealed: Sealed, records: Sequence[Any], belief: Any) -> Mapping[str, Any]:
    from testbed.analysis.multipliers.identify_as_published import identify_as_published
    from testbed.api.identification import cut_tests, start_from_ring_downs

    tests = cut_tests(records, belief.cutter.flutes, sealed.order.data)
    start = start_from_ring_downs(belief, records, tests)
    return identify_as_published(start, [(test.recording, test.cut) for test in tests])


def _outsider(path: Path) -> Callable[[Sealed, Sequence[Any], Any], Mapping[str, Any]]:
    """A user's `identify(recordings, belief)`. It gets copies, and a belief without the true machine's effects."""
    function = load_method(path)

    def method(sealed: Sealed, records: Sequence[Any], belief: Any) -> Mapping[str, Any]:
        recordings = [replace(one, marks=one.marks.copy(), conditions=dict(one.conditions),
                              channels={name: values.copy() for name, values in one.channels.items()})
                      for one in (record.recording for record in records)]
        try:
            answer = function(recordings, replace(belief, effects={}))
        except (ValueError, ArithmeticError):
            raise
        except Exception as fault:
            raise InputProblem(path, f"identify failed with {type(fault).__name__} ({fault})",
                               "raise a ValueError where the recordings do not suffice", _line_in(fault, path)) from fault
        return _checked(path, answer, sealed.parameters)

    return method


def load_method(path: Path) -> Callable[[Any, Any], Any]:
    """The function `identify` of a Python file. InputProblem where there is none."""
    import importlib.util

    if not path.is_file():
        raise InputProblem(path, "no such file", f"give a Python file, or one of {', '.join(METHODS)}")
    spec = importlib.util.spec_from_file_location(f"method_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as fault:
        line = fault.lineno if isinstance(fault, SyntaxError) else _line_in(fault, path)
        raise InputProblem(path, f"cannot be imported ({type(fault).__name__}: {fault})", "correct it", line) from None
    function = getattr(module, "identify", None)
    if not callable(function):
        raise InputProblem(path, "has no function `identify`", "define identify(recordings, belief)")
    return function


def _line_in(fault: BaseException, path: Path) -> int | None:
    """The last line of the user's own file on the way to a fault."""
    import traceback

    lines = [frame.lineno for frame in traceback.extract_tb(fault.__traceback__) if Path(frame.filename) == path.resolve()
             or frame.filename == str(path)]
    return lines[-1] if lines else None


def _checked(path: Path, answer: Any, parameters: Sequence[str]) -> Mapping[str, tuple[float, float, float]]:
    form = "return {name: (value, low, high)}, SI; low and high may be NaN"
    if not isinstance(answer, Mapping) or not answer:
        raise InputProblem(path, f"identify returned {type(answer).__name__}, not values by name", form)
    checked = {}
    for name, three in answer.items():
        try:
            value, low, high = (float(number) for number in three)
        except (TypeError, ValueError):
            raise InputProblem(path, f"identify returned no (value, low, high) for {name}", form) from None
        if not math.isfinite(value) or low > high:
            raise ValueError(f"{name}: {value:g} within {low:g} to {high:g}")
        checked[str(name)] = (value, low, high)
    if not set(parameters) & set(checked):
        raise InputProblem(path, f"identify returned none of {', '.join(parameters)}", form)
    return checked
