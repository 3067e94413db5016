"""Where a command may write: never over what it reads, each output to a place of its own, and no empty folder left."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import click

from testbed.api.places import made_folder
from testbed.files.door import typed
from testbed.problem import InputProblem

_MODEL = "NEW.yaml"
_OUTPUTS = ("json_file", "output", "report", "propose")


def check_outputs(context: click.Context) -> None:
    """InputProblem where a command would write over one of its own inputs, write two things to one place, or where the
    name of a file is empty."""
    inputs: list[tuple[click.Parameter, str]] = []
    outputs: list[tuple[click.Parameter, str]] = []
    for parameter, text in _texts(context):
        if not text.strip() and parameter.make_metavar(context) != "TEXT":
            raise InputProblem(_shown(parameter), "is empty", "name a file or a folder")
        if parameter.name not in _OUTPUTS:
            if parameter.make_metavar(context) != "TEXT":
                typed(text)
            inputs.append((parameter, text))
        elif not (parameter.name == "json_file" and text == "-"):
            outputs.append((parameter, text))
    for place, (parameter, text) in enumerate(outputs):
        for other, name in inputs:
            if other.name == "model_file" and parameter.make_metavar(context) == _MODEL:
                continue  # a model replaced by its successor, once that is known, is what was asked for
            # os.path, here and below: it takes a text too long for a name for no file, where Path raises
            if os.path.isfile(name) and os.path.exists(text) and os.path.samefile(text, name):
                raise InputProblem(text, f"exists already, and this command reads it ({_shown(other)})",
                                   f"name another place for {_shown(parameter)}")
        _check_replaced(parameter, text, context)
        for other, name in outputs[:place]:
            folders = all(one.make_metavar(context) == "DIR" for one in (parameter, other))
            if not folders and os.path.realpath(name) == os.path.realpath(text):
                raise InputProblem(text, f"is named by {_shown(other)} and by {_shown(parameter)}", "name two places")


def _check_replaced(parameter: click.Parameter, text: str, context: click.Context) -> None:
    """InputProblem where what stands at the place is of another kind: a campaign and its measured files, an effect, a page.

    A campaign and a folder name more files than the command line does. JSON replaces JSON, a model replaces a model.
    """
    if not os.path.isfile(text) or not os.path.getsize(text):
        return
    kind = ""
    if parameter.name == "json_file" and os.access(text, os.R_OK):
        with open(text, "rb") as file:
            kind = "" if file.read(64).lstrip()[:1] in (b"{", b"[", b"") else "JSON"
    elif parameter.make_metavar(context) == _MODEL:
        from testbed.files.model_file import is_model

        kind = "" if is_model(text) else "model.yaml"
    if kind:
        raise InputProblem(text, f"exists already and is no {kind}", f"name another place for {_shown(parameter)}")


def _texts(context: click.Context) -> Iterator[tuple[click.Parameter, str]]:
    """Every text that was typed, with its parameter; those of a repeated option one by one."""
    for parameter in context.command.params:
        name = parameter.name or ""
        if context.get_parameter_source(name) is click.core.ParameterSource.DEFAULT and name not in _OUTPUTS:
            continue
        given = context.params.get(name)
        for text in given if isinstance(given, tuple) else (given,):
            if isinstance(text, str):
                yield parameter, text


def _shown(parameter: click.Parameter) -> str:
    if isinstance(parameter, click.Argument):
        return str(parameter.metavar or parameter.name)
    return max(parameter.opts, key=len)


def output_folder(path: str | Path) -> Path:
    """A folder for pictures and reports, made if need be; one that the command leaves empty is removed at its end.

    InputProblem where it cannot be made or written to.
    """
    folder = Path(path)
    made = [one for one in (folder, *folder.parents) if not os.path.exists(one)]
    made_folder(folder)
    context = click.get_current_context(silent=True)
    if context is not None and made:
        context.call_on_close(lambda: _remove_empty([one.absolute() for one in made]))
    return folder


def _remove_empty(folders: list[Path]) -> None:
    """The innermost first; what holds something, or is no longer there, stays as it is."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return
