"""Does an effect's file compile? Each hook is compiled by itself, so that a fault names its file, hook and line."""

from __future__ import annotations

import inspect

from testbed.effect import HOOKS, Effect
from testbed.problem import InputProblem

_WHOLE_NUMBERS = ("tooth",)


def check_compilable(effect: Effect) -> None:
    """InputProblem where a hook of the loop is not a formula of numbers that numba can compile."""
    from numba import float64, int64, njit, types
    from numba.core.errors import NumbaError

    for name, function in effect.hooks.items():
        place = HOOKS["derivative" if name.startswith("derivative_") else name]
        if place.joins == "python":
            continue
        arguments = inspect.signature(function).parameters
        line = function.__code__.co_firstlineno
        compiled = njit(function)
        try:
            compiled.compile(tuple(int64 if argument in _WHOLE_NUMBERS else float64 for argument in arguments))
        except NumbaError as fault:
            raise InputProblem(effect.path, f"{name}() does not compile: {_reason(fault)}",
                               "use numbers, the math module and functions made of them", line) from None
        found = compiled.nopython_signatures[0].return_type
        if not isinstance(found, (types.Float, types.Integer, types.Boolean)):
            raise InputProblem(effect.path, f"{name}() gives {found} and not a number",
                               f"return a number in {place.unit}", line)


def _reason(fault: Exception) -> str:
    """The first telling line of numba's long message."""
    lines = [line.strip() for line in str(fault).splitlines() if line.strip()]
    noise = ("Failed in", "During:", "File ", "No implementation", ">>>")
    telling = [line for line in lines if not line.startswith(noise)]
    return (telling or lines or [type(fault).__name__])[0].rstrip(".:")
