"""An effect's file of somebody's own is code. It is run, and its laws are asked, in a child process first.

What the child finds, what it was at when it had to be stopped, or that it was ended from within, becomes one line. A compiled
law cannot be interrupted: so one that never ends must be found before. Laws are asked where a cut is likely to be, at the
parameters' example and first values and their bounds; what a law does elsewhere nobody asks.
"""

from __future__ import annotations

import ast
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from testbed.effect import Effect
from testbed.problem import InputProblem
from testbed.system.child import Ended, tried
from testbed.trial.compilable import called, values_for

SECONDS = 4.0  # for all laws of one file: a law takes microseconds
MEMORY = 2**30  # bytes
_MEND = "mend the effect's file"


def defines_effect(text: str) -> bool | None:
    """Whether a Python file gives EFFECT a value, by its text alone; True where it is no Python: what is wrong is said later.

    None: it does not, but it takes Effect from testbed, so somebody meant it to.
    """
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return "EFFECT" in text
    named = {one.id for node in ast.walk(tree) if isinstance(node, (ast.Assign, ast.AnnAssign))
             for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
             for one in ast.walk(target) if isinstance(one, ast.Name)}
    if "EFFECT" in named:
        return True
    meant = any(isinstance(node, ast.ImportFrom) and node.module == "testbed.effect" and any(one.name == "Effect" for one in
                node.names) for node in ast.walk(tree))  # fmt: skip
    return None if meant else False


def try_effect(path: Path, read: Callable[[Path], Effect]) -> None:
    """InputProblem where reading the file, or asking a law of it, fails, ends the program, never ends or gives no number."""
    ended = tried(lambda say: _asked(path, read, say), SECONDS, MEMORY)
    if ended.how == "not tried":
        return
    last: dict[str, Any] = json.loads(ended.said[-1]) if ended.said else {"at": "reading it"}
    if "what" in last:
        raise InputProblem(path, last["what"], last["do"], last["line"])
    if ended.how != "done":
        raise InputProblem(path, f"{last['at']} {_how(ended)}", _MEND, last.get("line"))


def _how(ended: Ended) -> str:
    if ended.how == "too late":
        return f"does not end within {SECONDS:.0f} s"
    return f"ends the program (signal {ended.signal})" if ended.how == "killed" else "ends the program"


def _asked(path: Path, read: Callable[[Path], Effect], say: Callable[[str], None]) -> None:
    """In the child: each line is where it is, the last what was found, if anything was."""
    say(json.dumps({"at": "reading it"}))
    try:
        effect = read(path)
        for name, function, values, must in _questions(effect):
            line = function.__code__.co_firstlineno
            say(json.dumps({"at": f"{name}()", "line": line}))
            wrong = _wrong(function, values, must)
            if wrong:
                raise InputProblem(path, f"{name}() {wrong} at {_shown(function, values)}", _MEND, line)
    except InputProblem as problem:
        say(json.dumps({"what": problem.what, "do": problem.do, "line": problem.line}))
    except MemoryError:
        say(json.dumps({"what": "takes more memory than a law may", "do": _MEND, "line": None}))


def _questions(effect: Effect) -> Iterator[tuple[str, Callable[..., Any], dict[str, Any], bool]]:
    """(hook's name, its function, values of all that it may ask for, whether it must give a number there)."""
    first = {one.name: one.example if one.start is None else one.start for one in effect.parameters}
    low, high = ({one.name: end for one in effect.parameters if math.isfinite(end := one.bounds[place])} for place in (0, 1))
    for given, must in ((effect.example(), True), (effect.example() | first, True), (effect.example() | low, False),
                        (effect.example() | high, False)):
        for sign in (1.0, -1.0, 0.0):
            for name, function in effect.hooks.items():
                yield name, function, values_for(effect, name, given, sign), must


def _wrong(function: Callable[..., Any], values: dict[str, Any], must: bool) -> str:
    try:
        found = called(function, values)
    except MemoryError:
        raise
    except (ArithmeticError, ValueError) as fault:  # what is infinite or NaN in the compiled loop
        return f"gives no number ({type(fault).__name__}: {fault})" if must else ""
    except RecursionError:
        return "calls itself without end"
    except Exception:  # what cannot be compiled says so itself, with its line
        return ""
    except SystemExit:
        return "ends the program"
    return f"gives {float(np.ravel(found)[0]) if found.size == 1 else 'numbers that are not finite'}" \
        if must and not np.isfinite(found).all() else ""


def _shown(function: Callable[..., Any], values: dict[str, Any]) -> str:
    import inspect

    asked = [name for name in inspect.signature(function).parameters if np.ndim(values[name]) == 0]
    return ", ".join(f"{name} {values[name]:g}" for name in asked[:4]) or "any place"
