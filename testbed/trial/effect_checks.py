"""What an effect's file is asked before its law is: it prints nothing, draws no random numbers, and says what it says in
words."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from testbed.effect import Effect, Parameter
from testbed.problem import InputProblem

TEXTS = ("title", "law", "source", "validity", "leaves", "no_linear_answer")
_RANDOM = ("random", "numpy.random", "secrets")


def check_source(path: Path, text: str) -> None:
    """InputProblem where the file prints, or a function of it draws random numbers; a fault of syntax is left to Python."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError):
        return
    for node in _run_when_read(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
            raise InputProblem(path, "calls print()", "take it out: standard output is for the answer, which may be JSON",
                               node.lineno)
    imported = dict(_imported(tree))
    for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
        for node in ast.walk(function):
            drawn = _dotted(node, imported)
            if drawn.startswith(tuple(f"{module}." for module in _RANDOM)):
                raise InputProblem(path, f"{function.name}() draws random numbers ({drawn})",
                                   "a law gives the same at the same arguments: put what varies into a parameter",
                                   getattr(node, "lineno", function.lineno))


def _run_when_read(tree: ast.Module) -> Iterator[ast.AST]:
    """Every node but those under `if __name__ == "__main__"`."""
    for statement in tree.body:
        if not (isinstance(statement, ast.If) and "__name__" in ast.dump(statement.test)):
            yield from ast.walk(statement)


def _imported(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """(name in the file, what it stands for) of everything imported."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for one in node.names:
                yield (one.asname, one.name) if one.asname else (one.name.partition(".")[0],) * 2
        elif isinstance(node, ast.ImportFrom) and node.module:
            for one in node.names:
                yield one.asname or one.name, f"{node.module}.{one.name}"


def _dotted(node: ast.AST, imported: Mapping[str, str]) -> str:
    """The full name of something imported, such as `numpy.random.normal`; empty for anything else."""
    if isinstance(node, ast.Name):
        return imported.get(node.id, "")
    if isinstance(node, ast.Attribute):
        before = _dotted(node.value, imported)
        return f"{before}.{node.attr}" if before else ""
    return ""


def check_texts(path: Path, effect: Effect, line: int | None) -> None:
    """InputProblem where what the file says of its effect is of another kind than the card, the page and a search take."""
    for name in TEXTS:
        if not isinstance(getattr(effect, name), str):
            raise InputProblem(path, f"{name} is no text", f'write it in quotes: {name}="..."', line)
    for name, kind, wanted in (("parameters", Parameter, "Parameter(...)"), ("form", Parameter, "Parameter(...)"),
                               ("states", str, "names in quotes"), ("requires", str, "names in quotes")):
        if not _all(getattr(effect, name), kind):
            raise InputProblem(path, f"{name} is no tuple of {wanted}", f"write {name}=(..., ), with a comma behind each", line)
    if not (isinstance(effect.confused_with, Sequence) and all(_pair(one) for one in effect.confused_with)):
        raise InputProblem(path, "confused_with is no tuple of pairs of texts", 'write (("EFFECT", "TEST CUT"), )', line)


def _all(values: object, kind: type) -> bool:
    return isinstance(values, (tuple, list)) and all(isinstance(one, kind) for one in values)


def _pair(value: object) -> bool:
    return isinstance(value, (tuple, list)) and len(value) == 2 and _all(value, str)
