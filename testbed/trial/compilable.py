"""Does an effect's file compile, does it give the same twice, and is it nothing at its neutral values? A fault names its
file, hook and line.

Each hook is compiled by itself, and evaluated in Python at plausible places of the loop.
"""

from __future__ import annotations

import inspect
import math
import re
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from testbed.effect import HOOKS, Effect
from testbed.problem import InputProblem

_WHOLE_NUMBERS = ("tooth",)
# plausible values of what the hooks may ask for, SI; those that can be of either sign are tried with both
_PLAUSIBLE = {
    "flutes": 2, "tooth": 1, "radius": 0.01, "angle": 0.7, "time": 0.3, "phase": 0.4, "engagement_angle": 1.0,
    "entry_angle": 0.2, "feed_travel": 0.003, "feed_per_tooth": 1e-4, "chip": 8e-5, "penetration": 8e-5, "depth": 2e-3,
    "cutting_speed": 4.0,
    "length_cut": 0.01, "mass": 2.5, "stiffness": 2e6, "damping": 15.0, "spindle_speed": 400.0,
    "applied_force": 20.0, "applied_force_y": 12.0, "torque": 0.1, "immersion": 0.16, "helix_angle": 0.5,
}  # fmt: skip
_SIGNED = {"displacement": 3e-5, "velocity": 0.03, "displacement_y": 2e-5, "velocity_y": 0.02, "edge_velocity": 0.02,
           "edge_velocity_along": 0.01}  # fmt: skip
# what `measure` may ask for
_SAMPLED = {"signal": np.linspace(0.0, 3e-5, 8), "true_signal": np.linspace(0.0, 3e-5, 8), "rate": np.full(8, 0.03),
            "sampling_rate": 12800.0, "quantity": "displacement", "time": np.arange(8) / 12800.0}


def check_compilable(effect: Effect) -> None:
    """InputProblem where a hook of the loop is not a formula of numbers that numba can compile."""
    from numba import float64, int64, njit, types

    for name, function in effect.hooks.items():
        _check_repeats(effect, name, function)
        place = HOOKS["derivative" if name.startswith("derivative_") else name]
        if place.joins == "python":
            continue
        arguments = inspect.signature(function).parameters
        line = function.__code__.co_firstlineno
        compiled = njit(function)
        try:
            with warnings.catch_warnings(action="ignore"):  # what numba minds is said in the one line below
                compiled.compile(tuple(int64 if argument in _WHOLE_NUMBERS else float64 for argument in arguments))
        except Exception as fault:  # numba has several families of them, and not all are NumbaError
            named = re.search(rf'{re.escape(effect.path.name)}(?:", line | \()(\d+)', str(fault)) if effect.path else None
            line = int(named[1]) if named else line
            raise InputProblem(effect.path, f"{name}() does not compile: {_reason(fault)}",
                               "use numbers, the math module and functions made of them", line) from None
        found = compiled.nopython_signatures[0].return_type
        if not isinstance(found, (types.Float, types.Integer, types.Boolean)):
            raise InputProblem(effect.path, f"{name}() gives {found} and not a number",
                               f"return a number in {place.unit}", line)
        _check_neutral(effect, name, function)


def _check_repeats(effect: Effect, name: str, function: Callable) -> None:
    """InputProblem where a hook gives something else at the same arguments: a fit of such a law means nothing."""
    values = values_for(effect, name, effect.example())
    try:
        first, second = (called(function, values) for _ in range(2))
    except Exception:  # what the law cannot do here is for the compiler, or the loop, to say
        return
    if not np.array_equal(first, second, equal_nan=True):
        raise InputProblem(effect.path, f"{name}() gives something else at the same arguments",
                           "a law knows no chance and remembers nothing but its states", function.__code__.co_firstlineno)


def values_for(effect: Effect, hook: str, given: Mapping[str, float], sign: float = 1.0) -> dict[str, Any]:
    """Plausible values of all that a hook may ask for, with these parameters; what can be of either sign has this one."""
    sampled = _SAMPLED if hook == "measure" else {}
    signed = {name: sign * value for name, value in (_SIGNED | dict.fromkeys(effect.states, 1e-5)).items()}
    return {**_PLAUSIBLE, **signed, **sampled, **effect.shaped(given)}


def called(function: Callable, values: Mapping[str, Any]) -> np.ndarray:
    """What a hook gives when it is asked with what it asks for of the values."""
    given = {key: np.copy(values[key]) if isinstance(values[key], np.ndarray) else values[key]  # a hook may write into them
             for key in inspect.signature(function).parameters}
    found = function(**given)
    if found is None:
        raise TypeError("gives nothing")
    return np.asarray(found, dtype=float)


def _check_neutral(effect: Effect, name: str, function: Callable) -> None:
    """InputProblem where a hook's contribution at the neutral values, all states at rest, is not exactly nothing."""
    nothing = {"sum": 0.0, "product": 1.0, "replace": _PLAUSIBLE["penetration"]}.get(HOOKS[name].joins) \
        if name in HOOKS else None
    if nothing is None or not effect.parameters:
        return
    for sign in (1.0, -1.0, 0.0):
        values = _PLAUSIBLE | {key: sign * value for key, value in _SIGNED.items()}
        values |= {**dict.fromkeys(effect.states, 0.0), **effect.shaped(effect.neutral())}
        try:
            found = float(function(**{key: values[key] for key in inspect.signature(function).parameters}))
        except (ArithmeticError, ValueError):  # what is infinite or NaN in the compiled loop
            found = math.nan
        if found != nothing:
            raise InputProblem(effect.path, f"{name}() gives {found:g} at the neutral values", f"there it must be {nothing:g}: "
                               "the effect vanishes", function.__code__.co_firstlineno)


def _reason(fault: Exception) -> str:
    """The first telling line of numba's long message."""
    lines = [line.strip() for line in str(fault).split("Raised from")[0].splitlines() if line.strip()]
    unknown = [line.removeprefix(">>>").strip() for line in lines if line.startswith(">>>")]
    if unknown:
        return f"no number comes of {unknown[0]}"
    noise = ("Failed in", "During:", "File ", "No implementation", ">>>")
    telling = [line for line in lines if not line.startswith(noise)]
    return (telling or lines or [type(fault).__name__])[0].rstrip(".:")
